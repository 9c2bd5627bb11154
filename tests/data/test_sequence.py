from pathlib import Path

import cv2
import numpy as np
import pytest

from re3.data.sequence import Sequence

NAN = (np.nan,) * 4
BOX = (1.0, 2.0, 3.0, 4.0)


@pytest.fixture
def pictures(tmp_path) -> Path:
    """Six frames of 16 x 12 pixels; frame t has grey level 10 t."""
    folder = tmp_path / "clip"
    folder.mkdir()
    for index in range(6):
        cv2.imwrite(str(folder / f"{index:04d}.png"), np.full((12, 16, 3), 10 * index, np.uint8))
    return folder


@pytest.mark.parametrize(
    ("boxes", "start", "told"),
    [
        ([], 0, r"shape \(0,\)"),  # no frame
        ([BOX[:3]], 0, r"shape \(1, 3\)"),  # not four numbers
        (BOX, 0, r"shape \(4,\)"),  # one box, not a list of them
        ([BOX, (1, 2, np.nan, 4)], 0, "row 1"),  # half absent
        ([BOX, (1, 2, np.inf, 4)], 0, "row 1"),  # infinite
        ([(1, 2, 0, 4)], 0, "row 0"),  # without area
        ([(1, 2, 3, -4)], 0, "row 0"),  # negative height
        ([BOX], -1, "start_frame is -1"),  # before the clip
    ],
)
def test_what_is_not_a_track_is_refused(boxes, start, told):
    with pytest.raises(ValueError, match=f"'clip'.*{told}"):
        Sequence("clip", Path("clip.mp4"), np.array(boxes), start_frame=start)


def test_boxes_are_a_read_only_copy():
    given = np.array([BOX, NAN])
    sequence = Sequence("clip", Path("clip.mp4"), given)
    given[0] = 0
    assert sequence.boxes_xywh[0].tolist() == list(BOX)
    with pytest.raises(ValueError, match="read-only"):
        sequence.boxes_xywh[0] = 0


def test_length_and_annotated():
    sequence = Sequence("clip", Path("clip.mp4"), np.array([NAN, BOX, NAN]))
    assert len(sequence) == 3
    assert sequence.annotated.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("start", "length", "levels"),
    [
        (0, 6, [0, 10, 20, 30, 40, 50]),  # the whole clip
        (0, 2, [0, 10]),  # boxes end first
        (3, 2, [30, 40]),  # a track that starts late
        (5, 1, [50]),  # the last frame
    ],
)
def test_frames_are_those_of_the_boxes(pictures, start, length, levels):
    sequence = Sequence("clip", pictures, np.array([BOX] * length), start_frame=start)
    frames = list(sequence.frames())
    assert [int(frame[0, 0, 0]) for frame in frames] == levels
    assert all(frame.shape == (12, 16, 3) and frame.dtype == np.uint8 for frame in frames)


def test_more_boxes_than_frames_is_told_after_the_last_frame(pictures):
    sequence = Sequence("clip", pictures, np.array([BOX] * 5), start_frame=2)
    frames = sequence.frames()
    for _ in range(4):
        next(frames)
    with pytest.raises(ValueError, match=r"gives 4 frames from frame 2 on.*5 boxes"):
        next(frames)


def test_marks_and_attributes():
    given = np.array([1, 0])
    sequence = Sequence(
        "clip", Path("clip.mp4"), np.array([BOX, NAN]), occluded=given, attributes=("blur",)
    )
    given[1] = 1
    assert sequence.occluded.tolist() == [True, False]
    assert sequence.attributes == ("blur",)
    with pytest.raises(ValueError, match="read-only"):
        sequence.occluded[0] = False
    with pytest.raises(ValueError, match=r"'clip'.*\(3,\) marks of occlusion for 2 boxes"):
        Sequence("clip", Path("clip.mp4"), np.array([BOX, NAN]), occluded=np.zeros(3))


STILL = (10.0, 10.0, 30.0, 40.0)  # its diagonal is 50 pixels


@pytest.mark.parametrize(
    ("boxes", "told"),
    [
        ([STILL, STILL], []),
        ([NAN, STILL, NAN, NAN], []),
        ([STILL, (60, 10, 30, 40)], []),  # moves by its diagonal
        ([STILL, (61, 10, 30, 40)], ["jump in 1 of 2 frames, first in frame 8"]),
        ([STILL, (10, 10, 60, 80)], []),  # four times the area
        ([STILL, (10, 10, 61, 80)], ["jump in 1 of 2 frames, first in frame 8"]),
        ([(10, 10, 61, 80), STILL], ["jump in 1 of 2 frames, first in frame 8"]),
        ([STILL, NAN, (90, 10, 30, 40)], []),  # across a gap
        ([(9, 9, 4, 4), (9, 9, 3.9, 4)], ["side below 4 px in 1 of 2 frames, first in frame 8"]),
        ([(70, 10, 30, 40)], []),  # its right edge is the frame's
        ([(-29, 10, 30, 40), (99, 79, 30, 40), STILL], ["jump in 2 of 3 frames, first in frame 8"]),
        ([(-30, 10, 30, 40)], ["outside the frame in 1 of 1 frames, first in frame 7"]),
        ([(10, 80, 30, 40)], ["outside the frame in 1 of 1 frames, first in frame 7"]),
    ],
)
def test_problems(boxes, told):
    sequence = Sequence("clip", Path("clip.mp4"), np.array(boxes, dtype=float), start_frame=7)
    assert sequence.problems((100, 80)) == told
    assert sequence.problems() == [line for line in told if "outside" not in line]
