"""Simulated objects that go out of sight."""

from dataclasses import replace

import numpy as np
import pytest

from re3.data.augment import AugmentedClip
from re3.data.contact_sheet import ABSENT, contact_sheet
from re3.data.frame_store import FrameStore
from re3.data.leaving import Absence, chance_of_leaving, draw_absence, move_out
from re3.data.photometric_config import PhotometricConfig
from re3.data.sampling import ClipSampler
from re3.data.sampling_config import SamplingConfig
from re3.data.scene import Layer, Look, Scene
from re3.data.simulation_config import WAYS, SimulationConfig
from re3.data.simulator import simulate

CALM = SimulationConfig(
    occluders=0.0, twin=0.0, other=0.0, object_pixels=(40.0, 60.0), camera=(1e-4, 1e-4),
    leaves=1.0,
)  # fmt: skip
SEEDS = range(6)


def scenes(stills, way, frames=16, leap=1):
    config = replace(CALM, leaves_by=(way,))
    return [simulate(stills, frames, np.random.default_rng(s), config, leap) for s in SEEDS]


def absent(clip):
    return np.isnan(clip.boxes_xyxy).all(axis=1)


def with_target(scene, shown):
    """The scene with its object always there, or never."""
    layers = list(scene.layers)
    mask = np.full(len(scene.boxes_xyxy), shown)
    layers[scene.target] = replace(layers[scene.target], shown=mask)
    return Scene(scene.size, layers, scene.target, scene.fill)


@pytest.mark.parametrize("masked", [True, False])
@pytest.mark.parametrize("way", WAYS)
def test_the_box_ends_where_the_object_is_out_of_sight(stills, way, masked):
    for scene in scenes([still for still in stills if still.masked == masked], way):
        away = absent(scene)
        assert not away[0]
        assert away.sum() >= 2
        assert np.isfinite(scene.boxes_xyxy[~away]).all()
        assert (scene.visible[away] == 0).all()
        assert scene.visible[: np.argmax(away)].max() == 1
        empty = with_target(scene, False)
        region, size = (0, 0, *scene.size), scene.size
        changed = []
        for t, box in enumerate(with_target(scene, True).layers[scene.target].boxes_xyxy()):
            differs = (scene.render(t, region, *size) != empty.render(t, region, *size)).any(axis=2)
            changed.append(differs.sum() / np.prod(box[2:] - box[:2]))
        assert np.max(np.array(changed)[away]) < 0.2  # a last piece at the border
        assert np.min(np.array(changed)[~away & (scene.visible > 0.9)]) > 0.1


@pytest.mark.parametrize("way", WAYS)
def test_it_comes_back_in_some_clips_and_goes_for_good_in_others(stills, way):
    config = replace(CALM, leaves_by=(way,))
    drawn = [simulate(stills, 33, np.random.default_rng(s), config) for s in range(24)]
    back = [not absent(scene)[-3:].any() for scene in drawn]
    for_good = [absent(scene)[-3:].all() for scene in drawn]
    assert sum(back) >= 4
    assert sum(for_good) >= 8


@pytest.mark.parametrize(("way", "moves"), [("walks", False), ("camera", True), ("behind", False)])
def test_the_background_moves_only_where_the_camera_turns(stills, way, moves):
    for scene in scenes(stills, way):
        offsets = scene.layers[0].paths[:, :, 2]
        away = np.hypot(*(offsets - offsets[0]).T).max()
        assert (away > 15) == moves


