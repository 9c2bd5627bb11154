"""The process that writes an annotated video: `python -m re3.apps.server.export_worker JOB`.

JOB is a JSON file, as `re3.apps.server.exports` writes it. The process decodes the video, draws and
encodes; it ends with the file, and all its memory with it. On standard output it sends messages as
in `re3.apps.server.wire`: {"frames": how many are written} now and then, and at the end
{"finished": true} or {"error": text, "errno": number or null}.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import IO, Any

from re3.apps.server.decoder import Decoder, limit_memory
from re3.apps.server.limits import Limits
from re3.apps.server.wire import write_message
from re3.result import Result, Status
from re3.video import SourceError, VideoWriter, draw_results

TOLD_EVERY = 0.2
"""Seconds between two messages of progress."""

CACHE_BYTES = 1 << 20
"""Each frame is needed once."""


def write(job: dict[str, Any], answers: IO[bytes]) -> None:
    """Write the video of a job, and send progress.

    Raises:
        ValueError: a frame cannot be read any more.
        OSError: the file cannot be written.
    """
    decoder = Decoder(Limits(**job["limits"]), CACHE_BYTES)
    source = Path(job["source"])
    decoder.open(source, source.is_dir())
    colours = {int(each): tuple(colour) for each, colour in job["colours"].items()}
    told = time.monotonic()
    pictures = source.is_dir()
    aspect = decoder.pixel_aspect
    with VideoWriter(
        job["path"], Fraction(*job["fps"]), tuple(job["size"]), pixel_aspect=aspect
    ) as writer:
        for written, (index, found) in enumerate(job["frames"]):
            frame = decoder.read(index)
            if frame is None:
                raise SourceError(f"frame {index} cannot be read any more")
            results = [_result(each, index) for each in found]
            # Pictures have no times of their own: those of a camera come at the rate of the job.
            moment = None if pictures else frame.timestamp
            writer.write(draw_results(frame.image, results, colours), moment)
            if time.monotonic() - told > TOLD_EVERY:
                told = time.monotonic()
                write_message(answers, {"frames": written + 1})


def _result(values: list[Any], index: int) -> Result:
    identity, name, box, score, status = values
    x, y, w, h = box
    return Result((x, y, w, h), score, Status(status), index, identity, name)


def main() -> None:
    """Entry point."""
    limit_memory()
    # Whatever a library prints must not get between the messages.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with suppress(BrokenPipeError):
        try:
            write(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), answers)
        except (ValueError, OSError, MemoryError) as error:
            number = getattr(error, "errno", None) or getattr(error.__cause__, "errno", None)
            write_message(answers, {"error": str(error) or "out of memory", "errno": number})
        else:
            write_message(answers, {"finished": True})


if __name__ == "__main__":
    main()
