"""Pictures and plots of how the tracker works, made with the tracker's own code."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from re3 import geometry
from re3.data.simulator import simulate
from re3.data.stills import make_still
from re3.evaluation.plots_style import PALETTE, look, new_figure
from re3.models import DEFAULT_MODEL, find_weights
from re3.network.re3 import Re3Config
from re3.network.re3_lite import Re3Lite
from re3.network.weights import load_network
from re3.result import Result, Status
from re3.search import places
from re3.video import draw_results, open_source
from strips import GAP, PERSON, PERSON_CLIP, STRIPS, beside, find_clip, track, write

Image = NDArray[np.uint8]
GREEN, ORANGE, BLUE = (80, 200, 60), (0, 94, 213), (178, 114, 0)
"""BGR."""


def crops(clips: Path) -> Image:
    """The frame with its search regions, the paper's two crops, and the one of re3-lite."""
    del clips
    (before, (earlier,)), (after, (later,)) = track(PERSON_CLIP, STRIPS["spread"].objects, 0, 112)[
        -2:
    ]
    box = geometry.convert(earlier.box_xywh, "xywh", "xyxy")
    found = geometry.convert(later.box_xywh, "xywh", "xyxy")
    lite, paper = load_network(find_weights(DEFAULT_MODEL)).spec(), Re3Config().spec()
    whole = before.copy()
    _rectangle(whole, box, GREEN, 3)
    for spec, colour in ((paper, ORANGE), (lite, BLUE)):
        _rectangle(whole, geometry.search_region(box, spec.current.context), colour, 3)
    side, pictures = 240, []
    for image, inside, spec, view, text in (
        (before, box, paper, paper.current, "re3: previous"),
        (after, found, paper, paper.current, "re3: current"),
        (after, found, lite, lite.current, "re3-lite: current"),
    ):
        region = geometry.search_region(box, view.context)
        crop = geometry.crop(image, region, view.size, spec.fill).copy()
        answer = geometry.encode(inside, region) / geometry.REGRESSION_SCALE
        _rectangle(crop, answer * view.size, GREEN, 2)
        pictures.append(write(cv2.resize(crop, (side, side)), text))
    row = beside(pictures, axis=1)
    height = round(row.shape[1] * whole.shape[0] / whole.shape[1])
    shown = cv2.resize(whole, (row.shape[1], height), interpolation=cv2.INTER_AREA)
    return np.concatenate([shown, np.full_like(row[:GAP], 255), row])


def heat(clips: Path) -> Image:
    """The two heat maps of re3-lite upon its crop: corners in sight, and a box that spreads."""
    del clips
    # Both starts are boxes that the tracker itself gives there.
    rows = [
        _heat_row(0, STRIPS["spread"].objects["person"], 12),
        _heat_row(104, (379.0, 22.0, 130.0, 402.0), 118),
    ]
    return beside(rows, axis=0)


