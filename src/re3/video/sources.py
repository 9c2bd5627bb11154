"""From what a user types to a source of frames."""

from __future__ import annotations

import difflib
import glob
from pathlib import Path

from re3.video.base import SourceError, VideoSource
from re3.video.camera import CameraSource
from re3.video.containers import STREAM_PREFIXES, ContainerSource
from re3.video.images import IMAGE_SUFFIXES, ImageSource, is_image, sorted_images


def open_source(spec: str | int | Path, *, start_frame: int = 0) -> VideoSource:
    """Open a source of frames.

    Args:
        spec: a video file; a folder of images or a glob such as `shots/*.png` (natural order:
            `img2` before `img10`); a camera's index (0, or "0"; a `Path` is never a camera); an
            RTSP or HTTP stream.
        start_frame: frames before this one are skipped.

    Raises:
        SourceError: nothing there, nothing to read, or fewer frames than `start_frame`.
            While frames are read, it is raised at an image or packet that is broken.
    """
    if start_frame < 0:
        raise SourceError(f"start frame is {start_frame}; expected 0 or more")
    if isinstance(spec, int) or (isinstance(spec, str) and spec.isdecimal()):
        return CameraSource(int(spec), start_frame)
    text = str(spec)
    if text.startswith(STREAM_PREFIXES):
        return ContainerSource(text, start_frame)
    path = Path(text)
    if path.is_dir():
        return _open_folder(path, start_frame)
    if path.exists():
        if is_image(path):
            return ImageSource(path.name, [path], start_frame)
        return ContainerSource(text, start_frame)
    if glob.has_magic(text):
        return _open_glob(text, start_frame)
    raise SourceError(
        f"{text!r} does not exist; expected a video file, a folder or glob of images, a camera "
        f"index such as 0, or a stream such as rtsp://host/path{_suggestion(path)}"
    )


def _open_folder(folder: Path, start_frame: int) -> ImageSource:
    images = sorted_images(folder.iterdir())
    if not images:
        raise SourceError(
            f"folder {folder} holds no images; expected files ending in "
            f"{', '.join(sorted(IMAGE_SUFFIXES))}, or give a video file"
        )
    return ImageSource(folder.resolve().name, images, start_frame)


def _open_glob(pattern: str, start_frame: int) -> ImageSource:
    matches = [Path(match) for match in glob.glob(pattern, recursive=True)]  # noqa: PTH207
    images = sorted_images(matches)
    if not matches:
        raise SourceError(f"no file matches {pattern!r}; check the pattern, and quote it")
    if not images:
        raise SourceError(
            f"none of the {len(matches)} files that match {pattern!r} is an image; expected files "
            f"ending in {', '.join(sorted(IMAGE_SUFFIXES))}; give a video file by its own path"
        )
    return ImageSource(pattern, images, start_frame)


def _suggestion(missing: Path) -> str:
    """What may have been meant, as the end of a message."""
    folder = missing.parent
    if not folder.is_dir():
        return f" (nor does the folder {str(folder)!r})"
    near = difflib.get_close_matches(missing.name, sorted(p.name for p in folder.iterdir()), n=3)
    return (
        f"; did you mean {' or '.join(repr(str(folder / name)) for name in near)}?" if near else ""
    )
