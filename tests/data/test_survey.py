"""Figures and pictures of what is sampled, against clips whose every box is known."""

import numpy as np
import pytest

from re3.data.augment import AugmentedClip
from re3.data.clip import Origin, RecordedClip
from re3.data.contact_sheet import ABSENT, OCCLUDED, PRESENT, caption, contact_sheet
from re3.data.photometric_config import PhotometricConfig
from re3.data.survey import Survey, clip_facts, survey

QUIET = PhotometricConfig(gain=0, offset=0, tint=0, grey=0, blur=0, motion_blur=0, noise=0, jpeg=0)
NAN = (np.nan,) * 4


def clip(boxes, visible=None, **origin):
    frames = [np.full((100, 100, 3), 90, np.uint8)] * len(boxes)
    recorded = RecordedClip(frames, boxes, (127.0,) * 3)
    if visible is not None:
        recorded.visible = np.array(visible)
    known = {"source": "mine", "kind": "videos", "name": "duck", **origin}
    return AugmentedClip(recorded, np.random.default_rng(0), QUIET, Origin(**known))


def test_facts_of_a_clip():
    boxes = [(10, 10, 30, 30), (20, 10, 40, 30), (20, 10, 60, 50), NAN, (0, 0, 9, 4)]
    facts = clip_facts(clip(boxes))
    np.testing.assert_allclose(facts.sizes, [20, 20, 40, np.nan, 6])
    # Ten pixels of twenty; then the centre goes by 10 and 10; nothing into or out of a gap.
    np.testing.assert_allclose(facts.motion, [0.5, np.sqrt(0.5), np.nan, np.nan])
    np.testing.assert_allclose(facts.growth, [1, 2, np.nan, np.nan])
    assert facts.absent.tolist() == [0, 0, 0, 1, 0]
    assert np.isnan(facts.hidden).all()  # nothing is known


def test_occlusion_is_simulated_or_marked():
    boxes = [(10, 10, 30, 30), (20, 10, 40, 30), NAN]
    simulated = clip_facts(clip(boxes, [1.0, 0.25, 0.0], kind="stills"))
    np.testing.assert_allclose(simulated.hidden, [0, 0.75, np.nan])
    marked = clip_facts(clip(boxes, occluded=np.array([False, True, True])))
    np.testing.assert_allclose(marked.hidden, [0, 1, np.nan])


def test_facts_of_sources():
    one = clip_facts(clip([(0, 0, 20, 20)] * 2 + [NAN] * 2))
    other = clip_facts(clip([(0, 0, 40, 40), (4, 0, 44, 40)] * 2, [1, 0.4, 1, 1], kind="stills"))
    declared = {("mine", "videos"): 0.5, ("mine", "stills"): 0.25, ("none", "videos"): 0.25}
    mine, simulated, none = Survey((one, other, other), declared).sources()
    assert (mine.clips, mine.drawn, mine.declared, mine.absent) == (1, 1 / 3, 0.5, 0.5)
    assert mine.size == (20, 20, 20)
    assert np.isnan(mine.occluded)
    assert (simulated.clips, simulated.occluded, simulated.absent) == (2, 0.25, 0)
    assert simulated.motion == pytest.approx((0.1, 0.1, 0.1))
    assert simulated.growth == pytest.approx((0, 0, 0))
    assert (none.clips, none.drawn) == (0, 0)
    assert np.isnan([*none.size, none.occluded, none.absent]).all()


def test_a_survey_draws_as_many_clips_as_asked_and_the_same_again():
    class Sampler:
        def sample(self, frames, rng):
            x = rng.uniform(0, 50)
            return clip([(x, 0, x + 20, 20)] * frames)

        def shares(self):
            return {("mine", "videos"): 1.0}

    done = []
    first = survey(Sampler(), 5, 3, seed=1, on_progress=done.append)
    again = survey(Sampler(), 5, 3, seed=1)
    assert done == [1, 2, 3, 4, 5]
    assert [len(c.sizes) for c in first.clips] == [3] * 5
    for a, b in zip(first.clips, again.clips, strict=True):
        np.testing.assert_array_equal(a.sizes, b.sizes)
    with pytest.raises(ValueError, match="0 clips of 3 frames; expected 1 or more"):
        survey(Sampler(), 0, 3)


def colours(cell):
    return {
        name
        for name, colour in (("green", PRESENT), ("orange", OCCLUDED), ("red", ABSENT))
        if (cell == colour).all(axis=2).any()
    }


def cells(sheet, frames, size):
    """The crops of the only row, below its caption."""
    row = sheet[-size - 2 :]
    return [row[:size, t * (size + 2) : t * (size + 2) + size] for t in range(frames)]


def test_the_sheet_draws_the_target_in_the_crop_of_the_frame_before():
    boxes = [(40, 40, 60, 60), (46, 40, 66, 60), NAN, (46, 40, 66, 60), (46, 40, 66, 60)]
    sheet = contact_sheet([clip(boxes, [1, 1, 0, 0.4, 1])], context=2.0, size=64)
    assert sheet.shape[1] == 5 * (64 + 2)
    shown = cells(sheet, 5, 64)
    assert [colours(cell) for cell in shown] == [
        {"green"}, {"green"}, {"red"}, {"orange"}, {"green"}
    ]  # fmt: skip
    for cell, left in ((shown[0], 16), (shown[1], 16 + round(6 / 40 * 64))):
        _, columns = np.nonzero((cell == PRESENT).all(axis=2))
        assert abs(columns.min() - left) <= 1
        assert abs(columns.max() + 1 - left - 32) <= 2


def test_a_target_that_leaves_the_crop_is_marked():
    boxes = [(0, 0, 20, 20), (60, 60, 80, 80)]
    assert [colours(c) for c in cells(contact_sheet([clip(boxes)], 2.0, 64), 2, 64)] == [
        {"green"}, {"red"}
    ]  # fmt: skip


def test_a_row_a_clip_and_clips_of_one_length():
    one, two = clip([(0, 0, 20, 20)] * 2), clip([(0, 0, 20, 20)] * 3)
    assert contact_sheet([one, one], size=64).shape[0] == 2 * contact_sheet([one], size=64).shape[0]
    with pytest.raises(ValueError, match=r"2 clips of \[2, 3\] frames; expected .* one length"):
        contact_sheet([one, two])


@pytest.mark.parametrize(
    ("origin", "told"),
    [
        ({}, "mine, duck, simulated, 20 x 10 px, absent in 1"),
        ({"frames": np.array([7, 5, 3])}, "mine, duck, frames 7 to 3, stride 2, 20 x 10 px"),
        ({"frames": np.array([3, 4, 5]), "mirrored": True}, "frames 3 to 5, mirrored, 20 x 10 px"),
    ],
)
def test_the_caption_says_what_it_is(origin, told):
    assert told in caption(clip([(0, 0, 20, 10), NAN, (0, 0, 20, 10)], **origin))
