"""Ctrl-C, SIGTERM and a closed terminal as a wish to stop, honoured between two frames."""

from __future__ import annotations

import os
import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self

NAMES = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "the closing of the terminal"}
"""What asks to stop, for people, by signal."""


class StopSignals:
    """While the block runs, a signal asks to stop instead of tearing a frame apart.

    A second Ctrl-C interrupts at once (a stream may be long in giving its next frame), except
    once `finishing` is set: files are then being completed. Outside the main thread, where Python
    takes no signals, nothing changes. SIGHUP, which comes when the terminal is closed, is left
    alone where it is ignored already, as under `nohup`. What is written to a closed terminal is
    dropped.

    Attributes:
        received: the first signal, or None.
        finishing: set it when the work is over and files are being completed.
    """

    # Windows has no SIGHUP.
    SIGNALS = tuple(getattr(signal, name) for name in NAMES if hasattr(signal, name))

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self.finishing = False
        self._earlier: dict[signal.Signals, Any] = {}
        self._terminals: list[int] = []

    def __call__(self) -> bool:
        """Whether to stop."""
        return self.received is not None

    @property
    def name(self) -> str:
        """What stopped the run, for people."""
        return NAMES[(self.received or signal.SIGINT).name]

    @property
    def exit_code(self) -> int:
        """As shells have it: 130 for Ctrl-C, 143 for SIGTERM, 129 for a closed terminal."""
        return 128 + (self.received or signal.SIGINT)

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._terminals = [fd for fd in (1, 2) if os.isatty(fd)]
            self._earlier = {
                one: signal.signal(one, self._handle)
                for one in self.SIGNALS
                if one.name != "SIGHUP" or signal.getsignal(one) != signal.SIG_IGN
            }
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for one, handler in self._earlier.items():
            signal.signal(one, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if number == getattr(signal, "SIGHUP", None):
            self._leave_terminal()
        if self.received is not None and not self.finishing:
            raise KeyboardInterrupt
        self.received = self.received or signal.Signals(number)

    def _leave_terminal(self) -> None:
        """Let what is said go nowhere: writing to a terminal that is gone raises."""
        for descriptor in self._terminals:
            if not os.isatty(descriptor):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, descriptor)
                os.close(nowhere)
