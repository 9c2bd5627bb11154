"""What a process holds in RAM; needs nothing but Python, so that asking costs nothing."""

from __future__ import annotations

import sys
from pathlib import Path


def resident_bytes() -> int:
    """What this process holds in RAM now; where the system does not say, the most it ever held."""
    return _told("VmRSS") or peak_bytes()


def peak_bytes() -> int:
    """The most that this process ever held in RAM; 0 where that is not known (Windows)."""
    # getrusage counts what the parent held before it started this process as well.
    if told := _told("VmHWM"):
        return told
    try:
        import resource
    except ImportError:
        return 0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def _told(name: str) -> int:
    """Bytes that Linux tells of this process under a name; 0 elsewhere."""
    status = Path("/proc/self/status")
    if not status.is_file():
        return 0
    lines = status.read_text(encoding="ascii", errors="replace").splitlines()
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), 0)
