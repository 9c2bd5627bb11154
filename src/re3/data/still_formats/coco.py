"""COCO: `annotations/instances_<split>.json` and the images in `<split>/`.

Lin et al.: Microsoft COCO, ECCV 2014; and exports in its form, such as `_annotations.coco.json`
beside the images. Boxes are `[x, y, width, height]`, 0-based. A segmentation is a list of polygons,
or runs of pixels column by column, as numbers or as COCO's text; it becomes the object's mask.
Crowds (`iscrowd`) are no single object and are left out.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from re3.data.formats.files import dataset_name, files_with, subfolders
from re3.data.masks import Mask, Polygons, Runs
from re3.data.stills import Still, make_still

LAYOUT = "annotations/instances_<split>.json and <split>/ with images, or a .coco.json beside them"

_PREFIX = "instances_"
_EXPECTED = (
    '{"images": [{"id", "file_name", "width", "height"}], '
    '"annotations": [{"image_id", "bbox": [x, y, w, h], "segmentation"}]}'
)


def detect(folder: Path) -> bool:
    """Whether the folder has annotations of instances."""
    return bool(_documents(folder))


def read(folder: Path, smallest_share: float) -> list[Still]:
    """The pictures of every split with an object large enough."""
    return [
        still
        for document in _documents(folder)
        for still in _read(document, folder, smallest_share)
    ]


def _documents(folder: Path) -> list[Path]:
    named = [
        path
        for path in files_with(folder / "annotations", ".json")
        if path.name.startswith("instances")
    ]
    return named + [path for path in files_with(folder, ".json") if _is_export(path)]


def _is_export(path: Path) -> bool:
    """Whether a file beside the images is in COCO's form, by its name or its first keys."""
    if path.name.endswith(".coco.json"):
        return True
    if path.name.startswith("."):
        return False
    with path.open("rb") as file:
        head = file.read(4096)
    return b'"images"' in head and b'"file_name"' in head


def _read(document: Path, folder: Path, smallest_share: float) -> list[Still]:
    try:
        content = json.loads(document.read_bytes())
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
        root = _images_of(document, folder, split, images[next(iter(objects))]["file_name"])
        dataset = dataset_name(folder)
        if split != document.stem:
            dataset = f"{dataset}-{split}"
        stills = []
        for key, found in objects.items():
            image = images[key]
            still = make_still(
                root / image["file_name"],
                [item["bbox"] for item in found],
                float(image["width"]) * float(image["height"]),
                smallest_share,
                masks=[_mask(item.get("segmentation")) for item in found],
                dataset=dataset,
            )
            if still is not None:
                stills.append(still)
    except (KeyError, TypeError, ValueError) as error:
        told = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{document}: {told}; expected {_EXPECTED}") from error
    missing = [still.image for still in stills if not still.image.is_file()]
    if missing:
        raise FileNotFoundError(
            f"{len(missing)} of {len(stills)} images of {document} are missing, first "
            f"{missing[0]}; restore them or remove them from the file"
        )
    return stills


def _images_of(document: Path, folder: Path, split: str, name: str) -> Path:
    """The folder that names of images are relative to: the first of those in use that has one."""
    roots = [folder / split, folder / "images" / split, folder / "images", document.parent, folder]
    # Some exports leave the year out of the folder's name, or name it as they like.
    roots += [path for path in subfolders(folder) if path not in roots]
    for root in roots:
        if (root / name).is_file():
            return root
    raise FileNotFoundError(
        f"{document} names an image {name}, which is in none of "
        + ", ".join(str(root) for root in dict.fromkeys(roots))
    )


def _mask(segmentation: Any) -> Mask | None:
    if isinstance(segmentation, dict):
        counts, (height, width) = segmentation["counts"], segmentation["size"]
        runs = counts if isinstance(counts, str) else tuple(int(count) for count in counts)
        return Runs(runs, (int(height), int(width)))
    if not segmentation:
        return None
    rings = [np.array(ring, dtype=np.float32) for ring in segmentation]
    for ring in rings:
        if ring.ndim != 1 or len(ring) < 6 or len(ring) % 2:
            raise ValueError(f"a polygon of {ring.size} numbers; expected x, y of 3 points or more")
    return Polygons(tuple(ring.reshape(-1, 2) for ring in rings))
