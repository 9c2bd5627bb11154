"""Track an object with a network that `re3 export` wrote: boxes as left,top,width,height a line.

python track_onnx.py model.onnx clip.mp4 X,Y,W,H    (needs onnxruntime, numpy and opencv-python)
"""

import json
import sys

import cv2
import numpy as np
import onnxruntime


def region(box, view):
    """Left, top, width and height of what the crop shows: the box's surroundings."""
    size = np.maximum(box[2:], 1) * view["context"]
    if spec["whole_pixels"]:
        return np.concatenate([box[:2] + box[2:] / 2 - size / 2, size])
    grid = 2.0 ** np.floor(np.log2(size.min() / 256))  # on it rounding errors do not grow
    low, high = (
        np.rint((box[:2] + box[2:] / 2 + side * size / 2) / grid) * grid for side in (-1, 1)
    )
    return np.concatenate([low, high - low])


def weights(low, extent, size, pixels):
    """[size, pixels]: what each pixel of a side counts for each value of the crop's side."""
    reach = max(1.0, extent / size)  # linear interpolation; wider where the crop is the coarser
    centres = low + (np.arange(size)[:, None] + 0.5) * extent / size
    near = np.floor(centres - reach) + np.arange(int(2 * reach) + 3)
    share = np.maximum(1 - np.abs(near + 0.5 - centres) / reach, 0)
    share /= share.sum(axis=1, keepdims=True)
    row, tap = np.nonzero((near >= 0) & (near < pixels))
    table = np.zeros((size, pixels))
    table[row, near[row, tap].astype(int)] = share[row, tap]
    return table


def whole_pixel_weights(low, extent, size, pixels):
    """The same of a side rounded to whole pixels: what is inside resized, the rest left out."""
    high = round(low + extent)
    low = round(low)
    start, stop = (min(max(end, 0), pixels) for end in (low, high))
    table = np.zeros((size, pixels))
    if start < stop:
        count = max(round(size * (stop - start) / (high - low)), 1)
        row = np.arange(count)
        place = start + (row + 0.5) * (stop - start) / count - 0.5
        near = np.floor(place).astype(int)
        row += max(-low, 0) * size // (high - low)
        table[row, np.clip(near, start, stop - 1)] += 1 - (place - near)
        table[row, np.clip(near + 1, start, stop - 1)] += place - near
    return table


def crop(frame, box, view):
    """uint8 [1, S, S, 3]; what lies outside the frame has the colour `fill`."""
    left, top, width, height = region(box, view)
    table = whole_pixel_weights if spec["whole_pixels"] else weights
    rows = np.tensordot(table(top, height, view["size"], len(frame)), frame - fill, 1)
    cells = np.tensordot(table(left, width, view["size"], frame.shape[1]), rows, (1, 1))
    # Half way between two values, rounding errors are not to decide.
    return np.floor(cells.transpose(1, 0, 2) + fill + 0.500001).astype(np.uint8)[None]


def step(frame, previous, box, state):
    """One step of the network: the box found, and the new state."""
    inputs = {"current_crops": crop(frame, box, spec["current"]), **state}
    if spec["previous"]:
        inputs["previous_crops"] = crop(previous, box, spec["previous"])
    corners, *new = session.run(["corners", *(f"new_{n}" for n in state)], inputs)
    left, top, width, height = region(box, spec["current"])
    x1, y1, x2, y2 = corners[0] / spec["regression_scale"] * [width, height, width, height]
    size = np.maximum([x2 - x1, y2 - y1], 1)
    limit = [frame.shape[1], frame.shape[0]]
    centre = np.clip([left + (x1 + x2) / 2, top + (y1 + y2) / 2], 0, limit)
    return np.concatenate([centre - size / 2, size]), dict(zip(state, new, strict=True))


session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
spec = json.loads(session.get_modelmeta().custom_metadata_map["re3_spec"])
fill = np.array(spec["fill"])
video, box = cv2.VideoCapture(sys.argv[2]), np.array([float(v) for v in sys.argv[3].split(",")])
previous, steps = None, 0
while (read := video.read())[0]:
    frame = read[1]
    if previous is None:  # the first pass: what it finds is discarded for the box given
        zeros = {n: np.zeros((1, *shape), np.float32) for n, shape in spec["state"].items()}
        _, first = step(frame, frame, box, zeros)
        state = first
    else:
        box, state = step(frame, previous, box, state)
        steps += 1
        if steps == spec["reset_interval"]:
            state, steps = {**first, **{n: state[n] for n in spec["kept_at_reset"]}}, 0
            if spec["look_at_reset"]:
                _, state = step(frame, frame, box, state)
    previous = frame
    print(",".join(f"{value:.3f}" for value in box), flush=True)
