"""Simulated scenes, from pictures that the test draws."""

import json
from dataclasses import replace

import numpy as np
import pytest

from re3.data.augment import AugmentedClip
from re3.data.clip import MirroredClip, RecordedClip
from re3.data.photometric_config import PhotometricConfig
from re3.data.simulation_config import SimulationConfig
from re3.data.simulator import simulate
from re3.data.still_formats import read_stills
from re3.geometry import search_region

CALM = SimulationConfig(occluders=0.0, twin=0.0, other=0.0, foreign=0.0, object_pixels=(40.0, 60.0))


def test_small_objects_are_discarded(folder, tmp_path):
    line = json.loads((folder / "boxes.jsonl").read_text().splitlines()[0])
    line["objects"] = [
        {"label": "large enough", "box_xywh": [0, 0, 16, 12]},  # exactly 0.1 squared
        {"label": "small", "box_xywh": [0, 0, 15, 12]},
    ]
    line["image"] = str(folder / line["image"])
    (tmp_path / "boxes.jsonl").write_text(json.dumps(line))
    (still,) = read_stills(tmp_path)
    np.testing.assert_array_equal(still.boxes_xywh, [[0, 0, 16, 12]])


@pytest.mark.parametrize(
    ("content", "error", "message"),
    [
        (None, ValueError, "holds nothing in the format boxes"),
        ("{}", ValueError, "line 1.*image"),
        ("nonsense", ValueError, "line 1"),
        ("", ValueError, "has no object"),
    ],
)
def test_a_broken_index_is_named(tmp_path, content, error, message):
    if content is not None:
        (tmp_path / "boxes.jsonl").write_text(content)
    with pytest.raises(error, match=message):
        read_stills(tmp_path, "boxes")


def test_the_same_seed_gives_the_same_scene(stills):
    a, b = (simulate(stills, 8, np.random.default_rng(7)) for _ in range(2))
    c = simulate(stills, 8, np.random.default_rng(8))
    np.testing.assert_array_equal(a.boxes_xyxy, b.boxes_xyxy)
    assert not np.array_equal(a.boxes_xyxy, c.boxes_xyxy)
    region = (0, 0, *a.size)
    np.testing.assert_array_equal(a.crop(3, region, 64), b.crop(3, region, 64))


@pytest.mark.parametrize(
    ("seed", "frames", "leap", "box", "layers", "mean", "next_draw"),
    [
        (0, 9, 1, (89.11, 55.34, 126.10, 81.62), 2, 51.1, 119236),
        (1, 16, 1, (255.10, 47.58, 429.48, 223.69), 2, 59.4, 898234),
        (2, 5, 20, (10.00, 43.04, 38.98, 75.88), 3, 57.6, 828565),  # leaps
        (3, 2, 1, (13.86, 24.87, 39.51, 50.89), 2, 63.4, 85649),
    ],
)
def test_scenes_are_what_they_were_before_objects_could_leave(
    stills, seed, frames, leap, box, layers, mean, next_draw
):
    rng = np.random.default_rng(seed)
    scene = simulate(stills, frames, rng, leap=leap)
    np.testing.assert_allclose(scene.boxes_xyxy[-1], box, atol=0.006)
    assert len(scene.layers) == layers
    assert scene.crop(frames - 1, (0, 0, *scene.size), 32).mean() == pytest.approx(mean, abs=0.2)
    assert rng.integers(10**6) == next_draw  # no number more was drawn


@pytest.mark.parametrize("seed", range(8))
def test_the_box_is_where_the_object_is_drawn(stills, seed):
    scene = simulate(stills, 12, np.random.default_rng(seed), CALM)
    for t in range(12):
        x1, y1, x2, y2 = scene.boxes_xyxy[t]
        if np.isnan(x1):
            continue
        image = scene.render(t, (0, 0, *scene.size), *scene.size)
        # The picture it was cut from is the background, with the object in it: hide that one.
        own = np.zeros(image.shape[:2], bool)
        own[max(int(y1) - 4, 0) : int(y2) + 5, max(int(x1) - 4, 0) : int(x2) + 5] = True
        bright = (image[:, :, 2] > 160) & own
        rows, columns = np.nonzero(bright)
        overlap = (columns.max() + 1 - columns.min()) * (rows.max() + 1 - rows.min())
        area = (x2 - x1) * (y2 - y1)
        assert 0.7 < overlap / area < 1.45


def test_objects_move_and_change(stills):
    scenes = [simulate(stills, 16, np.random.default_rng(s)) for s in range(20)]
    moved = [np.nanmax(np.abs(s.boxes_xyxy - s.boxes_xyxy[0])) for s in scenes]
    sizes = [np.ptp(s.boxes_xyxy[:, 2] - s.boxes_xyxy[:, 0]) for s in scenes]
    assert np.median(moved) > 5
    assert np.nanmedian(sizes) > 1


def test_masked_objects_change_their_shape_and_the_box_follows(stills):
    masked = [still for still in stills if still.masked]
    config = SimulationConfig(
        occluders=0.0, twin=0.0, other=0.0, foreign=0.0, object_pixels=(60.0, 61.0),
        bent=1.0, bending=0.08, scaling=0.0, stretching=0.0, spinning=0.0,
    )  # fmt: skip
    rigid = replace(config, bent=0.0)
    ratios = {}
    for name, kind in (("bent", config), ("rigid", rigid)):
        scenes = [simulate(masked, 16, np.random.default_rng(s), kind) for s in range(6)]
        boxes = np.stack([s.layers[s.target].boxes_xyxy() for s in scenes])
        size = boxes[..., 2:] - boxes[..., :2]
        ratios[name] = np.ptp(np.log(size[..., 0] / size[..., 1]), axis=1).max()
    assert ratios["rigid"] < 1e-9
    assert ratios["bent"] > 0.02


