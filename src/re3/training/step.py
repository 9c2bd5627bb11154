"""One step of the optimiser: the pass with gradients over all steps of a roll-out at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from re3.network.base import Maps, Prediction, Seen, TrackingNetwork
from re3.training.device import Device
from re3.training.distributed import Processes
from re3.training.errors import TrainingError
from re3.training.loss import Losses, tracking_loss
from re3.training.recipe import Recipe
from re3.training.rollout import Rollout


@dataclass(frozen=True, eq=False)
class Learnt:
    """What a step of the optimiser saw and did.

    Attributes:
        rollout: what it learnt from.
        corners: `[steps * N, 4]`, predicted, on the CPU.
        losses: before the step.
        gradient_norm: before clipping.
        sources: loss of the sequences of each source, of this process's share.
    """

    rollout: Rollout
    corners: Tensor
    losses: Losses
    gradient_norm: float
    sources: dict[str, float] = field(default_factory=dict)


class NotFinite(ArithmeticError):
    """A loss or a gradient that is not a finite number; nothing was changed.

    Attributes:
        rollout, corners, losses: as in `Learnt`.
    """

    def __init__(self, what: str, rollout: Rollout, corners: Tensor, losses: Losses) -> None:
        super().__init__(what)
        self.rollout, self.corners, self.losses = rollout, corners, losses


class Learner:
    """Takes steps of the optimiser.

    Args:
        network: on the device; trained in place.
        recipe: of the loss and the optimiser.
        optimizer: of all parameters of the network that need gradients.
        device: to compute on.
        processes: that share every batch.
    """

    def __init__(
        self,
        network: TrackingNetwork,
        recipe: Recipe,
        optimizer: torch.optim.Optimizer,
        device: Device,
        processes: Processes,
    ) -> None:
        self.network, self.recipe, self.optimizer = network, recipe, optimizer
        self.device, self.processes = device, processes
        self.scaler = device.scaler()
        self.unroll: nn.Module = _Unroll(network)
        if processes.count > 1:
            self.unroll = DistributedDataParallel(self.unroll)
        if device.compiled:
            # Batches of a phase are of one size: a graph for each, none for sizes in general.
            self.unroll.compile(dynamic=False)

    def learn(self, rollout: Rollout) -> Learnt:
        """One step of the optimiser from this process's share of a batch.

        Raises:
            NotFinite: the loss or the gradient is not finite; in every process alike. A gradient
                that only the scaling of a float16 loss has made infinite passes: such a step is
                left out, and the next loss is scaled less.
        """
        device = self.device.torch
        current, previous = self._crops(rollout)
        with self.device.autocast():
            half = self.unroll(current, previous, rollout.looked.to(device), rollout.steps)
        output = _each(half, lambda values: values.float())  # in single precision
        losses = tracking_loss(
            output,
            rollout.targets.to(device),
            rollout.has_box.to(device),
            rollout.hidden.to(device),
            self.recipe.loss,
            self.processes,
            None if rollout.outlines is None else rollout.outlines.to(device),
        )
        corners = output.corners.detach().cpu()
        if not math.isfinite(losses.value):
            raise NotFinite(_where(losses, corners, rollout.steps), rollout, corners, losses)
        self.optimizer.zero_grad(set_to_none=True)
        self.scaler.scale(losses.total).backward()
        self.scaler.unscale_(self.optimizer)
        norm = self._clip()
        if not math.isfinite(norm) and not self.scaler.is_enabled():
            raise NotFinite(self._bad_gradients(norm), rollout, corners, losses)
        self.scaler.step(self.optimizer)
        self.scaler.update()
        return Learnt(rollout, corners, losses, norm, self._by_source(output, rollout))

    def _by_source(self, output: Prediction, rollout: Rollout) -> dict[str, float]:
        """The loss of each source's sequences alone, by the same formula."""
        found = {}
        for source in sorted(set(rollout.sources) - {""}):
            rows = rollout.rows(np.flatnonzero([name == source for name in rollout.sources]))
            if rollout.has_box[rows].any():
                found[source] = self._loss_of(output, rollout, rows)
        return found

    def _loss_of(self, output: Prediction, rollout: Rollout, rows: Tensor) -> float:
        with torch.no_grad():
            losses = tracking_loss(
                _each(output, lambda values: values[rows].cpu()),
                rollout.targets[rows],
                rollout.has_box[rows],
                rollout.hidden[rows],
                self.recipe.loss,
                outlines=None if rollout.outlines is None else rollout.outlines[rows],
            )
        return losses.value

    def _crops(self, rollout: Rollout) -> tuple[Maps | Tensor, Maps | Tensor | None]:
        """Current and previous crops on the device: maps, or pixels where the trunk learns."""
        device, before = self.device.torch, rollout.previous_images
        if self.recipe.learn_trunk:
            images = torch.from_numpy(rollout.images).to(device)
            return images, None if before is None else torch.from_numpy(before).to(device)
        previous = rollout.previous
        return _to(rollout.crops, device), None if previous is None else _to(previous, device)

    def _clip(self) -> float:
        limit = math.inf if self.recipe.gradient_norm is None else self.recipe.gradient_norm
        learnt = [p for p in self.network.parameters() if p.requires_grad]
        return float(torch.nn.utils.clip_grad_norm_(learnt, limit))

    def _bad_gradients(self, norm: float) -> str:
        names = [
            name
            for name, parameter in self.network.named_parameters()
            if parameter.grad is not None and not parameter.grad.isfinite().all()
        ]
        return f"the norm of the gradient is {norm}, not finite in {', '.join(names[:3])}"


