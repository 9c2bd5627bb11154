"""What a measurement ran on: a figure means little without it."""

from __future__ import annotations

import datetime
import os
import platform
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime

import re3
from re3.cores import usable_cores


@dataclass(frozen=True)
class Environment:
    """Machine, date and versions of a run.

    Attributes:
        cpu: name of the processor.
        cores: logical cores this process may use.
        load: processes that wanted a core in the last minute, before the run began: with more than
            a few tenths the speeds are not those of the machine; NaN where it is not known.
        system: operating system and architecture.
        date: ISO 8601 with offset, to the second.
        versions: package -> version.
    """

    cpu: str
    cores: int
    load: float
    system: str
    date: str
    versions: dict[str, str]

    @staticmethod
    def here() -> Environment:
        """The environment of this process, now."""
        return Environment(
            cpu=_cpu_name(),
            cores=usable_cores(),
            load=_load(),
            system=f"{platform.system()} {platform.machine()}",
            date=datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
            versions={
                "re3": re3.__version__,
                "python": platform.python_version(),
                "numpy": np.__version__,
                "opencv": cv2.__version__,
                "onnxruntime": onnxruntime.__version__,
            },
        )


def _cpu_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # Not Linux.
    return platform.processor() or platform.machine() or "unknown"


def _load() -> float:
    # Not on Windows.
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
