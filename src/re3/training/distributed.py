"""Many processes that train one network, each on its share of every batch.

`torchrun` starts them and says to each who it is. Without it there is one, which talks to nobody.
"""

from __future__ import annotations

import os
from datetime import timedelta

import torch
import torch.distributed
from torch import Tensor

from re3.training.errors import TrainingError
from re3.training.recipe import Recipe

PATIENCE = timedelta(hours=2)
"""The others wait that long for the first process, which validates alone."""


class Processes:
    """The processes that train together; this one alone by default.

    Attributes:
        rank: number of this process, from 0; the first one writes files and validates.
        count: of processes.
        local_rank: number of this process on its machine, which is that of its GPU.
    """

    def __init__(self, rank: int = 0, count: int = 1, local_rank: int = 0) -> None:
        self.rank, self.count, self.local_rank = rank, count, local_rank

    @property
    def first(self) -> bool:
        """Whether this is the process that writes files and speaks to people."""
        return self.rank == 0

    def share(self, total: int) -> slice:
        """Which of so many sequences, a multiple of `count`, are this process's."""
        part = total // self.count
        return slice(self.rank * part, (self.rank + 1) * part)

    def sum(self, values: Tensor) -> Tensor:
        """The sum over all processes, without gradients."""
        values = values.detach()
        if self.count > 1:
            values = values.clone()
            torch.distributed.all_reduce(values)
        return values

    def any(self, flag: bool) -> bool:
        """Whether it is so in any process."""
        return bool(self.sum(torch.tensor(float(flag), device=self._device())))

    def _device(self) -> str:
        if self.count > 1 and torch.distributed.get_backend() == "nccl":
            return f"cuda:{self.local_rank}"
        return "cpu"


ALONE = Processes()


def join_processes(device: str = "cpu") -> Processes:
    """The processes that `torchrun` started with this one, or this one alone.

    Args:
        device: `cpu` for the gloo backend, `cuda` for nccl.
    """
    if "TORCHELASTIC_RUN_ID" not in os.environ and "RANK" not in os.environ:
        return ALONE
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    backend = "gloo"
    if device == "cuda":
        torch.cuda.set_device(local_rank)
        backend = "nccl"
    torch.distributed.init_process_group(backend, timeout=PATIENCE)
    return Processes(torch.distributed.get_rank(), torch.distributed.get_world_size(), local_rank)


def leave_processes(processes: Processes) -> None:
    """Part with the others."""
    if processes is not ALONE:
        torch.distributed.destroy_process_group()


def check_shares(recipe: Recipe, processes: Processes) -> None:
    """See that every batch of a recipe splits among the processes.

    Raises:
        TrainingError: one does not.
    """
    for phase in recipe.phases:
        if phase.batch % (processes.count * recipe.parts):
            raise TrainingError(
                f"a batch of {phase.batch} sequences does not split among {processes.count} "
                f"processes with {recipe.parts} parts each; choose a number of processes that "
                "divides every batch, or a recipe with larger ones"
            )
