"""Trackers of other programs over TraX, the protocol of the VOT toolkit.

TraX (Čehovin Zajc: TraX: The visual Tracking eXchange protocol and library, Neurocomputing 2017)
lets a program that has frames drive a tracker that runs in a process of its own, through the
tracker's standard input and output. `TraxTracker` is the side that has the frames; the side of
the tracker is `re3.apps.trax_server`.

Both need the package vot-trax, `pip install 're3[vot]'`, which is imported when it is used.
"""

from __future__ import annotations

import importlib
import math
import os
import shlex
import subprocess
import tempfile
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from re3.evaluation.vot_regions import Box, box_of

_PROTOCOL = "@@TRAX:"
_TOLD_LINES = 5
_TOLD_CHARACTERS = 500
_PATIENCE = 3.0
"""Seconds a tracker has to end after it was asked to."""


def import_trax() -> ModuleType:
    """The package `trax` of vot-trax.

    Raises:
        ModuleNotFoundError: it is missing; says how to install it.
    """
    try:
        # The client is a module that the package does not import by itself.
        importlib.import_module("trax.client")
        return importlib.import_module("trax")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "TraX needs the package vot-trax, which is not installed; "
            "install it with: pip install 're3[vot]'",
            name=error.name,
        ) from error


class TraxTracker:
    """A tracker in a process of its own, as a `re3.evaluation.peers.SequenceTracker`.

    The process is started at once and lives until `close`; every `init` starts the tracker anew
    in the same process. Frames go to it in memory where it takes them so, else as a PNG file,
    so the pixels are the same either way. It is a context manager that closes itself.

    Args:
        command: how to start the tracker: a line as for a shell, or its parts.
        timeout: seconds it may take to start, and to answer each request.
        environment: variables added to this process's.

    Raises:
        ModuleNotFoundError: the package vot-trax is missing.
        ValueError: no command, or the timeout is not above 0.
        OSError: the command cannot be started.
        RuntimeError: what was started does not speak TraX, takes no frames that can be sent, no
            box, or did not greet in time; says what it printed.
    """

    def __init__(
        self,
        command: str | Sequence[str],
        timeout: float = 30.0,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._trax = import_trax()
        parts = shlex.split(command) if isinstance(command, str) else list(command)
        if not parts:
            raise ValueError("no command; expected one that starts a tracker that speaks TraX")
        if not timeout > 0:
            raise ValueError(f"timeout is {timeout}; expected seconds above 0")
        self._command = shlex.join(parts)
        self._timeout = timeout
        self._printed = _Printed()
        self._over = False
        self._folder = tempfile.TemporaryDirectory(prefix="re3-trax-")
        self._client: Any = None
        self._process = subprocess.Popen(
            parts,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            # The library reads the pipe itself; Python must not take bytes from it.
            bufsize=0,
            env={**os.environ, "TRAX": "1", **(environment or {})},
        )
        try:
            self._client = self._ask(self._connect)
            self._name = str(self._client.tracker_name)
            self._transport = self._choose_transport()
        except BaseException:
            self.close()
            raise

    @property
    def name(self) -> str:
        """What the tracker calls itself; empty where it does not say."""
        return self._name

    def init(self, frame: NDArray[np.uint8], box_xywh: ArrayLike) -> None:
        """Start on a frame uint8 `[H, W, 3]` BGR with the object at a box `[4]`.

        Raises:
            RuntimeError: the tracker ended the session or did not answer in time.
        """
        region = self._region(tuple(float(value) for value in np.asarray(box_xywh)))
        image = self._image(frame)
        self._ask(lambda: self._client.initialize({"color": image}, [(region, {})], {}))

    def update(self, frame: NDArray[np.uint8]) -> tuple[Box, float]:
        """The object's box in the next frame and a score, 0..1.

        The score is the property `confidence` with which VOT's trackers say how sure they are, cut
        to 0..1; 1 where there is none. Of a polygon or a mask the box is the one around it.

        Raises:
            RuntimeError: the tracker ended the session, did not answer in time, or gave no box.
        """
        image = self._image(frame)
        status, _ = self._ask(lambda: self._client.frame({"color": image}, {}, []))
        if len(status) != 1:
            raise RuntimeError(f"tracker {self._command} gave {len(status)} objects; expected one")
        region, properties = status[0]
        return box_of(region), _confidence(properties.get("confidence"))

    def close(self) -> None:
        """End the tracker, by force if it does not end by itself within seconds."""
        self._over = True
        if self._client is not None:
            with _Watchdog(self._process, _PATIENCE):
                self._client.quit()
            self._let_go_of_client()
        # Closing the pipe tells a tracker that did not understand quit.
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def _let_go_of_client(self) -> None:
        """Free the library's session while the function it logs to is still there.

        vot-trax 4.0.2 frees the function first, and the session then calls it as it ends: a
        segmentation fault, now and then, after a tracker that was killed.
        """
        session = vars(self._client).pop("_handle", None)
        del session
        self._client = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _connect(self) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        return self._trax.client.Client(
            (self._process.stdin.fileno(), self._process.stdout.fileno()), log=self._printed
        )

    def _ask(self, request: Any) -> Any:
        """Make a request; what comes of it is an answer or a RuntimeError that says why."""
        if self._over:
            raise RuntimeError(f"tracker {self._command} is not running any more{self._printed}")
        try:
            with _Watchdog(self._process, self._timeout) as watchdog:
                return request()
        except self._trax.TraxException as error:
            self._over = True
            if watchdog.expired:
                raise RuntimeError(
                    f"tracker {self._command} did not answer within {self._timeout:g} s and was "
                    f"ended{self._printed}"
                ) from error
            raise RuntimeError(f"tracker {self._command}: {error}{self._printed}") from error

    def _choose_transport(self) -> str:
        formats = self._client.image_formats
        # There and back, a frame of 768 x 432 took 16, 29 and 45 ms.
        for transport in ("memory", "path", "buffer"):
            if transport in formats:
                break
        else:
            raise RuntimeError(
                f"tracker {self._command} takes images as {', '.join(formats) or 'nothing'}; "
                "expected one of memory, buffer and path"
            )
        if not {"rectangle", "polygon"} & set(self._client.region_formats):
            raise RuntimeError(
                f"tracker {self._command} takes objects as "
                f"{', '.join(self._client.region_formats) or 'nothing'}; expected rectangle or "
                "polygon"
            )
        return transport

    def _region(self, box: Sequence[float]) -> Any:
        x, y, w, h = box
        if "rectangle" in self._client.region_formats:
            return self._trax.Rectangle.create(x, y, w, h)
        return self._trax.Polygon.create([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])

    def _image(self, frame: NDArray[np.uint8]) -> Any:
        if self._transport == "memory":
            return self._trax.MemoryImage.create(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        # Level 1: the file is read once and thrown away.
        _, encoded = cv2.imencode(".png", frame, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if self._transport == "buffer":
            return self._trax.BufferImage.create(encoded.tobytes())
        path = Path(self._folder.name) / "frame.png"
        path.write_bytes(encoded.tobytes())
        return self._trax.FileImage.create(str(path))


def _confidence(given: str | None) -> float:
    try:
        value = float(given) if given is not None else 1.0
    except ValueError:
        return 1.0
    return 1.0 if math.isnan(value) else min(max(value, 0.0), 1.0)


class _Printed:
    """The last lines a tracker printed beside the protocol, to end a message with.

    The library hands over all that goes both ways, images in memory among it, in fragments.
    """

    def __init__(self) -> None:
        self._line = ""
        self._lines: deque[str] = deque(maxlen=_TOLD_LINES)

    def __call__(self, fragment: str) -> None:
        *ended, rest = (self._line + fragment).split("\n")
        self._lines += [line.strip() for line in ended if line.strip() and not _is_protocol(line)]
        # Of a long line of the protocol its beginning says enough.
        self._line = _PROTOCOL if _is_protocol(rest) else rest[-_TOLD_CHARACTERS:]

    def __str__(self) -> str:
        last = "" if _is_protocol(self._line) else self._line.strip()
        lines = [line[-_TOLD_CHARACTERS:] for line in (*self._lines, last) if line]
        return "; it printed: " + " | ".join(lines) if lines else ""


def _is_protocol(line: str) -> bool:
    return line.startswith(_PROTOCOL)


class _Watchdog:
    """Kill a process that is still at it after some seconds.

    The library waits for the tracker in C, where nothing but the end of the pipe wakes it.
    """

    def __init__(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        self.expired = False
        self._process = process
        self._timer = threading.Timer(seconds, self._kill)
        self._timer.daemon = True

    def _kill(self) -> None:
        self.expired = True
        self._process.kill()

    def __enter__(self) -> Self:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()
