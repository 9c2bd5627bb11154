import numpy as np
import pytest

from re3.evaluation.supervised import Step, SupervisedConfig, SupervisedTrack, run_supervised

NAN = (np.nan,) * 4
BOX = (0.0, 0.0, 2.0, 2.0)
FAR = (50.0, 50.0, 2.0, 2.0)
EDGE = (2.0, 0.0, 2.0, 2.0)  # touches BOX, overlaps by nothing
HALF = (1.0, 0.0, 2.0, 2.0)  # overlaps BOX by a third


class Says:
    """Gives for the frame of grey level t the t-th of some boxes."""

    made = 0

    def __init__(self, boxes):
        self.boxes = boxes

    def init(self, frame, box_xywh):
        self.started = int(frame[0, 0, 0])

    def update(self, frame):
        box = self.boxes[int(frame[0, 0, 0])]
        if isinstance(box, Exception):
            raise box
        return box, 0.5


def letters(track) -> str:
    return "".join("fSX-"[step] for step in track.steps)


@pytest.mark.parametrize(
    ("said", "config", "expected"),
    [
        ([BOX] * 8, SupervisedConfig(), "Sfffffff"),
        ([BOX, FAR, *[BOX] * 6], SupervisedConfig(), "SX----Sf"),  # five frames later
        ([BOX, FAR, *[BOX] * 6], SupervisedConfig(restart_after=1), "SXSfffff"),
        ([BOX, EDGE, *[BOX] * 6], SupervisedConfig(restart_after=1), "SXSfffff"),  # touching
        ([BOX, HALF, *[BOX] * 6], SupervisedConfig(restart_after=1), "Sfffffff"),
        ([BOX, HALF, *[BOX] * 6], SupervisedConfig(1, fails_at=0.4), "SXSfffff"),
        ([BOX, FAR, BOX, FAR, *[BOX] * 4], SupervisedConfig(1), "SXSXSfff"),
        # Frame 3 is the second of a grace of two, frame 4 the first after it.
        ([BOX, FAR, BOX, FAR, FAR, *[BOX] * 3], SupervisedConfig(1, grace=2), "SXSfXSff"),
        ([*[BOX] * 5, FAR, BOX, BOX], SupervisedConfig(), "SffffX--"),  # no start any more
        ([BOX, FAR] * 4, SupervisedConfig(grace=10), "SX----Sf"),  # none after the first start
    ],
)
def test_when_it_fails_and_starts_again(sequence_of, said, config, expected):
    track = run_supervised(lambda: Says(said), sequence_of([BOX] * 8), config)
    assert letters(track) == expected
    assert track.drops == expected.count("X")
    followed = track.steps == Step.FOLLOWED
    started = track.steps == Step.STARTED
    np.testing.assert_array_equal(track.boxes_xywh[followed], np.array(said)[followed])
    np.testing.assert_array_equal(track.boxes_xywh[started], np.array([BOX] * started.sum()))
    assert np.isnan(track.boxes_xywh[~followed & ~started]).all()
    assert np.isfinite(track.seconds).tolist() == [letter != "-" for letter in expected]


@pytest.mark.parametrize(
    ("said", "exact", "pixels"),
    [
        # Overlaps by less than a pixel: none in common once both are rounded.
        ((1.6, 0.0, 2.0, 2.0), "Sfff", "SXSX"),
        ((0.0, 1.51, 2.0, 2.0), "Sfff", "SXSX"),
        ((1.4, 0.0, 2.0, 2.0), "Sfff", "Sfff"),  # rounded, they share a column
        # Beside each other, and yet with a column in common once rounded.
        ((2.0, 0.0, 2.0, 2.0), "SXSX", "SXSX"),
        ((-2.4, 0.0, 2.4, 2.0), "SXSX", "SXSX"),
        ((-1.4, 0.0, 2.0, 2.0), "Sfff", "Sfff"),
        # In common outside the frame of 4 x 4 alone.
        ((0.0, -9.0, 2.0, 9.0), "SXSX", "SXSX"),
    ],
)
def test_failure_by_whole_pixels_and_by_exact_overlap(sequence_of, said, exact, pixels):
    for by_pixels, expected in ((False, exact), (True, pixels)):
        config = SupervisedConfig(restart_after=1, by_pixels=by_pixels)
        track = run_supervised(lambda: Says([said] * 4), sequence_of([BOX] * 4), config)
        assert letters(track) == expected


def test_each_start_gets_a_fresh_tracker(sequence_of):
    made = []

    def factory():
        made.append(Says([BOX, FAR, BOX, FAR, BOX]))
        return made[-1]

    run_supervised(factory, sequence_of([BOX] * 5), SupervisedConfig(restart_after=1))
    assert [tracker.started for tracker in made] == [0, 2, 4]


def test_without_truth_nothing_fails_and_nothing_starts(sequence_of):
    truth = [NAN, BOX, NAN, BOX, NAN, NAN, BOX]
    said = [BOX, BOX, FAR, FAR, BOX, BOX, BOX]
    track = run_supervised(lambda: Says(said), sequence_of(truth), SupervisedConfig(1))
    assert letters(track) == "-SfX--S"


@pytest.mark.parametrize(("wait", "expected"), [(False, "SXSfff"), (True, "SX--Sf")])
def test_it_may_wait_until_the_object_is_seen(sequence_of, wait, expected):
    sequence = sequence_of([BOX] * 6)
    # Occluded at the very first, too, where there is nothing to wait for.
    object.__setattr__(sequence, "occluded", np.array([1, 1, 1, 1, 0, 0], bool))
    said = [BOX, FAR, BOX, BOX, BOX, BOX]
    config = SupervisedConfig(restart_after=1, wait_for_sight=wait)
    assert letters(run_supervised(lambda: Says(said), sequence, config)) == expected


def test_a_tracker_that_breaks_is_not_started_again(sequence_of):
    said = [BOX, BOX, RuntimeError("no more"), BOX, BOX]
    track = run_supervised(lambda: Says(said), sequence_of([BOX] * 5), SupervisedConfig(1))
    assert letters(track) == "SfX--"
    assert track.failure == "frame 2: update raised RuntimeError: no more"


def test_times_of_starts_are_no_updates(sequence_of):
    said = [BOX, FAR, BOX, BOX]
    track = run_supervised(lambda: Says(said), sequence_of([BOX] * 4), SupervisedConfig(1))
    assert letters(track) == "SXSf"
    plain = track.as_track()
    # The frame of the failure and the one followed; neither of the two starts.
    np.testing.assert_array_equal(plain.update_seconds, track.seconds[[1, 3]])


@pytest.mark.parametrize(
    "wrong", [{"restart_after": 0}, {"fails_at": 1.0}, {"fails_at": -0.1}, {"grace": -1}]
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SupervisedConfig(**wrong)


def test_arrays_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"expected \[T, 4\], \[T\] and \[T\]"):
        SupervisedTrack(np.zeros((3, 4)), np.zeros(2, np.int8), np.zeros(3))
