"""The streaming tracker: reset rule, batching, states, frames and boxes of all kinds."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import re3
from re3 import geometry
from re3.confidence import DOUBTED_FRAMES
from re3.engine import StepOutput
from re3.model_spec import CropSpec, ModelSpec
from re3.result import Status
from re3.search import PLACES, places
from re3.video import open_source

PREVIOUS = CropSpec(context=2.0, size=16)
SPEC = ModelSpec(
    name="counter",
    previous=PREVIOUS,
    current=CropSpec(context=2.0, size=32),
    fill=(127.0, 127.0, 127.0),
    state={"count": (1,)},
)
STILL = (2.5, 2.5, 7.5, 7.5)
BOX = (40.0, 30.0, 24.0, 20.0)
CLIP = Path(__file__).parents[1] / "examples" / "clips" / "person.mp4"
PERSON = (368.0, 58.0, 158.0, 374.0)


class Counter:
    """An engine whose state counts steps; it says what it is told to."""

    def __init__(self, corners=STILL, score=0.9, spec=SPEC):
        self.spec, self.corners, self.score = spec, corners, score
        self.calls = []

    def step(self, previous_crops, current_crops, state):
        self.calls.append((previous_crops, current_crops, state["count"].copy()))
        n = len(current_crops)
        return StepOutput(
            np.tile(np.float32(self.corners), (n, 1)),
            np.full(n, self.score, np.float32),
            {"count": state["count"] + 1},
        )


def noise(height=100, width=140, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_the_box_given_is_the_first_result():
    tracker = re3.Tracker(engine=Counter(corners=(0, 0, 1, 1)))
    result = tracker.init(noise(), BOX)
    assert result.box_xywh == BOX
    assert (result.score, result.status, result.frame_index) == (1.0, Status.TRACKED, 0)


def test_an_object_that_stays_keeps_its_box():
    tracker = re3.Tracker(engine=Counter())
    tracker.init(noise(), BOX)
    for index in range(1, 5):
        result = tracker.update(noise())
        assert result.frame_index == index
        np.testing.assert_allclose(result.box_xywh, BOX, atol=1e-4)


def test_the_first_pass_sees_the_given_box_in_the_first_frame_twice():
    engine, frame = Counter(spec=replace(SPEC, current=PREVIOUS)), noise()
    re3.Tracker(engine=engine).init(frame, BOX)
    ((previous, current, count),) = engine.calls
    np.testing.assert_array_equal(previous, current)
    region = geometry.search_region(geometry.convert(BOX, "xywh", "xyxy"), 2.0)
    np.testing.assert_array_equal(previous[0], geometry.crop(frame, region, 16, SPEC.fill))
    assert count == [[0]]


def test_a_step_sees_both_frames_at_the_previous_box():
    engine = Counter(spec=replace(SPEC, current=PREVIOUS), corners=(3, 3, 8, 8))
    tracker = re3.Tracker(engine=engine)
    frames = [noise(seed=s) for s in range(3)]
    tracker.init(frames[0], BOX)
    box = tracker.update(frames[1]).box_xywh
    tracker.update(frames[2])
    region = geometry.snap(geometry.search_region(geometry.convert(box, "xywh", "xyxy"), 2.0))
    previous, current, _ = engine.calls[-1]
    np.testing.assert_array_equal(previous[0], geometry.crop(frames[1], region, 16, SPEC.fill))
    np.testing.assert_array_equal(current[0], geometry.crop(frames[2], region, 16, SPEC.fill))


def test_every_32_steps_the_state_returns_to_that_after_the_first_pass():
    engine = Counter()
    tracker = re3.Tracker(engine=engine)
    tracker.init(noise(), BOX)
    for _ in range(66):
        tracker.update(noise())
    counts = [int(count[0, 0]) for _, _, count in engine.calls]
    assert counts == [0, *range(1, 33), *range(1, 33), 1, 2]


def test_an_interval_of_zero_never_resets():
    engine = Counter(spec=replace(SPEC, reset_interval=0))
    tracker = re3.Tracker(engine=engine)
    tracker.init(noise(), BOX)
    for _ in range(40):
        tracker.update(noise())
    assert [int(count[0, 0]) for _, _, count in engine.calls] == list(range(41))


def test_a_reset_keeps_what_concerns_the_previous_frame():
    spec = replace(SPEC, kept_at_reset=("count",), reset_interval=4)
    engine = Counter(spec=spec)
    tracker = re3.Tracker(engine=engine)
    tracker.init(noise(), BOX)
    for _ in range(10):
        tracker.update(noise())
    assert [int(count[0, 0]) for _, _, count in engine.calls] == list(range(11))


def test_a_reset_may_look_at_the_current_frame_once_more():
    engine = Counter(
        spec=replace(SPEC, current=PREVIOUS, reset_interval=4, look_at_reset=True),
        corners=(3, 3, 8, 8),
    )
    tracker = re3.Tracker(engine=engine)
    frames = [noise(seed=s) for s in range(10)]
    tracker.init(frames[0], BOX)
    boxes = [tracker.update(frame).box_xywh for frame in frames[1:]]
    counts = [int(count[0, 0]) for _, _, count in engine.calls]
    # The looks start from the state after the first pass and are steps of no frame.
    assert counts == [0, 1, 2, 3, 4, 1, 2, 3, 4, 5, 1, 2]
    box = geometry.convert(boxes[3], "xywh", "xyxy")
    region = geometry.snap(geometry.search_region(box, 2.0))
    for crops in engine.calls[5][:2]:
        np.testing.assert_array_equal(crops[0], geometry.crop(frames[4], region, 16, SPEC.fill))


def test_crops_may_be_cut_about_whole_pixels_and_boxes_decoded_without():
    engine = Counter(spec=replace(SPEC, current=PREVIOUS, whole_pixels=True))
    tracker = re3.Tracker(engine=engine)
    frame, box = noise(), (40.25, 30.25, 25.0, 21.0)
    tracker.init(frame, box)
    np.testing.assert_allclose(tracker.update(frame).box_xywh, box, atol=1e-4)
    cut = cv2.resize(frame[20:62, 28:78], (16, 16))  # of 27.75, 19.75, 77.75, 61.75
    for crops in engine.calls[0][:2]:
        np.testing.assert_array_equal(crops[0], cut)


def test_edges_near_half_a_pixel_are_rounded_to_their_own_side():
    engine = Counter(spec=replace(SPEC, current=PREVIOUS, whole_pixels=True))
    frame = noise()
    # The region begins at 27.49, 20.51; a grid of 1/8 would put both edges on the half.
    re3.Tracker(engine=engine).init(frame, (39.99, 30.99, 25.0, 20.96))
    cut = cv2.resize(frame[21:62, 27:77], (16, 16))
    np.testing.assert_array_equal(engine.calls[0][0][0], cut)


def test_a_description_from_before_these_rules_is_read():
    values = json.loads(SPEC.to_json())
    del values["look_at_reset"], values["whole_pixels"]
    assert ModelSpec.from_json(json.dumps(values)) == SPEC


def test_a_model_without_previous_crop_gets_none():
    engine = Counter(spec=replace(SPEC, previous=None))
    tracker = re3.Tracker(engine=engine)
    tracker.init(noise(), BOX)
    tracker.update(noise())
    assert {previous for previous, _, _ in engine.calls} == {None}
    again = re3.Tracker(engine=engine)
    again.load_state(tracker.save_state())
    assert again.update(noise()) == tracker.update(noise())


class Elsewhere(Counter):
    """Sees nothing where it is told to be blind; sure of whatever else it looks at."""

    def __init__(self, blind):
        super().__init__(spec=replace(SPEC, fill=(0.0, 0.0, 0.0)))
        self.blind = blind
        self.seen = 0.9

    def step(self, previous_crops, current_crops, state):
        output = super().step(previous_crops, current_crops, state)
        dark = current_crops.reshape(len(current_crops), -1).mean(axis=1) < self.blind
        return output._replace(score=np.where(dark, 0.1, self.seen).astype(np.float32))


def reappearing(place):
    """A bright object in the dark, gone for three frames, then somewhere else."""
    frames = [np.zeros((200, 400, 3), np.uint8) for _ in range(12)]
    for index, frame in enumerate(frames):
        x, y = (40, 30) if index < 2 else place
        if index not in (2, 3, 4):
            frame[y : y + 20, x : x + 24] = 255
    return frames


@pytest.mark.parametrize("place", [(112, 30), (40, 90), (112, 90)])
def test_a_lost_object_is_found_again_where_it_reappears(place):
    tracker = re3.Tracker(engine=Elsewhere(blind=20))
    frames = reappearing(place)
    tracker.init(frames[0], BOX)
    results = [tracker.update(frame) for frame in frames[1:]]
    assert [r.status for r in results[:4]] == [Status.TRACKED] + [Status.LOST] * 3
    assert results[-1].status is Status.TRACKED
    x, y, w, h = results[-1].box_xywh
    assert abs(x - place[0]) < w and abs(y - place[1]) < h


@pytest.mark.parametrize(("seen", "last"), [(0.66, Status.TRACKED), (0.62, Status.LOST)])
def test_a_place_far_below_the_usual_score_is_not_taken(seen, last):
    engine = Elsewhere(blind=20)
    tracker = re3.Tracker(engine=engine)
    frames = reappearing((112, 90))
    tracker.init(frames[0], BOX)
    for frame in frames[1:5]:
        tracker.update(frame)
    engine.seen = seen  # where .75 is usual
    results = [tracker.update(frame) for frame in frames[5:]]
    assert results[-1].status is last


class ByBrightness(Counter):
    """Scores what it looks at by how bright it is: 200 is .8."""

    def __init__(self):
        super().__init__(spec=replace(SPEC, fill=(0.0, 0.0, 0.0)))

    def step(self, previous_crops, current_crops, state):
        output = super().step(previous_crops, current_crops, state)
        bright = current_crops.reshape(len(current_crops), -1).max(axis=1)
        return output._replace(score=(bright / 250).astype(np.float32))


def two_places(left, right):
    frame = np.zeros((200, 400, 3), np.uint8)
    frame[30:50, 40:64], frame[30:50, 112:136] = round(250 * left), round(250 * right)
    return frame


@pytest.mark.parametrize(
    ("stranger", "back", "after", "taken"),
    [
        (0.7, 0.85, 1, True),
        (0.7, 0.85, DOUBTED_FRAMES - 1, True),
        (0.7, 0.85, DOUBTED_FRAMES, False),  # by then it is trusted
        (0.72, 0.8, 1, False),  # not better by the margin
        (0.8, 0.95, 1, False),  # scored as usual, nothing to doubt
    ],
)
def test_what_a_search_took_is_left_for_the_object_where_it_was_lost(stranger, back, after, taken):
    tracker = re3.Tracker(engine=ByBrightness())
    tracker.init(two_places(0.76, 0.0), BOX)
    tracker.update(two_places(0.76, 0.0))
    for _ in range(3):
        assert tracker.update(two_places(0.0, 0.0)).status is Status.LOST
    for _ in range(PLACES):
        found = tracker.update(two_places(0.0, stranger))
        if found.status is Status.TRACKED:
            break
    assert found.box_xywh[0] > 90
    for _ in range(after - 1):
        tracker.update(two_places(0.0, stranger))
    tracker.load_state(tracker.save_state())
    last = tracker.update(two_places(back, stranger))
    assert (last.box_xywh[0] < 60) == taken
    assert last.score == pytest.approx(back if taken else stranger, abs=0.01)


def test_another_one_beside_an_uncertain_object_is_not_taken():
    clear, dim = two_places(0.8, 0.0), two_places(0.5, 0.0)
    for frame in (clear, dim):
        frame[30:50, 84:108] = round(250 * 0.9)
    tracker = re3.Tracker(engine=ByBrightness())
    tracker.init(clear, BOX)
    for _ in range(2 * PLACES):
        tracker.update(clear)
        result = tracker.update(dim)
        assert result.status is Status.UNCERTAIN
        assert result.box_xywh[0] < 60


def test_a_tracker_told_not_to_search_stays_where_it_is():
    engine = Elsewhere(blind=20)
    tracker = re3.Tracker(engine=engine, search=False)
    frames = reappearing((112, 90))
    tracker.init(frames[0], BOX)
    results = [tracker.update(frame) for frame in frames[1:]]
    assert all(r.status is Status.LOST for r in results[1:])
    assert all(len(current) == 1 for _, current, _ in engine.calls)


def test_only_lost_objects_cost_more_crops():
    engine = Counter(score=0.9)
    tracker = re3.MultiTracker(engine=engine)
    tracker.add(noise(), BOX)
    tracker.update(noise())
    engine.score = 0.52  # uncertain, where .75 is usual
    tracker.update(noise(300, 400))
    engine.score = 0.2
    tracker.update(noise(300, 400))
    crops = [len(current) for _, current, _ in engine.calls]
    assert crops == [1, 1, 1, 1, 1, PLACES]  # one, at the last sure place, while uncertain


def test_a_lost_object_is_found_far_away_by_its_looks():
    frames = [np.zeros((300, 800, 3), np.uint8) for _ in range(40)]
    for index, frame in enumerate(frames):
        x, y = (40, 30) if index < 2 else (340, 250)
        if index < 2 or index > 30:
            frame[y : y + 20, x : x + 24] = noise(20, 24)
    tracker = re3.Tracker(engine=Elsewhere(blind=10))
    tracker.init(frames[0], BOX)
    results = [tracker.update(frame) for frame in frames[1:]]
    assert results[29].status is Status.LOST
    assert results[-1].status is Status.TRACKED
    x, y, w, h = results[-1].box_xywh
    assert abs(x - 340) < w and abs(y - 250) < h


def test_a_search_is_for_the_whole_of_an_object_that_went_out_of_sight(monkeypatch):
    asked = []

    def spy(box_xyxy, *more):
        asked.append(box_xyxy)
        return places(box_xyxy, *more)

    monkeypatch.setattr("re3.tracker.places", spy)
    engine = Counter()
    tracker = re3.Tracker(engine=engine)
    tracker.init(noise(300, 400), BOX)
    tracker.update(noise(300, 400))
    engine.score = 0.7  # tracked, though .75 is usual
    left, top, right, bottom = STILL
    engine.corners = left, top, right, (top + bottom) / 2
    half = tracker.update(noise(300, 400))
    assert half.status is Status.TRACKED
    assert half.box_xywh[3] < 0.6 * BOX[3]
    engine.score, engine.corners = 0.1, STILL
    tracker.update(noise(300, 400))
    (searched,) = asked
    np.testing.assert_allclose(searched[2:] - searched[:2], BOX[2:], atol=1e-3)
    x, y, w, h = half.box_xywh
    np.testing.assert_allclose(searched[:2] + searched[2:], (2 * x + w, 2 * y + h), atol=1e-3)


def test_a_search_in_vain_leaves_the_track_as_it_was():
    results = []
    for search in (True, False):
        tracker = re3.Tracker(engine=Counter(score=0.1, corners=(3, 3, 8, 8)), search=search)
        tracker.init(noise(), BOX)
        results.append([tracker.update(noise()) for _ in range(5)])
    assert results[0] == results[1]


def test_a_search_goes_on_from_a_saved_state():
    frames, engine = reappearing((112, 90)), Elsewhere(blind=20)
    tracker = re3.Tracker(engine=engine)
    tracker.init(frames[0], BOX)
    for frame in frames[1:4]:
        tracker.update(frame)
    again = re3.Tracker(engine=engine)
    again.load_state(tracker.save_state())
    for frame in frames[4:]:
        assert again.update(frame) == tracker.update(frame)


WITHOUT_PREVIOUS = replace(SPEC, previous=None)


def panned(steps, size=(300, 400), seed=3):
    """Frames of a camera that makes these steps, in pixels, over a ground without objects."""
    coarse = noise(60, 80, seed)
    world = cv2.resize(coarse, (960, 720), interpolation=cv2.INTER_CUBIC)
    places_seen = np.cumsum([(200, 200), *steps], axis=0)
    return [world[y : y + size[0], x : x + size[1]] for x, y in places_seen.tolist()]


def looked_about(tracker, frames, box=BOX):
    """Centres of the boxes found by an engine that always finds the middle of its crop."""
    tracker.init(frames[0], box)
    boxes = [tracker.update(frame).box_xywh for frame in frames[1:]]
    return [(x + w / 2, y + h / 2) for x, y, w, h in boxes]


def test_what_a_camera_moves_is_looked_for_where_it_moves_it():
    frames = panned([(-12, 0), (-12, 0)])
    (x, y), (x_then, _) = looked_about(re3.Tracker(engine=Counter(spec=WITHOUT_PREVIOUS)), frames)
    # Half of its guesses are of a still camera, as long as none has been wrong.
    assert (x - 52, y - 40) == pytest.approx((6, 0), abs=1)
    assert x_then > x + 3


@pytest.mark.parametrize(
    ("spec", "options"),
    [(WITHOUT_PREVIOUS, {"motion": False}), (SPEC, {}), (SPEC, {"motion": True})],
    ids=["told not to", "shown a pair", "shown a pair, told to"],
)
def test_what_has_to_be_seen_where_it_was_is_looked_for_there(spec, options):
    tracker = re3.Tracker(engine=Counter(spec=spec), **options)
    for x, y in looked_about(tracker, panned([(-12, 0), (-12, 0)])):
        assert (x, y) == pytest.approx((52, 40), abs=1e-3)


def test_a_lost_object_does_not_go_with_the_camera():
    frames = panned([(-12, 0)] * 3)
    engine = Counter(spec=WITHOUT_PREVIOUS, score=0.1)
    tracker = re3.Tracker(engine=engine, search=False)
    first, *others = looked_about(tracker, frames)
    assert first[0] > 56  # seen before
    assert others == [pytest.approx(first, abs=1e-3)] * 2


def test_a_cut_moves_nothing():
    frames = [panned([])[0], panned([], seed=4)[0]]
    ((x, y),) = looked_about(re3.Tracker(engine=Counter(spec=WITHOUT_PREVIOUS)), frames)
    assert (x, y) == pytest.approx((52, 40), abs=1e-3)


def test_an_object_of_its_own_motion_is_looked_for_further_on_until_it_is_lost():
    engine = Counter(spec=WITHOUT_PREVIOUS, corners=(4.5, 2.5, 9.5, 7.5))
    tracker = re3.Tracker(engine=engine, search=False, framing=False)
    frame = noise(300, 1200)
    step, w = [], BOX[2]
    found = [tracker.init(frame, BOX)]
    for _ in range(6):
        found.append(tracker.update(frame))
        step.append(found[-1].box_xywh[0] - found[-2].box_xywh[0])
    # Two fifths of a box right of the middle of each crop, and the crops go ahead as well.
    assert step[0] == pytest.approx(0.4 * w, abs=0.5)
    assert step[-1] > 0.55 * w
    engine.corners, engine.score = STILL, 0.1
    lost = tracker.update(frame)
    assert lost.status is Status.LOST
    gone = tracker.update(frame)
    assert gone.box_xywh == pytest.approx(lost.box_xywh, abs=1e-3)


def test_what_a_search_finds_has_not_moved_there():
    engine = Elsewhere(blind=70)  # but for all of the object
    engine.spec = replace(engine.spec, previous=None)
    tracker = re3.Tracker(engine=engine)
    here, there = noise(200, 400) // 6, noise(200, 400) // 6  # a ground that does not move
    here[30:50, 40:64] = there[30:50, 76:100] = 255
    tracker.init(here, BOX)
    tracker.update(here)
    found = tracker.update(there)
    assert (found.status, found.box_xywh[0]) == (Status.TRACKED, pytest.approx(76, abs=2))
    assert tracker.update(there).box_xywh == pytest.approx(found.box_xywh, abs=1e-3)


def test_a_saved_state_knows_how_object_and_camera_move():
    frames = panned([(-12, 0)] * 8)
    engine = Counter(spec=WITHOUT_PREVIOUS)
    tracker = re3.Tracker(engine=engine)
    tracker.init(frames[0], BOX)
    for frame in frames[1:5]:
        tracker.update(frame)
    other = re3.Tracker(engine=engine)
    other.load_state(tracker.save_state())
    assert [other.update(f) for f in frames[5:]] == [tracker.update(f) for f in frames[5:]]
    assert tracker.update(frames[-1]).box_xywh[0] > BOX[0] + 30


def test_a_tracker_started_anew_forgets_the_frame_before():
    frames = panned([(-12, 0)])
    tracker = re3.Tracker(engine=Counter(spec=WITHOUT_PREVIOUS), framing=False)
    tracker.init(frames[0], BOX)
    tracker.init(frames[1], BOX)
    assert tracker.update(frames[1]).box_xywh == pytest.approx(BOX, abs=1e-3)


def test_objects_added_later_reset_on_their_own_clock():
    engine = Counter()
    tracker = re3.MultiTracker(engine=engine)
    tracker.add(noise(), BOX)
    for _ in range(10):
        tracker.update(noise())
    tracker.add(noise(), BOX)
    for _ in range(30):
        tracker.update(noise())
    counts = engine.calls[-1][2][:, 0].astype(int).tolist()
    assert counts == [8, 30]


@pytest.mark.parametrize(
    "corners",
    [
        (np.nan, 0, 1, 1),  # not a number
        (np.inf, 0, -np.inf, 1),  # infinite
        (9, 9, 1, 1),  # inside out
        (5, 5, 5, 5),  # no area
        (1e9, 1e9, 2e9, 2e9),  # far away
        (-1e9, -1e9, 1e9, 1e9),  # vast
    ],
)
def test_the_box_is_always_finite_and_has_size(corners):
    tracker = re3.Tracker(engine=Counter(corners=corners))
    tracker.init(noise(), BOX)
    for _ in range(5):
        box = np.array(tracker.update(noise()).box_xywh)
        assert np.isfinite(box).all()
        assert (box[2:] > 0).all()


@pytest.mark.parametrize("corners", [(0, 0, 10, 10), (4.9, 4.9, 5.1, 5.1)])
def test_a_box_without_object_neither_grows_nor_shrinks_for_ever(corners):
    engine = Counter(score=0.1, corners=corners)
    tracker = re3.Tracker(engine=engine, search=False)
    tracker.init(noise(), BOX)
    for _ in range(10):
        result = tracker.update(noise())
    change = np.array(result.box_xywh[2:]) / BOX[2:]
    np.testing.assert_allclose(change, 1.5 if corners[0] == 0 else 1 / 1.5)
    engine.score = 0.9  # one that is sure may have any size
    change = np.array(tracker.update(noise()).box_xywh[2:]) / BOX[2:]
    assert (change > 2).all() or (change < 0.5).all()


def test_what_a_score_means_depends_on_what_it_usually_is():
    statuses = []
    for usual in (0.95, 0.65):
        engine = Counter(score=usual)
        tracker = re3.Tracker(engine=engine, search=False)
        tracker.init(noise(), BOX)
        for _ in range(60):
            tracker.update(noise())
        again = re3.Tracker(engine=engine, search=False)
        again.load_state(tracker.save_state())  # it is part of the state
        engine.score = 0.5
        statuses.append([one.update(noise()).status for _ in range(2) for one in (tracker, again)])
    lasting = [Status.UNCERTAIN] * 2 + [Status.LOST] * 2
    assert statuses == [lasting, [Status.TRACKED] * 4]


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (None, "NoneType.*uint8"),  # as OpenCV gives at the end of a video
        (np.zeros((10, 10, 3)), "float64.*0..255"),
        (np.zeros((10, 10, 2), np.uint8), r"\(10, 10, 2\)"),
        (np.zeros((0, 10, 3), np.uint8), "no pixels"),
        (np.zeros(10, np.uint8), r"\(10,\)"),
    ],
)
def test_unusable_frames_are_refused_and_nothing_changes(frame, message):
    tracker = re3.Tracker(engine=Counter())
    with pytest.raises(ValueError, match=message):
        tracker.init(frame, BOX)
    first = tracker.init(noise(), BOX)
    with pytest.raises(ValueError, match=message):
        tracker.update(frame)
    assert tracker.update(noise()).frame_index == first.frame_index + 1


def test_unusable_boxes_are_refused_and_the_object_before_stays():
    tracker = re3.Tracker(engine=Counter())
    tracker.init(noise(), BOX)
    for box in [(0, 0, 0, 5), (0, 0, 5, -5), (np.nan, 0, 5, 5), (500, 500, 5, 5)]:
        with pytest.raises(ValueError, match="box"):
            tracker.init(noise(), box)
    np.testing.assert_allclose(tracker.update(noise()).box_xywh, BOX, atol=1e-4)


def test_update_before_init_says_what_to_do():
    with pytest.raises(RuntimeError, match=r"init\(\)"):
        re3.Tracker(engine=Counter()).update(noise())


def test_frames_of_all_kinds_give_the_same_as_bgr():
    grey = noise()[:, :, 0]
    bgr = np.repeat(grey[:, :, None], 3, axis=2)
    bgra = np.dstack([bgr, np.full(grey.shape, 9, np.uint8)])
    wide = np.repeat(bgr, 2, axis=1)[:, ::2]
    expected = None
    for frame in (bgr, grey, grey[:, :, None], bgra, wide):
        engine = Counter()
        tracker = re3.Tracker(engine=engine)
        tracker.init(frame, BOX)
        tracker.update(frame)
        crops = engine.calls[-1][1]
        expected = crops if expected is None else expected
        np.testing.assert_array_equal(crops, expected)


def test_frames_may_change_size():
    tracker = re3.Tracker(engine=Counter())
    tracker.init(noise(100, 140), BOX)
    for size in ((50, 70), (300, 200), (8, 8)):
        box = tracker.update(noise(*size)).box_xywh
        assert np.isfinite(box).all()


def test_the_callers_frame_is_neither_changed_nor_kept():
    engine = Counter()
    tracker, frame = re3.Tracker(engine=engine), noise()
    copy = frame.copy()
    tracker.init(frame, BOX)
    np.testing.assert_array_equal(frame, copy)
    frame[:] = 0  # as a camera's buffer is overwritten
    tracker.update(noise(seed=1))
    assert engine.calls[-1][0].any()


def test_objects_are_added_named_and_removed():
    tracker = re3.MultiTracker(engine=Counter())
    assert tracker.update(noise()) == {}
    a = tracker.add(noise(), BOX)
    b = tracker.add(noise(), (10, 10, 20, 20), name="dog")
    results = tracker.update(noise())
    assert list(results) == [a, b]
    assert (results[a].label, results[b].label) == (str(a), "dog")
    tracker.remove(a)
    assert list(tracker.update(noise())) == [b]
    with pytest.raises(KeyError, match=rf"no object {a}; tracked are \[{b}\]"):
        tracker.remove(a)
    assert tracker.add(noise(), BOX) not in (a, b)


@pytest.fixture(scope="module")
def walk():
    """The bundled clip: frames, and boxes of the person, the table, the picture, the pillar."""
    with open_source(CLIP) as source:
        frames = [frame.image for frame in source]
    return frames, [PERSON, (440, 80, 146, 260), (-10, -20, 115, 190), (540, -10, 90, 275)]


def test_many_objects_equal_single_trackers(walk):
    frames, boxes = walk
    multi = re3.MultiTracker()
    singles = [re3.Tracker() for _ in boxes]
    ids = [multi.add(frames[0], box) for box in boxes]
    for tracker, box in zip(singles, boxes, strict=True):
        tracker.init(frames[0], box)
    for frame in frames[1:40]:
        together = multi.update(frame)
        for identity, tracker in zip(ids, singles, strict=True):
            alone = tracker.update(frame)
            np.testing.assert_allclose(together[identity].box_xywh, alone.box_xywh, atol=0.1)
            assert together[identity].score == pytest.approx(alone.score, abs=1e-3)


def test_a_saved_state_resumes_exactly(walk, tmp_path):
    frames, boxes = walk
    tracker = re3.Tracker()
    tracker.init(frames[0], boxes[0])
    for frame in frames[1:20]:
        tracker.update(frame)
    np.savez(tmp_path / "state.npz", **tracker.save_state())
    expected = [tracker.update(frame) for frame in frames[20:60]]
    resumed = re3.Tracker()
    with np.load(tmp_path / "state.npz") as saved:
        resumed.load_state(saved)
    assert [resumed.update(frame) for frame in frames[20:60]] == expected


def test_a_saved_state_keeps_ids_and_names():
    tracker = re3.MultiTracker(engine=Counter())
    tracker.add(noise(), BOX)
    tracker.add(noise(), BOX, name="dog")
    tracker.remove(1)
    other = re3.MultiTracker(engine=Counter())
    other.load_state(tracker.save_state())
    assert other.results == tracker.results
    assert other.add(noise(), BOX) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.update(model=np.array("other")), "saved with model 'other'"),
        (lambda s: s.pop("ids"), "lacks 'ids'"),
        (lambda s: s.pop("1/state/count"), "lacks '1/state/count'"),
        (lambda s: s.update({"1/state/count": np.zeros(7)}), r"shape \(7,\).*expects \(1,\)"),
    ],
)
def test_a_state_that_does_not_fit_is_refused_and_nothing_changes(change, message):
    tracker = re3.MultiTracker(engine=Counter())
    tracker.add(noise(), BOX)
    saved = tracker.save_state()
    change(saved)
    with pytest.raises(ValueError, match=message):
        tracker.load_state(saved)
    assert list(tracker.results) == [1]


def test_import_is_light():
    code = (
        # Time of the processor, which other programs on the machine do not lengthen.
        "import sys, time; start = time.process_time(); import re3; "
        "print(time.process_time() - start, *(m in sys.modules for m in ('torch', 'matplotlib')))"
    )
    runs = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(3)
    ]
    outputs = [run.stdout.split() for run in runs]
    assert all(output[1:] == ["False", "False"] for output in outputs)
    assert min(float(output[0]) for output in outputs) < 0.5


def test_the_shipped_model_holds_on_to_the_person(walk):
    frames, boxes = walk
    drawn_by_hand = {30: (384, 14, 128, 378), 110: (398, 16, 140, 374)}
    tracker = re3.Tracker()
    tracker.init(frames[0], boxes[0])
    for index, frame in enumerate(frames[1:], start=1):
        result = tracker.update(frame)
        if index in drawn_by_hand:
            assert geometry.iou_xywh(result.box_xywh, drawn_by_hand[index]) > 0.6
            assert result.status is Status.TRACKED
