"""The training loss: L1 on the corners (Re3, sec. III-B) and terms that help it along.

Each term is a weighted mean over all steps of all sequences of a batch. Where several processes
share a batch, the sums of weights are those of the whole batch, so that the mean over the processes
of their losses, and of their gradients, is that of one process with the whole batch.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from re3.geometry import REGRESSION_SCALE
from re3.network.base import Prediction
from re3.training.distributed import ALONE, Processes
from re3.training.recipe import LossWeights


@dataclass(frozen=True)
class Losses:
    """The loss and what it is made of.

    Attributes:
        total: scalar, of this process's share of the batch, to take gradients of.
        value: of the whole batch; so are all that follow but the last.
        parts: the terms, unweighted.
        mean_overlap: IoU of prediction and truth over the steps with a true box.
        overlap: `[N]`, IoU of this process's steps; 0 where there is no true box.
    """

    total: Tensor
    value: float
    parts: dict[str, float]
    mean_overlap: float
    overlap: Tensor


@dataclass(frozen=True, eq=False)
class LossTerms:
    """The loss as tensors on the device, without waiting for it.

    Attributes:
        total: scalar, of this process's share of the batch, to take gradients of.
        parts: the terms, unweighted scalars.
        mean_overlap: scalar, IoU of prediction and truth over the steps with a true box.
        overlap: `[N]`, IoU of each step; 0 where there is no true box.
    """

    total: Tensor
    parts: dict[str, Tensor]
    mean_overlap: Tensor
    overlap: Tensor


def overlaps(predicted: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and generalised IoU of boxes_xyxy `[N, 4]` (Rezatofighi et al., 2019)."""
    low = torch.maximum(predicted[:, :2], truth[:, :2])
    high = torch.minimum(predicted[:, 2:], truth[:, 2:])
    intersection = (high - low).clamp(min=0).prod(dim=1)
    area = (predicted[:, 2:] - predicted[:, :2]).clamp(min=0).prod(dim=1)
    true_area = (truth[:, 2:] - truth[:, :2]).clamp(min=0).prod(dim=1)
    union = area + true_area - intersection
    iou = intersection / union.clamp(min=1e-6)
    hull = (
        (
            torch.maximum(predicted[:, 2:], truth[:, 2:])
            - torch.minimum(predicted[:, :2], truth[:, :2])
        )
        .clamp(min=0)
        .prod(dim=1)
    )
    return iou, iou - (hull - union) / hull.clamp(min=1e-6)


def corner_cells(targets: Tensor, grid: int) -> tuple[Tensor, Tensor]:
    """Distribution over the grid whose mean is the true corner, bilinear over four cells.

    Args:
        targets: `[N, 4]` in regression units.
        grid: cells a side.

    Returns:
        `[N, 2, grid, grid]` for the top-left and the bottom-right corner, and `[N, 2]`, 1 where
        the corner is inside the grid.
    """
    points = targets.reshape(-1, 2, 2) / REGRESSION_SCALE * grid - 0.5  # [N, corner, x and y]
    inside = ((points > -0.5) & (points < grid - 0.5)).all(dim=2).float()
    cells = torch.arange(grid, dtype=targets.dtype, device=targets.device)
    near = (1 - (points.clamp(0, grid - 1)[..., None] - cells).abs()).clamp(min=0)  # [N, 2, 2, G]
    return near[:, :, 1, :, None] * near[:, :, 0, None, :], inside


def tracking_loss(
    output: Prediction,
    targets: Tensor,
    has_box: Tensor,
    hidden: Tensor,
    weights: LossWeights,
    processes: Processes = ALONE,
    outlines: Tensor | None = None,
) -> Losses:
    """Loss of N steps, as numbers; see `loss_terms` for its arguments."""
    terms = loss_terms(output, targets, has_box, hidden, weights, processes, outlines)
    figures = torch.stack([terms.total, terms.mean_overlap, *terms.parts.values()])
    value, overlap, *parts = (processes.sum(figures) / processes.count).tolist()
    return Losses(
        total=terms.total,
        value=value,
        parts=dict(zip(terms.parts, parts, strict=True)),
        mean_overlap=overlap,
        overlap=terms.overlap,
    )


def loss_terms(
    output: Prediction,
    targets: Tensor,
    has_box: Tensor,
    hidden: Tensor,
    weights: LossWeights,
    processes: Processes = ALONE,
    outlines: Tensor | None = None,
) -> LossTerms:
    """Loss of N steps.

    Args:
        output: of the network; what it does not predict has no term.
        targets: `[N, 4]` true corners in regression units.
        has_box: `[N]`, 1 where there is a true box inside the crop.
        hidden: `[N]`, 1 where the object is all but hidden.
        weights: of the terms.
        processes: that have a share of the batch, each of N steps.
        outlines: `[N, G, G]`, share of each cell that shows the object, NaN where that is not
            known; None where it is not asked for.
    """
    weight = has_box * (1 - hidden * (1 - weights.hidden))
    sums, heat = [weight.sum(), has_box.sum()], None
    if output.heat_logits is not None:
        cells, inside = corner_cells(targets, output.heat_logits.shape[-1])
        corner_weight = inside * weight[:, None]  # [N, 2]
        log_heat = F.log_softmax(output.heat_logits.flatten(2), dim=2)
        entropy = -(cells.flatten(2) * log_heat).sum(dim=2)  # [N, 2]
        heat = (entropy * corner_weight).sum()
        sums.append(corner_weight.sum())
    outline = None
    if outlines is not None and output.outline_logits is not None:
        known = 1 - outlines[:, 0, 0].isnan().float()
        shares = outlines.nan_to_num(0.0)
        entropy = F.binary_cross_entropy_with_logits(
            output.outline_logits, shares, reduction="none"
        ).mean(dim=(1, 2))
        outline = (entropy * known).sum()
        sums.append(known.sum())
    boxes, present, *others = processes.sum(torch.stack(sums)).clamp(min=1.0) / processes.count

    iou, giou = overlaps(output.corners, targets)
    reached = (iou * has_box).detach()
    terms = {
        "corners": ((output.corners - targets).abs().mean(dim=1) * weight).sum() / boxes,
        "overlap": ((1 - giou) * weight).sum() / boxes,
    }
    if heat is not None:
        terms["heat"] = heat / others[0]
    if outline is not None:
        terms["outline"] = outline / others[-1]
    if output.score_logit is not None:
        terms["score"] = F.binary_cross_entropy_with_logits(output.score_logit, reached)
    factors = asdict(weights)
    total = torch.stack([factors[name] * term for name, term in terms.items()]).sum()

    return LossTerms(total, terms, reached.sum() / present, reached)