def _heat_row(start: int, box_xywh: tuple[float, float, float, float], shown: int) -> Image:
    network = load_network(find_weights(DEFAULT_MODEL)).eval()
    assert isinstance(network, Re3Lite), "the shipped model is a re3-lite"
    spec, state = network.spec(), network.zero_state(1)
    box = geometry.convert(box_xywh, "xywh", "xyxy")
    with open_source(PERSON_CLIP, start_frame=start) as source, torch.inference_mode():
        for index, frame in enumerate(source, start):
            region = geometry.snap(geometry.search_region(box, spec.current.context))
            crop = geometry.crop(frame.image, region, spec.current.size, spec.fill)
            embedding = network.head.embedding(network.features(torch.from_numpy(crop[None])))
            output, state = network.head(embedding, state)
            if index > start:  # in the first frame the box given counts
                box = geometry.decode(output.corners.numpy(), region[None])[0]
            if index == shown:
                break
    side = 230
    plain = cv2.resize(crop, (side, side), interpolation=cv2.INTER_CUBIC)
    answered = plain.copy()
    _rectangle(answered, output.corners[0].numpy() / geometry.REGRESSION_SCALE * side, GREEN, 2)
    pictures = [write(answered, f"frame {index}")]
    for logits, name in zip(output.heat_logits[0], ("top-left", "bottom-right"), strict=True):
        likely = logits.flatten().softmax(dim=0).view_as(logits).numpy()
        wide = cv2.resize(likely / likely.max(), (side, side), interpolation=cv2.INTER_NEAREST)
        colours = cv2.applyColorMap((255 * wide).astype(np.uint8), cv2.COLORMAP_INFERNO)
        grey = cv2.cvtColor(cv2.cvtColor(plain, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        pictures.append(write(cv2.addWeighted(grey, 0.35, colours, 0.85, 0), name))
    return beside(pictures, axis=1)


def search(clips: Path) -> Image:
    """Where an object that is lost is looked for, frame by frame."""
    path = find_clip("car-detection.mp4", clips)
    with open_source(path, start_frame=93) as source:
        image = next(iter(source)).image.copy()
    height, width = image.shape[:2]
    trusted = np.array([340.0, 180.0, 420.0, 240.0])
    _rectangle(image, trusted, GREEN, 3)
    for number in range(12, 0, -1):
        colour = BLUE if number > 6 else ORANGE
        for place in places(trusted, number, width, height):
            _rectangle(image, place, colour, 1)
            x, y = (int(v) for v in (place[:2] + place[2:]) / 2)
            text, font = str(number), cv2.FONT_HERSHEY_SIMPLEX
            (wide, high), _ = cv2.getTextSize(text, font, 0.5, 1)
            cv2.rectangle(image, (x - 12, y - 10), (x + 12, y + 10), (40, 40, 40), cv2.FILLED)
            origin = (x - wide // 2, y + high // 2)
            cv2.putText(image, text, origin, font, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return image


def simulated(clips: Path) -> Image:
    """Six frames of a simulated sequence, cut out of the bundled clip and two others."""
    objects = {
        (PERSON, 40): (381, 19, 129, 407),
        ("bottle-detection.mp4", 20): (55, 108, 70, 204),
        ("car-detection.mp4", 213): (309, 63, 152, 238),
    }
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as folder:
        stills = []
        for (clip, index), box in objects.items():
            with open_source(find_clip(clip, clips), start_frame=index) as source:
                image = next(iter(source)).image
            path = Path(folder) / f"{clip}.png"
            cv2.imwrite(str(path), image)
            still = make_still(path, [box], image.shape[0] * image.shape[1], 0.01)
            assert still is not None, f"the object in {clip} is large enough"
            stills.append(still)
        scene = simulate(stills, 40, rng)
        pictures = []
        for t in range(0, 40, 7):
            width, height = 320, round(320 * scene.size[1] / scene.size[0])
            image = scene.render(t, (0, 0, *scene.size), width, height)
            scale = width / scene.size[0]
            x, y, w, h = (
                float(v) for v in geometry.convert(scene.boxes_xyxy[t] * scale, "xyxy", "xywh")
            )
            if np.isfinite(x):
                seen = float(scene.visible[t])
                shown = Result((x, y, w, h), seen, Status.TRACKED, t, 0, "visible")
                image = draw_results(image, [shown])
            pictures.append(write(image.copy(), f"frame {t}"))
    return beside([beside(pictures[:3], 1), beside(pictures[3:], 1)], 0)


def scores(clips: Path) -> Figure:
    """The score over time in three clips that end badly."""
    with look():
        figure = new_figure(7.2, 3.2)
        axes = figure.add_subplot()
        labels = {
            "spread": "person: turns and walks off",
            "left": "car: drives out of the frame",
            "look-alike": "bottle: taken away and put back",
        }
        for (name, label), colour in zip(labels.items(), PALETTE, strict=False):
            strip = STRIPS[name]
            first, last = strip.shown[0], strip.shown[-1]
            seen = track(find_clip(strip.clip, clips), strip.objects, first, last)
            values = np.array([result.score for _, (result,) in seen])
            time = np.linspace(0, 1, len(values))
            axes.plot(time, values, color=colour, label=label)
            for status, marker in ((Status.UNCERTAIN, "|"), (Status.LOST, "x")):
                called = [result.status is status for _, (result,) in seen]
                axes.plot(time[called], values[called], marker, color="#222222", markersize=4)
        for status, marker in ((Status.UNCERTAIN, "|"), (Status.LOST, "x")):
            axes.plot([], [], marker, color="#222222", markersize=4, label=f"called {status}")
        axes.set(xlabel="time, as a share of the clip", ylabel="score", ylim=(0, 1), xlim=(0, 1))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.02))
    return figure


def _rectangle(image: Image, box_xyxy: NDArray, colour: tuple[int, int, int], pen: int) -> None:
    left, top, right, bottom = (round(float(v)) for v in box_xyxy)
    cv2.rectangle(image, (left, top), (right, bottom), (0, 0, 0), pen + 2, cv2.LINE_AA)
    cv2.rectangle(image, (left, top), (right, bottom), colour, pen, cv2.LINE_AA)