def choose_parts(network: TrackingNetwork, recipe: Recipe) -> None:
    """Let only some parts of the head learn, which is all but the trunk; all where none is named.

    What draws outlines only learns where its loss counts.

    Raises:
        TrainingError: it has no such part.
    """
    parts, learns = network.parts(), recipe.learns
    if unknown := sorted(set(learns) - parts.keys()):
        raise TrainingError(
            f"the recipe's `learns` names {', '.join(unknown)}; expected parts of the head: "
            f"{', '.join(sorted(parts))}"
        )
    for name, part in parts.items():
        part.requires_grad_(not learns or name in learns)
    if network.outline_cells and not recipe.loss.outline:
        parts["outline"].requires_grad_(False)


class _Unroll(nn.Module):
    """The network over all steps, as one module: what DistributedDataParallel wraps."""

    def __init__(self, network: TrackingNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(
        self, current: Maps | Tensor, previous: Maps | Tensor | None, looked: Tensor, steps: int
    ) -> Prediction:
        """From trunk maps, or from uint8 crops where the trunk learns as well."""
        maps = self._maps(current)
        before = None if previous is None else self._maps(previous)
        return self.network.unroll(Seen(maps, before, looked), steps)

    def _maps(self, crops: Maps | Tensor) -> Maps:
        return self.network.features(crops) if isinstance(crops, Tensor) else crops


def _each(output: Prediction, change: Callable[[Tensor], Tensor]) -> Prediction:
    """The same of all that a network predicts."""
    said = {name: value for name, value in output._asdict().items() if value is not None}
    return Prediction(**{name: change(value) for name, value in said.items()})


def _to(maps: Maps, device: torch.device) -> Maps:
    return tuple(one.to(device) for one in maps)


def _where(losses: Losses, corners: Tensor, steps: int) -> str:
    """What is not finite, and in which sequence and step first."""
    terms = [name for name, value in losses.parts.items() if not math.isfinite(value)]
    text = f"the loss is {losses.value}: not finite in {', '.join(terms) or 'the sum'}"
    bad = (~corners.isfinite().all(dim=1)).nonzero()
    if len(bad):
        step, sequence = divmod(int(bad[0]), len(corners) // steps)
        text += f", and the corners of {len(bad)} of {len(corners)} crops, first of step {step} of"
        text += f" sequence {sequence}"
    return text
