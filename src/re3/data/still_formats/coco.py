"""COCO: `annotations/instances_<split>.json` and the images in `<split>/`.

Lin et al.: Microsoft COCO, ECCV 2014; and exports in its form, such as `_annotations.coco.json`
beside the images. Boxes are `[x, y, width, height]`, 0-based. A segmentation is a list of polygons,
or runs of pixels column by column, as numbers or as COCO's text; it becomes the object's mask.
Where it encloses nothing (`[[]]`, two points) or does not fit the picture, the object has its box
alone, and a note says so. Crowds (`iscrowd`) are no single object and are left out.
"""

from __future__ import annotations

import json
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from re3.data.formats.files import dataset_name, files_with, subfolders
from re3.data.masks import Mask, Polygons, Runs, run_lengths
from re3.data.still_formats.picture import Picture, PictureEntry, boxes_array

LAYOUT = "annotations/instances_<split>.json and <split>/ with images, or a .coco.json beside them"

_PREFIX = "instances_"
_LOOKED_FOR = 20
"""Images that are looked for before their folder is taken to be missing."""
_EXPECTED = (
    '{"images": [{"id", "file_name", "width", "height"}], '
    '"annotations": [{"image_id", "bbox": [x, y, w, h], "segmentation"}]}'
)


def detect(folder: Path) -> bool:
    """Whether the folder has annotations of instances."""
    return bool(_documents(folder))


def entries(folder: Path) -> list[PictureEntry]:
    """The pictures of every split that have an object.

    Raises:
        FileNotFoundError: the images lie in none of the usual places.
        ValueError: a file is not COCO's, or holds results instead of annotations.
    """
    return [entry for document in _documents(folder) for entry in _entries(document, folder)]


def _documents(folder: Path) -> list[Path]:
    named = [
        path
        for path in files_with(folder / "annotations", ".json")
        if path.name.startswith("instances")
    ]
    beside = [path for path in files_with(folder, ".json") if _is_export(path)]
    # Results are looked at only where there is nothing else: they lie beside annotations, too.
    if named or beside:
        return named + beside
    others = [*files_with(folder / "annotations", ".json"), *files_with(folder, ".json")]
    return [path for path in others if _is_results(_head(path))]


def _is_export(path: Path) -> bool:
    """Whether a file beside the images is in COCO's form, by its name or its first keys."""
    if path.name.endswith(".coco.json"):
        return True
    head = _head(path)
    return b'"images"' in head and b'"file_name"' in head


def _is_results(head: bytes) -> bool:
    """Whether a file begins like COCO's results: a list of boxes with the ids of their images."""
    return head.lstrip().startswith(b"[") and b'"image_id"' in head and b'"bbox"' in head


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(4096).removeprefix(b"\xef\xbb\xbf")


def _entries(document: Path, folder: Path) -> list[PictureEntry]:
    try:
        content = json.loads(document.read_bytes())
        if isinstance(content, list):
            what = "a list"
            if all(isinstance(item, dict) and "image_id" in item for item in content):
                what = "COCO's results, a list of found boxes"
            raise ValueError(f"it holds {what}, not annotations")
        images = {image["id"]: image for image in content["images"]}
        objects: dict[Any, list[dict[str, Any]]] = {}
        for annotation in content["annotations"]:
            if annotation["image_id"] not in images:
                raise ValueError(
                    f"an object of image {annotation['image_id']!r}, which is not there"
                )
            if not annotation.get("iscrowd"):
                objects.setdefault(annotation["image_id"], []).append(annotation)
        if not objects:
            return []
        split = document.stem.removeprefix(_PREFIX)
        names = [str(images[key]["file_name"]) for key in islice(objects, _LOOKED_FOR)]
        tracked = any("track_id" in item and "status" in item for item in content["annotations"])
        root = _images_of(document, folder, split, names, tracked)
        dataset = dataset_name(folder)
        if split != document.stem:
            dataset = f"{dataset}-{split}"
        return [
            PictureEntry(
                str(images[key]["file_name"]),
                partial(_read, document, root, images[key], found, dataset),
            )
            for key, found in objects.items()
        ]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{document}: {_told(error)}; expected {_EXPECTED}") from error


