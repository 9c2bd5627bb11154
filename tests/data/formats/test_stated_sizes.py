"""Sequences whose annotation states another size than their frames are decoded to."""

import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset


def seqinfo(folder, width, height):
    found = layouts.motchallenge(folder)
    info = found / "train" / "MOT16-02" / "seqinfo.ini"
    info.write_text(f"{info.read_text()}imWidth={width}\nimHeight={height}\n")
    return found


def vid_sizes(folder, width, height):
    found = layouts.imagenet_vid(folder)
    for path in found.rglob("*.xml"):
        size = f"<size><width>{width}</width><height>{height}</height></size>"
        path.write_text(path.read_text().replace("<object>", f"{size}<object>", 1))
    return found


def davis_masks(folder, width, height):
    found = layouts.davis(folder)
    palette = [(i, 0, 0) for i in range(256)]
    ids = np.zeros((height, width), np.uint8)
    ids[2:9, 3:9] = 1
    for path in found.rglob("*.png"):
        layouts.palette_png(path, ids, palette)
    return found


@pytest.mark.parametrize("build", [seqinfo, vid_sizes, davis_masks])
def test_the_size_of_the_first_frame_is_compared(tmp_path, build):
    assert read_dataset(build(tmp_path / "right", 32, 24))
    with pytest.raises(ValueError, match=r"decoded to 32 x 24 pixels, but .* states 64 x 48"):
        read_dataset(build(tmp_path / "resized", 64, 48))
    with pytest.raises(ValueError, match=r"is it turned by its EXIF orientation\?"):
        read_dataset(build(tmp_path / "turned", 24, 32))
