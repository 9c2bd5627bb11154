"""Ctrl-C and SIGTERM as a wish to stop, honoured between two frames."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class StopSignals:
    """While the block runs, a signal asks to stop instead of tearing a frame apart.

    A second Ctrl-C interrupts at once (a stream may be long in giving its next frame), except
    once `finishing` is set: files are then being completed. Outside the main thread, where Python
    takes no signals, nothing changes.

    Attributes:
        received: the first signal, or None.
        finishing: set it when the work is over and files are being completed.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self.finishing = False
        self._earlier: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Whether to stop."""
        return self.received is not None

    @property
    def name(self) -> str:
        """What stopped the run, for people."""
        return "SIGTERM" if self.received is signal.SIGTERM else "Ctrl-C"

    @property
    def exit_code(self) -> int:
        """As shells have it: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + (self.received or signal.SIGINT)

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._earlier = {one: signal.signal(one, self._handle) for one in self.SIGNALS}
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
        if self.received is not None and not self.finishing:
            raise KeyboardInterrupt
        self.received = self.received or signal.Signals(number)
