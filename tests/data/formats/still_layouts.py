"""Small collections of stills in their real layouts, for the tests of readers.

Pictures are 40 x 30 pixels, noise with a bright object; a builder writes them into a folder and
returns the folder. The large object covers a quarter of the picture, the small one less than the
hundredth that the paper asks for.
"""

import json
from pathlib import Path

import cv2
import layouts
import numpy as np

WIDTH, HEIGHT = 40, 30
LARGE = (10, 5, 20, 15)
SMALL = (1, 1, 3, 3)


def picture(path: Path, *boxes, width=WIDTH, height=HEIGHT) -> Path:
    """An image with bright boxes_xywh on dark noise."""
    image = np.random.default_rng(0).integers(0, 60, (height, width, 3), dtype=np.uint8)
    for x, y, w, h in boxes:
        image[y : y + h, x : x + w] = (60, 180, 250)
    path.parent.mkdir(parents=True, exist_ok=True)
    _, data = cv2.imencode(path.suffix.lower(), image)
    path.write_bytes(data.tobytes())
    return path


def mask(path: Path, box=LARGE, value=255, width=WIDTH, height=HEIGHT) -> Path:
    """A grey PNG image of `value` in the box."""
    x, y, w, h = box
    image = np.zeros((height, width), np.uint8)
    image[y : y + h, x : x + w] = value
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image)
    return path


def boxes(folder: Path) -> Path:
    picture(folder / "images" / "a.jpg", LARGE, SMALL)
    objects = [{"label": "thing", "box_xywh": box} for box in (LARGE, SMALL)]
    entry = {"image": "images/a.jpg", "mask": None, "width": WIDTH, "height": HEIGHT}
    layouts.text(folder / "boxes.jsonl", json.dumps({**entry, "objects": objects}))
    return folder


def xml(path: Path, *found, size=(WIDTH, HEIGHT), first_pixel=0) -> Path:
    """An annotation in VOC's form of boxes_xywh, corners inclusive."""
    objects = "".join(
        f"<object><name>dog</name><bndbox><xmin>{x + first_pixel}</xmin>"
        f"<ymin>{y + first_pixel}</ymin><xmax>{x + w - 1 + first_pixel}</xmax>"
        f"<ymax>{y + h - 1 + first_pixel}</ymax></bndbox></object>"
        for x, y, w, h in found
    )
    return layouts.text(
        path,
        f"<annotation><size><width>{size[0]}</width><height>{size[1]}</height></size>"
        f"{objects}</annotation>",
    )


def imagenet_det(folder: Path) -> Path:
    inner = Path("DET/train/ILSVRC2013_train/n01440764")
    picture(folder / "Data" / inner / "n01440764_10.JPEG", LARGE, SMALL)
    xml(folder / "Annotations" / inner / "n01440764_10.xml", LARGE, SMALL)
    picture(folder / "Data/DET/val/ILSVRC2012_val_00000001.JPEG")
    xml(folder / "Annotations/DET/val/ILSVRC2012_val_00000001.xml")  # an image without objects
    return folder


def coco_document(*annotations, name="000000000009.jpg"):
    return {
        "info": {"year": 2017},
        "images": [{"id": 9, "file_name": name, "width": WIDTH, "height": HEIGHT}],
        "annotations": [{"image_id": 9, "category_id": 1, "iscrowd": 0, **a} for a in annotations],
        "categories": [{"id": 1, "name": "dog"}],
    }


def coco(folder: Path) -> Path:
    picture(folder / "train2017" / "000000000009.jpg", LARGE, SMALL)
    x, y, w, h = LARGE
    ring = [x, y, x + w, y, x + w, y + h, x, y + h]
    document = coco_document(
        {"bbox": list(LARGE), "segmentation": [ring]},
        {"bbox": list(SMALL), "segmentation": []},
    )
    layouts.text(folder / "annotations" / "instances_train2017.json", json.dumps(document))
    return folder


def voc(folder: Path) -> Path:
    picture(folder / "JPEGImages" / "2007_000032.jpg", LARGE, SMALL)
    xml(folder / "Annotations" / "2007_000032.xml", SMALL, LARGE, first_pixel=1)
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    x, y, w, h = LARGE
    ids[y - 1 : y + h + 1, x - 1 : x + w + 1] = 255  # the border between objects
    ids[y : y + h, x : x + w] = 2
    palette = [(i, 255 - i, i * 7 % 256) for i in range(256)]
    layouts.palette_png(folder / "SegmentationObject" / "2007_000032.png", ids, palette)
    return folder


def yolo_line(box, kind=0):
    x, y, w, h = box
    numbers = ((x + w / 2) / WIDTH, (y + h / 2) / HEIGHT, w / WIDTH, h / HEIGHT)
    return " ".join([str(kind), *(f"{number:.6f}" for number in numbers)])


def yolo(folder: Path) -> Path:
    picture(folder / "images" / "train" / "a.jpg", LARGE, SMALL)
    picture(folder / "images" / "train" / "background.jpg")
    layouts.text(folder / "labels" / "train" / "a.txt", yolo_line(LARGE), yolo_line(SMALL, 3))
    layouts.text(folder / "labels" / "train" / "background.txt")
    layouts.text(folder / "data.yaml", "names: [dog]")
    return folder


def masks(folder: Path) -> Path:
    picture(folder / "DUTS-TR-Image" / "a.jpg", LARGE)
    mask(folder / "DUTS-TR-Mask" / "a.png")
    return folder


def images(folder: Path) -> Path:
    picture(folder / "holiday" / "a.jpg")
    return folder


BUILDERS = {
    "boxes": boxes,
    "imagenet-det": imagenet_det,
    "coco": coco,
    "voc": voc,
    "yolo": yolo,
    "masks": masks,
    "images": images,
}
MASKED = ("coco", "voc", "masks")