def _read(
    document: Path, root: Path, image: dict[str, Any], found: list[dict[str, Any]], dataset: str
) -> Picture:
    boxes, masks, notes = [], [], []
    where = f"{document}, image {image['file_name']}"
    try:
        size = (float(image["width"]), float(image["height"]))
        for item in found:
            where = f"{document}, annotation {item.get('id', '?')} of {image['file_name']}"
            boxes.append(_box(item["bbox"]))
            try:
                masks.append(_mask(item.get("segmentation"), size))
            except (KeyError, TypeError, ValueError) as error:
                masks.append(None)
                notes.append(f"{where}: no outline ({_told(error)}); its box is used")
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: {_told(error)}; expected {_EXPECTED}") from error
    return Picture(
        root / image["file_name"],
        boxes_array(boxes),
        tuple(masks),
        size,
        document,
        dataset=dataset,
        notes=tuple(notes),
    )


def _told(error: Exception) -> str:
    return f"no {error}" if isinstance(error, KeyError) else str(error)


def _images_of(document: Path, folder: Path, split: str, names: list[str], tracked: bool) -> Path:
    """The folder that names of images are relative to: the first of those in use that has one.

    Args:
        document: the annotations.
        folder: of the dataset.
        split: the part of it that they are of.
        names: of some images; one may be missing.
        tracked: they look like what `re3 track` writes, for the message.
    """
    roots = [folder / split, folder / "images" / split, folder / "images", document.parent, folder]
    # Some exports leave the year out of the folder's name, or name it as they like.
    roots += [path for path in subfolders(folder) if path not in roots]
    for name in names:
        for root in roots:
            if (root / name).is_file():
                return root
    raise FileNotFoundError(
        f"{document} names an image {names[0]}, which is in none of "
        + ", ".join(str(root) for root in dict.fromkeys(roots))
        + ("; it holds results of `re3 track`: a video's frames are no files" if tracked else "")
    )


def _box(numbers: Any) -> list[float]:
    box = [float(number) for number in numbers]
    if len(box) != 4:
        raise ValueError(f"a bbox of {len(box)} numbers")
    return box


def _mask(segmentation: Any, size: tuple[float, float]) -> Mask | None:
    """The outline of an object; None where none is given.

    Args:
        segmentation: as it stands in the file.
        size: width and height of the picture.

    Raises:
        KeyError, TypeError, ValueError: it encloses nothing, or is not well formed.
    """
    if isinstance(segmentation, dict):
        return _runs(segmentation, size)
    if not segmentation:
        return None
    if not isinstance(segmentation, list):
        raise ValueError(f"a segmentation {str(segmentation)[:40]!r}")
    if not isinstance(segmentation[0], list):
        # Some exports write the numbers of a single polygon without the list around it.
        segmentation = [segmentation]
    rings = [np.array(ring, dtype=np.float32) for ring in segmentation]
    # Others have empty ones, or points and lines, beside what encloses the object.
    usable = [ring for ring in rings if _encloses(ring)]
    if not usable:
        sizes = " and ".join(str(ring.size) for ring in rings)
        raise ValueError(f"a polygon of {sizes} numbers where x, y of 3 points are needed")
    return Polygons(tuple(ring.reshape(-1, 2) for ring in usable))


def _encloses(ring: np.ndarray) -> bool:
    return bool(
        ring.ndim == 1 and len(ring) >= 6 and len(ring) % 2 == 0 and np.isfinite(ring).all()
    )


def _runs(segmentation: dict[str, Any], size: tuple[float, float]) -> Runs:
    counts, (height, width) = segmentation["counts"], segmentation["size"]
    if (float(width), float(height)) != size:
        raise ValueError(
            f"runs for {width} x {height} pixels in a picture of {size[0]:g} x {size[1]:g}"
        )
    lengths = run_lengths(counts) if isinstance(counts, str) else [int(count) for count in counts]
    if sum(lengths) != int(height) * int(width) or min(lengths, default=0) < 0:
        raise ValueError(f"runs {sum(lengths)} pixels long in a picture of {width} x {height}")
    runs = counts if isinstance(counts, str) else tuple(lengths)
    return Runs(runs, (int(height), int(width)))
