"""Trackers asked for with a prefix, with options, or under a name of their own."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from re3.data.sequence import Sequence
from re3.evaluation.floors import RandomWalk
from re3.evaluation.our_tracker import OurOptions, OurTracker, split_options
from re3.evaluation.peer_files import VIT_FILE
from re3.evaluation.peers import ALIASES, available_trackers, find_tracker
from re3.evaluation.python_trackers import PythonTracker
from re3.evaluation.result_files import result_path
from re3.evaluation.task import Task

FRAME = np.zeros((60, 80, 3), np.uint8)


@pytest.fixture
def peer_files(tmp_path) -> Path:
    """A folder with the peers' files by name, which hold nothing."""
    for version in ("v1", "v2", "v3"):
        folder = tmp_path / "peers" / "nanotrack" / version
        folder.mkdir(parents=True)
        for part in ("backbone", "head"):
            (folder / f"nanotrack_{part}_sim.onnx").touch()
    (tmp_path / "peers" / VIT_FILE).touch()
    (tmp_path / "peers" / "fear").mkdir()
    for part in ("template", "search"):
        (tmp_path / "peers" / "fear" / f"fear_xs_{part}.onnx").touch()
    return tmp_path / "peers"


@pytest.mark.parametrize(
    ("asked", "name"),
    [
        ("opencv:kcf", "kcf"),
        ("opencv:mil", "mil"),
        ("opencv:nano", "nanotrack-v2"),
        ("opencv:vit", "vit"),
        ("nanotrack:v1", "nanotrack-v1-onnx"),
        ("nanotrack:v2", "nanotrack-v2-onnx"),
        ("nanotrack:v3", "nanotrack-v3"),
        ("fear-xs", "fear-xs"),
        ("mine=opencv:tld", "mine"),  # a name of its own
        ("mine=kcf", "mine"),
        ("re3-lite@no-reset", "re3-lite@no-reset"),
        ("mine=re3-lite@reset-16@torch", "mine"),
        ("python:re3.evaluation.floors:FirstBox", "FirstBox"),
        ("mine=python:re3.evaluation.floors:FirstBox", "mine"),
    ],
)
def test_what_is_asked_for_and_how_it_is_called(peer_files, asked, name):
    assert find_tracker(asked, peer_files).name == name


def test_every_alias_is_of_a_tracker_that_is_listed(peer_files):
    known = {info.name for info in available_trackers(peer_files)}
    assert set(ALIASES.values()) <= known
    assert {f"opencv:{name}" for name in ("boosting", "csrt", "medianflow", "mosse")} < set(ALIASES)


def test_every_tracker_can_be_sent_to_another_process(peer_files):
    sequence = Sequence("clip", Path("clip.mp4"), np.array([(0.0, 0.0, 1.0, 1.0)]))
    infos = [info for info in available_trackers(peer_files) if info.factory is not None]
    infos += [find_tracker("re3-lite@no-reset"), find_tracker("python:fake_trackers:Follows")]
    assert len(infos) > 12
    for info in infos:
        assert pickle.loads(pickle.dumps(Task(info.factory, sequence)))


@pytest.mark.parametrize(
    ("asked", "error", "told"),
    [
        ("opencv:kfc", ValueError, "'opencv:kfc'; expected one of opencv:kcf, "),
        ("nanotrack:v4", ValueError, "expected one of nanotrack:v1, nanotrack:v2, nanotrack:v3$"),
        ("kcf@no-reset", ValueError, "options after @ are for our models only; expected 'kcf'"),
        ("re3-lite@often", ValueError, "unknown option 'often'.*reset-N"),
        ("re3-lite@reset-0", ValueError, "unknown option 'reset-0'"),
        ("gone.onnx@torch", FileNotFoundError, "gone.onnx does not exist"),
        ("published:gone", NotADirectoryError, "gone is not a folder"),
        ("python:nothing", ValueError, "expected package.module:Class"),
        ("python:nothing.here:Tracker", ValueError, "'nothing.here:Tracker' cannot be imported"),
        ("python:fake_trackers:Nobody", ValueError, "cannot be imported .*Nobody"),
        ("python:fake_trackers:NotATracker", ValueError, "has no methods init and update"),
    ],
)
def test_what_cannot_be_had_is_told(asked, error, told):
    with pytest.raises(error, match=told):
        find_tracker(asked)