@pytest.mark.parametrize(
    ("speed", "moving", "span"),
    [
        (0.0, (1,), 12),  # as long as was drawn
        (10.0, (1,), 7),  # its own speed takes it out sooner
        (10.0, (0, 1), 12),  # the camera's is another
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_object_walks_out_no_slower_than_it_moved(speed, moving, span, seed):
    image = np.full((20, 20, 3), 200, np.uint8)
    paths = np.tile([[1.0, 0.0, 5000.0], [0.0, 1.0, 30.0]], (24, 1, 1))
    paths[:, 0, 2] += speed * np.arange(24)
    layers = [
        Layer([Look.background(image)], paths),
        Layer([Look.cut_out(image, image[..., 0])], paths),
    ]
    absence = Absence(last=5, gone=17, returns=24, back=30)
    rng = np.random.default_rng(seed)
    moved = move_out(layers, 1, moving, (10000, 80), absence, rng)  # 50 pixels to top and bottom
    away = absent(Scene((10000, 80), moved, 1, (0, 0, 0)))
    assert not away[:6].any()
    assert away[5 + span :].all()
    assert not away[: 5 + span - 4].any()  # but for a last piece, all of it was in sight


def test_what_it_goes_behind_covers_it(stills):
    for scene in scenes(stills, "behind"):
        gone = int(np.argmax(absent(scene)))
        assert with_target(scene, True).visible[gone] < 0.2
        assert scene.target == len(scene.layers) - 2  # before it, what covers it


@pytest.mark.parametrize("way", WAYS)
def test_a_clip_that_leaps_has_it_on_both_sides_of_the_leap(stills, way):
    away = np.stack([absent(scene) for scene in scenes(stills, way, frames=5, leap=20)])
    assert not away[:, :2].any()
    assert away[:, 2:].any(axis=1).sum() >= 2  # every other clip of so few frames


def test_the_same_seed_gives_the_same_scene(stills):
    config = SimulationConfig(leaves=1.0)
    first, second = (simulate(stills, 12, np.random.default_rng(3), config) for _ in range(2))
    np.testing.assert_array_equal(first.boxes_xyxy, second.boxes_xyxy)
    assert absent(first).any()
    region = (0, 0, *first.size)
    np.testing.assert_array_equal(first.crop(11, region, 48), second.crop(11, region, 48))


@pytest.mark.parametrize(
    ("leaves", "frames", "chance"),
    [
        (0.0, 33, 0.0),
        (0.4, 33, 0.4),
        (0.4, 9, 0.4),
        (0.4, 8, 0.2),  # half as likely
        (0.4, 5, 0.2),
        (0.4, 4, 0.0),  # too short
        (1.0, 2, 0.0),
    ],
)
def test_short_clips_are_left_less_often(leaves, frames, chance):
    assert chance_of_leaving(leaves, frames) == chance


def test_as_many_objects_leave_as_the_setting_says(stills):
    config = replace(CALM, leaves=0.5, room=(6.0, 7.0))
    left = [
        any(layer.shown is not None for layer in scene.layers) or absent(scene).any()
        for scene in (simulate(stills, 16, np.random.default_rng(s), config) for s in range(60))
    ]
    assert 20 <= sum(left) <= 40


@pytest.mark.parametrize("frames", [5, 8, 17, 33])
@pytest.mark.parametrize("first", [0, 1])
def test_absences_fit_into_the_clip(frames, first):
    drawn = [draw_absence(frames, first, np.random.default_rng(seed)) for seed in range(200)]
    for absence in drawn:
        assert first <= absence.last < absence.gone <= frames - 2
        assert absence.gone < absence.returns < absence.back
        off = absence.way_off(frames)
        assert (off[: absence.last + 1] == 0).all()
        assert (off[absence.gone : absence.returns + 1] == 1).all()
    back = sum(absence.returns < frames for absence in drawn)
    assert (60 <= back <= 110) if frames > 8 else back < 110


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"leaves": 1.5}, "leaves is 1.5; expected a probability"),
        ({"leaves": -0.1}, "leaves is -0.1; expected a probability"),
        ({"leaves_by": ()}, r"leaves_by is \[\]; expected one or more of walks, camera, behind"),
        ({"leaves_by": ("flies",)}, "leaves_by is .*flies.*; expected one or more"),
    ],
)
def test_settings_that_cannot_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        SimulationConfig(**change)


def test_sampled_clips_begin_with_the_object(stills, tmp_path):
    config = SamplingConfig(simulation=SimulationConfig(leaves=1.0))
    sampler = ClipSampler([], stills, FrameStore(tmp_path), config)
    clips = [sampler.sample(13, np.random.default_rng(seed)) for seed in range(20)]
    assert not any(absent(clip)[: 1 + clip.leaps].any() for clip in clips)
    assert all(absent(clip).any() for clip in clips)


@pytest.mark.parametrize("way", WAYS)
def test_the_sheet_marks_frames_without_the_object(stills, way):
    plain = PhotometricConfig(0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    scene = scenes(stills, way)[0]
    clip = AugmentedClip(scene, np.random.default_rng(0), plain)
    corners = contact_sheet([clip], size=64)[-64][::66]  # the top left pixel of every crop
    red = (corners == ABSENT).all(axis=1)
    assert len(red) == 16
    assert red[absent(scene)].all()
    assert not red[0]
