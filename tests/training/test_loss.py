import numpy as np
import pytest
import torch

from re3.geometry import REGRESSION_SCALE, iou_xyxy
from re3.network.base import Prediction
from re3.training.loss import corner_cells, overlaps, tracking_loss
from re3.training.recipe import LossWeights

TARGET = torch.tensor([[2.5, 2.5, 7.5, 7.5]])


def output(corners, grid=24, score=0.0):
    n = len(corners)
    heat = torch.zeros(n, 2, grid, grid)
    return Prediction(corners, torch.full((n,), score), heat, torch.zeros(n, grid, grid))


def loss(corners, has_box=1.0, hidden=0.0, weights=None):
    return tracking_loss(
        output(corners),
        TARGET.expand(len(corners), 4),
        torch.full((len(corners),), has_box),
        torch.full((len(corners),), hidden),
        weights or LossWeights(),
    )


@pytest.mark.parametrize(
    ("a", "b", "iou", "giou"),
    [
        ((0, 0, 2, 2), (0, 0, 2, 2), 1.0, 1.0),  # the same
        ((0, 0, 2, 2), (1, 0, 3, 2), 1 / 3, 1 / 3),  # half shifted: the hull is the union
        ((0, 0, 1, 1), (2, 0, 3, 1), 0.0, -1 / 3),  # apart: a third of the hull is empty
    ],
)
def test_overlaps(a, b, iou, giou):
    got = overlaps(torch.tensor([a]).float(), torch.tensor([b]).float())
    np.testing.assert_allclose([got[0].item(), got[1].item()], [iou, giou], atol=1e-6)
    assert iou == pytest.approx(float(iou_xyxy(a, b)))


def test_the_cells_of_a_corner_average_to_it():
    targets = torch.tensor([[1.3, 2.0, 6.1, 9.2]])
    cells, inside = corner_cells(targets, 24)
    assert inside.tolist() == [[1, 1]]
    np.testing.assert_allclose(cells.sum(dim=(2, 3)), 1.0, atol=1e-5)
    centres = (torch.arange(24) + 0.5) / 24 * REGRESSION_SCALE
    x = (cells.sum(dim=2) * centres).sum(dim=2)[0]
    y = (cells.sum(dim=3) * centres).sum(dim=2)[0]
    np.testing.assert_allclose([x[0], y[0], x[1], y[1]], targets[0], atol=1e-5)


def test_a_corner_outside_the_crop_has_no_cell():
    _, inside = corner_cells(torch.tensor([[-1.0, 2.0, 6.0, 11.0]]), 24)
    assert inside.tolist() == [[0, 0]]


def test_the_corner_term_is_the_mean_absolute_error():
    got = loss(TARGET + torch.tensor([[1.0, -1.0, 2.0, 0.0]]))
    assert got.parts["corners"] == pytest.approx(1.0)
    assert loss(TARGET.clone()).parts["corners"] == 0


def test_without_a_box_only_the_score_learns():
    corners = TARGET + 1.0
    corners.requires_grad_(True)
    got = loss(corners, has_box=0.0)
    assert got.total.item() == pytest.approx(LossWeights().score * got.parts["score"])
    assert got.overlap.tolist() == [0.0]  # the score's target: there is nothing to overlap


def test_a_hidden_object_counts_less_beside_a_visible_one():
    corners = torch.cat([TARGET + 2.0, TARGET])

    def total(hidden):
        return tracking_loss(
            output(corners),
            TARGET.expand(2, 4),
            torch.ones(2),
            torch.tensor(hidden),
            LossWeights(),
        ).parts["corners"]

    assert total([1.0, 0.0]) < total([0.0, 0.0])


def test_the_outline_learns_where_it_is_known():
    outlines = torch.zeros(2, 24, 24)
    outlines[0, 8:16, 8:16] = 1.0
    outlines[1] = float("nan")  # of a recorded clip
    said = output(TARGET.expand(2, 4))
    logits = torch.zeros(2, 24, 24, requires_grad=True)

    def of(logits):
        return tracking_loss(
            said._replace(outline_logits=logits),
            TARGET.expand(2, 4),
            torch.ones(2),
            torch.zeros(2),
            LossWeights(outline=1.0),
            outlines=outlines,
        )

    found = of(logits)
    assert found.parts["outline"] == pytest.approx(np.log(2))
    found.total.backward()
    assert (logits.grad[1] == 0).all()
    assert (logits.grad[0, 8:16, 8:16] < 0).all() and (logits.grad[0, :8] > 0).all()
    assert of(20 * (outlines.nan_to_num() - 0.5)).parts["outline"] == pytest.approx(0.0, abs=1e-3)


def test_no_outline_is_learnt_where_none_is_asked_for():
    assert "outline" not in loss(TARGET).parts
