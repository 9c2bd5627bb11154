"""The card of an exported network: everything that a program needs to track with it, as JSON."""

from __future__ import annotations

from typing import Any

from re3.geometry import SMALLEST_SIDE
from re3.model_spec import CropSpec, ModelSpec

WHOLE_PIXEL_SAMPLING = (
    "the part of the region inside the frame is resized, linear without averaging, to its share "
    "of the crop: S * inside / extent, rounded half to even, 1 or more; columns and rows of fill "
    "before it: S * -left / extent, rounded down"
)


def make_card(spec: ModelSpec, file: str, **about: object) -> dict[str, Any]:
    """The card of a file.

    Args:
        spec: of the network.
        file: its name.
        about: more to say at the head, such as `format`, `opset`, `weights`.
    """
    return {
        "name": spec.name,
        "file": file,
        **about,
        "inputs": _inputs(spec),
        "outputs": _outputs(spec),
        "normalisation": "none outside: crops are BGR as they are, 0..255; the mean is taken off "
        "inside the graph",
        "crop": {
            "fill_bgr": list(spec.fill),
            "region": "centre of the object's box in the frame before; `context` times the box's "
            f"width and height, of which each counts as {SMALLEST_SIDE:g} pixel at least; its "
            "corners fall on the crop's, so that the aspect ratio is not kept"
            + (
                "; rounded to whole pixels for cutting, not for decoding"
                if spec.whole_pixels
                else ""
            ),
            "sampling": WHOLE_PIXEL_SAMPLING
            if spec.whole_pixels
            else "linear; a region larger than the crop is averaged, not skipped over",
        },
        "box": {
            "regression_scale": spec.regression_scale,
            "rule": "x = left + corner / regression_scale * width of the region, y likewise; "
            f"sides of {SMALLEST_SIDE:g} pixel at least, the centre kept inside the frame",
        },
        "state": {
            "first_frame": "all states zero, crops about the given box; the corners that come out "
            "are discarded, the new state is kept twice: to go on from, and as the first state",
            "next_frames": "current crop about the box of the frame before"
            + (
                ", previous crop about the same box in the frame before"
                if spec.previous is not None
                else ""
            )
            + "; states are what the step before gave as new_...",
            "reset_interval": spec.reset_interval,
            "reset_rule": "after so many steps (0: never) states return to the first state, "
            "but for kept_at_reset; the count starts again"
            + (
                "; then one more pass with the crops about the new box in that same frame, whose "
                "new state goes on"
                if spec.look_at_reset
                else ""
            ),
            "kept_at_reset": list(spec.kept_at_reset),
        },
        "spec": spec.to_json(),
    }


def _inputs(spec: ModelSpec) -> list[dict[str, Any]]:
    crops = [
        _crop("previous_crops", spec.previous, "of the frame before"),
        _crop("current_crops", spec.current, "of the current frame"),
    ]
    states = [
        _tensor(name, "float32", shape, "recurrent state") for name, shape in spec.state.items()
    ]
    return [crop for crop in crops if crop] + states


def _outputs(spec: ModelSpec) -> list[dict[str, Any]]:
    return [
        _tensor("corners", "float32", (4,), "x1, y1, x2, y2 in the current crop, times the scale"),
        _tensor("score", "float32", (), "expected overlap 0..1; NaN of a network without score"),
        *(
            _tensor(f"new_{name}", "float32", shape, f"{name} after the step")
            for name, shape in spec.state.items()
        ),
    ]


def _crop(name: str, view: CropSpec | None, what: str) -> dict[str, Any]:
    if view is None:
        return {}
    shape = (view.size, view.size, 3)
    return {**_tensor(name, "uint8", shape, f"crops {what}, BGR"), "context": view.context}


def _tensor(name: str, kind: str, shape: tuple[int, ...], what: str) -> dict[str, Any]:
    return {"name": name, "type": kind, "shape": ["objects", *shape], "what": what}
