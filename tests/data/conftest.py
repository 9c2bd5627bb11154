"""Pictures to simulate from."""

import json

import cv2
import numpy as np
import pytest

from re3.data.still_formats import read_stills


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six pictures: a bright disc with a mask, or a box without one, on dark noise."""
    folder = tmp_path_factory.mktemp("stills")
    rng = np.random.default_rng(0)
    lines = []
    for index in range(6):
        image = rng.integers(0, 80, (120, 160, 3), dtype=np.uint8)
        mask = np.zeros((120, 160), np.uint8)
        if index % 2:
            cv2.circle(mask, (80, 60), 25, 255, -1)
        else:
            mask[35:85, 55:105] = 255
        image[mask > 0] = (40, 200, 250)
        cv2.imwrite(str(folder / f"{index}.png"), image)
        cv2.imwrite(str(folder / f"{index}-mask.png"), mask)
        lines.append(
            {
                "image": f"{index}.png",
                "mask": f"{index}-mask.png" if index % 2 else None,
                "width": 160,
                "height": 120,
                "objects": [{"label": "thing", "box_xywh": [55, 35, 50, 50]}],
            }
        )
    (folder / "boxes.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


@pytest.fixture(scope="module")
def stills(folder):
    return read_stills(folder)
