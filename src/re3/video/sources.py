"""From what a user types to a source of frames."""

from __future__ import annotations

import difflib
import glob
import re
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

from re3.video.addresses import STREAM_SCHEMES, is_stream, scheme_of, without_password
from re3.video.base import SourceError, VideoSource
from re3.video.camera import CameraSource
from re3.video.containers import ContainerSource
from re3.video.grey_levels import Range
from re3.video.image_lists import IMAGE_SUFFIXES, is_image, refuse_twins, sorted_images
from re3.video.images import ImageSource, holds_several_frames, open_image


def open_source(
    spec: str | int | Path,
    *,
    start_frame: int = 0,
    skip_broken: bool = True,
    value_range: Range | None = None,
) -> VideoSource:
    """Open a source of frames.

    Args:
        spec: a video file; an image file, of several frames as well (TIFF stack, animated WebP or
            PNG, GIF); a folder of images or a glob such as `shots/*.png` (natural order: `img2`
            before `img10`); a camera's index (0, or "0"; a `Path` is never a camera); the address
            of a network stream.
        start_frame: frames before this one are skipped.
        skip_broken: skip packets of a video file that cannot be decoded and count them in
            `VideoSource.skipped`; False raises there, for footage whose frames have annotations.
        value_range: lowest and highest value of 16-bit pixels, which become 0 and 255. Default:
            all 16 bits where the first frame spans half of them or more, else the range of the
            first frame, which `VideoSource.notes` then gives.

    Raises:
        SourceError: nothing there, nothing to read, fewer frames than `start_frame`, or an empty
            range. While frames are read, it is raised at an image that is broken.
    """
    if start_frame < 0:
        raise SourceError(f"start frame is {start_frame}; expected 0 or more")
    if value_range is not None and not 0 <= value_range[0] < value_range[1] <= 65535:
        raise SourceError(
            f"value range is {value_range[0]:g} to {value_range[1]:g}; expected the lowest and the "
            "highest 16-bit value, from 0 to 65535, the lowest first"
        )
    if isinstance(spec, int) or (isinstance(spec, str) and re.fullmatch(r"-?\d+", spec)):
        return CameraSource(int(spec), start_frame)
    text = str(spec)
    if not text:
        raise SourceError(f"the source is empty; {_EXPECTED}, or . for the images of this folder")
    if is_stream(text):
        return ContainerSource(text, start_frame)
    if (scheme := scheme_of(text)) is not None:
        if scheme != "file":
            raise SourceError(
                f"{without_password(text)} begins with {scheme}://; expected one of "
                f"{', '.join(f'{each}://' for each in STREAM_SCHEMES)}, or the path of a file"
            )
        text = url2pathname(urlsplit(text).path)
    path = Path(text)
    if path.is_dir():
        return _open_folder(path, start_frame, value_range)
    if path.exists():
        if is_image(path) or holds_several_frames(path):
            return open_image(path, start_frame, value_range=value_range)
        return ContainerSource(text, start_frame, skip_broken=skip_broken, value_range=value_range)
    if glob.has_magic(text):
        return _open_glob(text, start_frame, value_range)
    raise SourceError(f"{text!r} does not exist; {_EXPECTED}{_suggestion(path)}")


_EXPECTED = (
    "expected a video file, a folder or glob of images, a camera index such as 0, or a stream such "
    "as rtsp://host/path"
)


def _open_folder(folder: Path, start_frame: int, value_range: Range | None) -> ImageSource:
    images = sorted_images(folder.iterdir())
    if not images:
        raise SourceError(
            f"folder {folder} holds no images; expected files ending in "
            f"{', '.join(sorted(IMAGE_SUFFIXES))}, or give a video file"
        )
    refuse_twins(images)
    return ImageSource(folder.resolve().name, images, start_frame, value_range=value_range)


def _open_glob(pattern: str, start_frame: int, value_range: Range | None) -> ImageSource:
    matches = [Path(match) for match in glob.glob(pattern, recursive=True)]  # noqa: PTH207
    images = sorted_images(matches)
    if not matches:
        raise SourceError(f"no file matches {pattern!r}; check the pattern, and quote it")
    if not images:
        raise SourceError(
            f"none of the {len(matches)} files that match {pattern!r} is an image; expected files "
            f"ending in {', '.join(sorted(IMAGE_SUFFIXES))}; give a video file by its own path"
        )
    refuse_twins(images)
    return ImageSource(pattern, images, start_frame, value_range=value_range)


def _suggestion(missing: Path) -> str:
    """What may have been meant, as the end of a message."""
    folder = missing.parent
    if not folder.is_dir():
        return f" (nor does the folder {str(folder)!r})"
    near = difflib.get_close_matches(missing.name, sorted(p.name for p in folder.iterdir()), n=3)
    return (
        f"; did you mean {' or '.join(repr(str(folder / name)) for name in near)}?" if near else ""
    )