def test_occluders_hide_the_object(stills):
    config = SimulationConfig(occluders=6.0)
    hidden = [
        simulate(stills, 16, np.random.default_rng(seed), config).visible.min()
        for seed in range(12)
    ]
    clear = simulate(stills, 16, np.random.default_rng(0), CALM)
    assert min(hidden) < 0.4
    assert (clear.visible[~np.isnan(clear.boxes_xyxy[:, 0])] == 1).all()


def test_a_crop_is_a_piece_of_the_rendered_frame(stills):
    scene = simulate(stills, 4, np.random.default_rng(3), CALM)
    whole = scene.render(2, (0, 0, *scene.size), *scene.size)
    part = scene.crop(2, (10, 10, 74, 74), 64)
    difference = np.abs(part.astype(int) - whole[10:74, 10:74])
    assert difference.mean() < 1.0


def test_the_outline_lies_where_the_object_does(stills):
    scene = simulate(stills, 8, np.random.default_rng(3), CALM)
    frame = int(np.flatnonzero(np.isfinite(scene.boxes_xyxy[:, 0]))[-1])
    box = scene.boxes_xyxy[frame]
    outline = scene.outline(frame, search_region(box, 3.0), 24)
    assert outline.dtype == np.float32
    assert outline.min() >= 0 and outline.max() == 1
    rows, columns = np.nonzero(outline > 0.5)
    edges = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    np.testing.assert_allclose(edges, [8, 8, 16, 16], atol=1.5)  # the middle third
    mirrored = MirroredClip(scene)
    again = mirrored.outline(frame, search_region(mirrored.boxes_xyxy[frame], 3.0), 24)
    np.testing.assert_allclose(again, outline[:, ::-1], atol=0.3)


def test_what_hides_an_object_cuts_its_outline(stills):
    config = SimulationConfig(occluders=6.0)
    scenes = [simulate(stills, 16, np.random.default_rng(seed), config) for seed in range(12)]
    scene = min(scenes, key=lambda scene: np.nanmin(scene.visible))
    present = np.isfinite(scene.boxes_xyxy[:, 0])
    least, most = (
        pick(np.where(present, scene.visible, bad))
        for pick, bad in ((np.argmin, 9.0), (np.argmax, -1.0))
    )
    shown = [
        scene.outline(int(frame), search_region(scene.boxes_xyxy[frame], 3.0), 24).sum()
        for frame in (least, most)
    ]
    assert shown[0] < 0.6 * shown[1]


def test_of_a_recorded_clip_no_outline_is_known():
    image = np.zeros((50, 60, 3), np.uint8)
    clip = RecordedClip([image], [(10, 5, 30, 25)], (127.0,) * 3)
    seen = AugmentedClip(MirroredClip(clip), np.random.default_rng(0))
    assert seen.outline(0, (0, 0, 30, 30), 24) is None


def test_outside_the_scene_is_the_fill(stills):
    scene = simulate(stills, 2, np.random.default_rng(3))
    crop = scene.crop(0, (-200, -200, -100, -100), 32)
    assert (crop == 127).all()


def test_mirroring_mirrors_boxes_and_crops():
    image = np.random.default_rng(0).integers(0, 255, (50, 60, 3), dtype=np.uint8)
    clip = RecordedClip([image], [(10, 5, 30, 25)], (127.0,) * 3)
    mirrored = MirroredClip(clip)
    region, mirrored_region = (search_region(c.boxes_xyxy[0], 2.0) for c in (clip, mirrored))
    np.testing.assert_array_equal(
        mirrored.crop(0, mirrored_region, 32), clip.crop(0, region, 32)[:, ::-1]
    )
    np.testing.assert_allclose(MirroredClip(mirrored).boxes_xyxy, clip.boxes_xyxy)


def test_the_look_of_a_frame_does_not_change_between_looks():
    image = np.random.default_rng(0).integers(0, 255, (50, 60, 3), dtype=np.uint8)
    clip = RecordedClip([image] * 3, [(10, 5, 30, 25)] * 3, (127.0,) * 3)
    strong = PhotometricConfig(grey=1.0, blur=1.0, motion_blur=1.0, noise=1.0, jpeg=1.0)
    seen = AugmentedClip(clip, np.random.default_rng(0), strong)
    region = search_region(clip.boxes_xyxy[0], 2.0)
    np.testing.assert_array_equal(seen.crop(1, region, 32), seen.crop(1, region, 32))
    assert not np.array_equal(seen.crop(1, region, 32), clip.crop(1, region, 32))


def test_a_leap_moves_and_changes_the_object_more_than_a_frame_does(stills):
    def change(leap):
        boxes = [
            simulate(stills, 3, np.random.default_rng(seed), leap=leap).boxes_xyxy[:2]
            for seed in range(20)
        ]
        sizes = [np.log(pair[:, 2:] - pair[:, :2]) for pair in boxes]
        return np.nanmean([np.abs(size[1] - size[0]).mean() for size in sizes])

    assert change(40) > 3 * change(1)


def test_a_scene_says_whether_it_leaps(stills):
    assert simulate(stills, 3, np.random.default_rng(0), leap=5).leaps
    assert not simulate(stills, 3, np.random.default_rng(0)).leaps