def test_published_boxes_have_the_name_of_their_folder(tmp_path):
    (tmp_path / "SiamFC").mkdir()
    info = find_tracker(f"published:{tmp_path / 'SiamFC'}")
    assert (info.name, info.published, info.factory) == ("SiamFC", tmp_path / "SiamFC", None)


def test_a_command_becomes_a_name_that_can_be_a_folder(monkeypatch, sequence_of):
    trax = pytest.importorskip("re3.evaluation.trax")
    monkeypatch.setattr(trax, "import_trax", lambda: None)
    info = find_tracker("trax:python3 '/some where/tracker.py' --fast=1")
    assert info.name == "trax-python3-some-where-tracker.py-fast-1"
    assert result_path(Path("out"), info.name, sequence_of([(0, 0, 1, 1)])).parent.name == info.name
    assert find_tracker("mine=trax:env A=1 tracker").name == "mine"


@pytest.mark.parametrize(
    ("asked", "model", "options"),
    [
        ("re3-lite", "re3-lite", OurOptions()),
        ("re3-lite@torch", "re3-lite", OurOptions(engine="torch")),
        ("a@b/c.onnx", "a@b/c.onnx", OurOptions()),  # a folder's name is no option
        (
            "a@b/c.onnx@reset-8@threads-2",
            "a@b/c.onnx",
            OurOptions(reset_interval=8, threads=2),
        ),
        ("re3-lite@onnx@no-reset", "re3-lite", OurOptions(engine="onnx", reset_interval=0)),
        ("re3-lite@no-search", "re3-lite", OurOptions(search=False)),
        ("re3-lite@no-motion", "re3-lite", OurOptions(motion=False)),
        ("re3-lite@no-framing", "re3-lite", OurOptions(framing=False)),
        ("re3-base@framing", "re3-base", OurOptions(framing=True)),
    ],
)
def test_options_of_our_models(asked, model, options):
    assert split_options(asked) == (model, options)


def test_the_reset_is_left_out_or_moved(moving_patch):
    images, boxes = moving_patch

    def follow(options: OurOptions | None) -> list:
        tracker = OurTracker("re3-lite", options)
        tracker.init(images[0], boxes[0])
        return [tracker.update(image)[0] for image in images[1:6]]

    usual, never, early = (
        follow(options)
        for options in (None, OurOptions(reset_interval=0), OurOptions(reset_interval=2))
    )
    # Five steps are fewer than the model's own interval, and more than two.
    np.testing.assert_array_equal(usual, never)
    np.testing.assert_array_equal(usual[:2], early[:2])
    assert not np.array_equal(usual[2:], early[2:])


def test_the_walk_stays_in_the_frame_and_keeps_its_size():
    walk, again, other = RandomWalk(1), RandomWalk(1), RandomWalk(2)
    for tracker in (walk, again, other):
        tracker.init(FRAME, (10, 10, 20, 10))
    boxes = np.array([walk.update(FRAME)[0] for _ in range(300)])
    np.testing.assert_array_equal(boxes[0], again.update(FRAME)[0])
    assert not np.array_equal(boxes[0], other.update(FRAME)[0])
    np.testing.assert_allclose(boxes[:, 2:], (20, 10) * np.ones((300, 1)))
    centres = boxes[:, :2] + boxes[:, 2:] / 2
    assert (centres >= 0).all() and (centres <= (80, 60)).all()
    assert np.ptp(centres, axis=0).min() > 5


class Answers:
    """Gives what it is told to."""

    given: object = None

    def init(self, frame, box_xywh):
        self.box = box_xywh

    def update(self, frame):
        return type(self).given


class Result:
    box_xywh, score = (1, 2, 3, 4), 0.25


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (((1, 2, 3, 4), 0.5), ((1, 2, 3, 4), 0.5)),  # a box and a score
        ((1, 2, 3, 4), ((1, 2, 3, 4), 1.0)),  # a box
        (np.array([1.0, 2, 3, 4]), ((1, 2, 3, 4), 1.0)),
        ((np.array([1.0, 2, 3, 4]), 0.5), ((1, 2, 3, 4), 0.5)),
        (Result(), ((1, 2, 3, 4), 0.25)),  # an object
    ],
)
def test_python_trackers_may_answer_in_several_ways(monkeypatch, given, expected):
    monkeypatch.setattr(Answers, "given", given)
    tracker = PythonTracker(f"{__name__}:Answers")
    tracker.init(FRAME, np.array([1.0, 2, 3, 4]))
    box, score = tracker.update(FRAME)
    assert (tuple(box), score) == expected
