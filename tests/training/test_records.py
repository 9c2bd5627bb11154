import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from re3.training.loss import Losses
from re3.training.recipe import Phase
from re3.training.records import LOG, Records, pictures, read_log
from re3.training.rollout import Rollout
from re3.training.step import Learnt
from re3.training.throughput import Throughput

PHASE = Phase(unroll=2, batch=1, own=0.0, iterations=5)
PARTS = {"clips": 0.25, "learn": 0.75}
ENDED = Throughput(1, 2, 4, 5, 12.345, PARTS, PARTS)


def learnt(loss=1.0, steps=3, sequences=1, has_box=1.0):
    rows = steps * sequences
    rollout = Rollout(
        images=np.zeros((rows, 40, 40, 3), np.uint8),
        crops=(torch.zeros(0),) * 3,
        looked=torch.zeros(rows, 4),
        targets=torch.tensor([[2.5, 2.5, 7.5, 7.5]]).expand(rows, 4),
        has_box=torch.full((rows,), has_box),
        hidden=torch.zeros(rows),
        steps=steps,
        put_back=0.25,
    )
    losses = Losses(torch.tensor(loss), loss, {"corners": loss / 2}, 0.75, torch.zeros(rows))
    sources = {"uav": loss, "stills": 0.5}
    return Learnt(rollout, torch.full((rows, 4), 5.0), losses, 1.5, sources)


def note(records, iterations, loss=1.0):
    for iteration in iterations:
        records.iteration(iteration, PHASE, learnt(loss), 1e-3, {"clips": 0.25}, 0.5)


def test_an_iteration_is_a_line(tmp_path):
    with Records(tmp_path, 0) as records:
        note(records, [1])
        assert read_log(tmp_path / LOG) == [  # at once, not when the file is closed
            {
                "iteration": 1,
                "loss": 1.0,
                "terms": {"corners": 0.5},
                "sources": {"uav": 1.0, "stills": 0.5},
                "overlap": 0.75,
                "put_back": 0.25,
                "learning_rate": 1e-3,
                "gradient_norm": 1.5,
                "unroll": 2,
                "batch": 1,
                "seconds": {"clips": 0.25},
                "processor": 0.5,
            }
        ]


def test_a_phase_that_ends_has_a_line(tmp_path):
    with Records(tmp_path, 0) as records:
        records.throughput(7, ENDED)
    assert read_log(tmp_path / LOG) == [
        {
            "iteration": 7,
            "throughput": {
                "phase": 1,
                "unroll": 2,
                "batch": 4,
                "iterations": 5,
                "pairs_per_second": 12.35,
                "seconds": {"clips": 0.25, "learn": 0.75},
                "shares": {"clips": 0.25, "learn": 0.75},
            },
        }
    ]


def test_a_resumed_log_is_cut_at_the_checkpoint(tmp_path):
    with Records(tmp_path, 0) as records:
        note(records, range(1, 6))
        records.validation(3, {"AUC": 0.5})
        records.validation(5, {"AUC": 0.6})
    with (tmp_path / LOG).open("a") as file:
        file.write('{"iteration": 6, "lo')  # killed while it wrote
    (tmp_path / "checkpoint.pt.77.partial").touch()
    with Records(tmp_path, 3) as records:
        note(records, [4], loss=2.0)
    entries = read_log(tmp_path / LOG)
    assert [(e["iteration"], e.get("loss"), e.get("validation")) for e in entries] == [
        (1, 1.0, None),
        (2, 1.0, None),
        (3, 1.0, None),
        (3, None, {"AUC": 0.5}),
        (4, 2.0, None),
    ]
    assert all(line.endswith("}") for line in (tmp_path / LOG).read_text().splitlines())
    assert not list(tmp_path.glob("*.partial"))


def test_tensorboard_gets_figures_and_pictures(tmp_path):
    with Records(tmp_path, 0) as records:
        note(records, range(1, 201))
        note(records, range(201, 206), loss=1.0)
        note(records, range(206, 211), loss=4.0)
        records.throughput(210, ENDED)
        records.validation(210, {"AUC": 0.5, "drops": 3.0})
    events = EventAccumulator(str(tmp_path), {"images": 0}).Reload()
    assert {
        "loss/total",
        "loss/corners",
        "overlap",
        "put_back",
        "learning_rate",
        "gradient_norm",
        "unroll",
        "batch",
        "seconds/clips",
        "source/uav",
        "source/stills",
        "pairs_per_second",
        "validation/AUC",
        "validation/drops",
    } == set(events.Tags()["scalars"])
    assert [e.step for e in events.Scalars("gradient_norm")] == list(range(10, 211, 10))
    # The mean of a source's losses since the point before.
    assert [e.value for e in events.Scalars("source/uav")] == [1.0] * 20 + [2.5]
    (picture,) = events.Images(events.Tags()["images"][0])
    assert (picture.step, picture.width, picture.height) == (200, 3 * 40, 40)


@pytest.mark.parametrize(("has_box", "green"), [(1.0, True), (0.0, False)])
def test_pictures_show_the_true_box_and_the_one_found(has_box, green):
    picture = pictures(learnt(steps=2, sequences=6, has_box=has_box))
    assert picture.shape == (4 * 40, 2 * 40, 3)  # four sequences of the six, all steps
    red = picture[20, 20]  # the box found is a point in the middle
    assert red[0] > 200 > red[1]
    assert (picture[10, 10][1] > 150) == green  # the true box goes from 10 to 30


def test_a_box_far_outside_the_crop_is_drawn_all_the_same():
    given = learnt()
    given.corners[:] = 1e12
    assert pictures(given).shape == (40, 120, 3)
