"""Small datasets in their real layouts, for the tests of readers.

Images are 32 x 24 pixels; a builder writes a clip or two into a folder and returns the folder.
"""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np

NAN = [np.nan] * 4


def images(folder: Path, count: int, *, first=1, digits=4, suffix=".jpg") -> Path:
    """Images with numbered names."""
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(count):
        picture = np.full((24, 32, 3), 10 * index % 256, np.uint8)
        _, data = cv2.imencode(suffix.lower(), picture)
        (folder / f"{first + index:0{digits}d}{suffix}").write_bytes(data.tobytes())
    return folder


def text(path: Path, *lines: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def boxes(count: int, separator: str = ",") -> list[str]:
    """Lines of boxes: box i is at (i + 1, 2) and 3 x 4 pixels."""
    return [separator.join(map(str, (i + 1, 2, 3, 4))) for i in range(count)]


def palette_png(path: Path, ids, palette) -> Path:
    """Write a PNG of palette indices `[H, W]`, as PIL does; OpenCV cannot."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    ids = np.asarray(ids, np.uint8)
    height, width = ids.shape
    rows = b"".join(b"\0" + row.tobytes() for row in ids)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0))
        + chunk(b"PLTE", np.asarray(palette, np.uint8).tobytes())
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )
    return path


def otb(folder: Path) -> Path:
    images(folder / "Bolt" / "img", 3)
    text(folder / "Bolt" / "groundtruth_rect.txt", *boxes(3))
    return folder


def vot(folder: Path) -> Path:
    images(folder / "ball" / "color", 3, digits=8)
    text(folder / "ball" / "groundtruth.txt", *boxes(3))
    text(folder / "list.txt", "ball")
    return folder


def got10k(folder: Path) -> Path:
    images(folder / "val" / "GOT-10k_Val_000001", 3, digits=8)
    text(folder / "val" / "GOT-10k_Val_000001" / "groundtruth.txt", *boxes(3))
    text(folder / "val" / "GOT-10k_Val_000001" / "absence.label", "0", "0", "1")
    text(folder / "val" / "list.txt", "GOT-10k_Val_000001")
    return folder


def lasot(folder: Path) -> Path:
    images(folder / "cat" / "cat-1" / "img", 3, digits=8)
    text(folder / "cat" / "cat-1" / "groundtruth.txt", *boxes(3))
    text(folder / "cat" / "cat-1" / "full_occlusion.txt", "0,1,0")
    text(folder / "cat" / "cat-1" / "out_of_view.txt", "0,0,1")
    return folder


def uav123(folder: Path) -> Path:
    images(folder / "data_seq" / "UAV123" / "bike1", 3, digits=6)
    text(folder / "anno" / "UAV123" / "bike1.txt", *boxes(3))
    return folder


def alov(folder: Path) -> Path:
    images(folder / "imagedata++" / "01-Light" / "01-Light_video00001", 7, digits=8)
    text(
        folder / "annotations" / "01-Light" / "01-Light_video00001.ann",
        "1 11 7 5 7 5 3 11 3",
        "5 9 3 9 7 15 7 15 3",
    )
    return folder


def vid_xml(path: Path, *objects: tuple) -> Path:
    """An annotation of one frame; objects are (track, name, xyxy, occluded, generated)."""
    items = "".join(
        f"<object><trackid>{track}</trackid><name>{name}</name><bndbox><xmax>{box[2]}</xmax>"
        f"<xmin>{box[0]}</xmin><ymax>{box[3]}</ymax><ymin>{box[1]}</ymin></bndbox>"
        f"<occluded>{occluded}</occluded><generated>{generated}</generated></object>"
        for track, name, box, occluded, generated in objects
    )
    return text(path, f"<annotation><folder>v</folder>{items}</annotation>")


def imagenet_vid(folder: Path) -> Path:
    clip = Path("VID/train/ILSVRC2015_VID_train_0000/ILSVRC2015_train_00000000")
    images(folder / "Data" / clip, 4, first=0, digits=6, suffix=".JPEG")
    dog, cat = ("0", "n02084071"), ("1", "n02121808")
    for frame, objects in enumerate(
        [
            [(*dog, (2, 3, 9, 7), 0, 0)],
            [(*dog, (3, 3, 10, 7), 1, 1), (*cat, (0, 0, 31, 23), 0, 0)],
            [],
            [(*dog, (5, 3, 12, 7), 0, 0)],
        ]
    ):
        vid_xml(folder / "Annotations" / clip / f"{frame:06d}.xml", *objects)
    return folder


def trackingnet(folder: Path) -> Path:
    images(folder / "TRAIN_0" / "frames" / "a_1", 12, first=0, digits=1)
    text(folder / "TRAIN_0" / "anno" / "a_1.txt", *boxes(12))
    return folder


PALETTE = [(0, 0, 0), (128, 0, 0), (0, 128, 0), (128, 128, 0)]
"""That of DAVIS, which is PASCAL VOC's: 0 background, then red, green, yellow."""


def davis(folder: Path) -> Path:
    """Two objects: 1 in all frames, 2 in the last two of three."""
    images(folder / "JPEGImages" / "480p" / "bear", 3, first=0, digits=5)
    for frame in range(3):
        ids = np.zeros((24, 32), np.uint8)
        ids[4:8, 3 + frame : 9 + frame] = 1
        if frame:
            ids[10:13, 20:22] = 2
        palette_png(folder / "Annotations" / "480p" / "bear" / f"{frame:05d}.png", ids, PALETTE)
    return folder


def motchallenge(folder: Path) -> Path:
    images(folder / "train" / "MOT16-02" / "img1", 4, digits=6)
    text(
        folder / "train" / "MOT16-02" / "gt" / "gt.txt",
        "1,3,2,3,4,5,1,1,1",
        "2,3,3,3,4,5,1,1,0.49",
        "4,3,5,3,4,5,1,1,0.5",
        "2,10,8,3,4,5,1,7,0.2",
        "1,11,8,3,4,5,0,3,1",
    )
    text(
        folder / "train" / "MOT16-02" / "seqinfo.ini",
        "[Sequence]",
        "name=MOT16-02",
        "imDir=img1",
        "seqLength=4",
    )
    return folder


def visdrone(folder: Path) -> Path:
    """A clip of several objects and, in another part, one of a single object."""
    images(folder / "VisDrone2019-MOT-val" / "sequences" / "uav1_v", 4, digits=7)
    text(
        folder / "VisDrone2019-MOT-val" / "annotations" / "uav1_v.txt",
        "1,3,0,3,4,5,1,4,0,0",
        "2,3,1,3,4,5,1,4,0,2",
        "4,3,3,3,4,5,1,4,1,1",
        "2,10,8,3,4,5,1,10,0,0",
        "1,0,9,9,9,9,0,0,0,0",
        "1,11,8,3,4,5,0,11,0,0",
    )
    images(folder / "VisDrone2019-SOT-val" / "sequences" / "uav2_s", 3, digits=7)
    text(folder / "VisDrone2019-SOT-val" / "annotations" / "uav2_s.txt", *boxes(2), "0,0,0,0")
    return folder


def plain(folder: Path) -> Path:
    images(folder / "duck", 3)
    text(folder / "duck.txt", *boxes(3))
    return folder


BUILDERS = {
    "otb": otb,
    "vot": vot,
    "got10k": got10k,
    "lasot": lasot,
    "uav123": uav123,
    "alov": alov,
    "imagenet-vid": imagenet_vid,
    "trackingnet": trackingnet,
    "davis": davis,
    "motchallenge": motchallenge,
    "visdrone": visdrone,
    "plain": plain,
}
