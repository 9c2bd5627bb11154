import io

import numpy as np
import pytest

from re3.evaluation.frame_log import FrameLog, Step


def filled(journal=None) -> FrameLog:
    log = FrameLog(5, journal)
    log.add(0, Step.SKIPPED, decode_seconds=0.1)
    log.add(1, Step.STARTED, (0.1, -2, 3, 1 / 3), 1.0, 0.25, 0.1)
    log.add(2, Step.FOLLOWED, np.array([1e-9, 2, 3, 4]), 0.3, 0.5)
    log.add(3, Step.FAILED, seconds=0.125)
    return log


@pytest.mark.parametrize(
    ("cut", "done"),
    [
        (0, 4),  # all of it
        (1, 3),  # the last line has lost its end
        (12, 3),
    ],
)
def test_a_journal_reads_back_bit_for_bit(tmp_path, cut, done):
    stream = io.StringIO()
    log = filled(stream)
    text = stream.getvalue()
    path = tmp_path / "journal"
    path.write_text(text[: len(text) - cut])
    read = FrameLog.read(path, 5)
    assert read.done == done
    for name in ("boxes_xywh", "steps", "scores", "seconds", "decode_seconds"):
        np.testing.assert_array_equal(getattr(read, name)[:done], getattr(log, name)[:done])
    assert (read.steps[done:] == Step.SKIPPED).all()
    assert np.isnan(read.boxes_xywh[done:]).all()


def test_each_frame_is_on_disk_when_it_is_known(tmp_path):
    path = tmp_path / "journal"
    with path.open("w") as journal:
        log = FrameLog(3, journal)
        for index in range(3):
            log.add(index, Step.FOLLOWED, (index, 0, 1, 1))
            assert FrameLog.read(path, 3).done == index + 1


def test_without_a_journal_nothing_is_known(tmp_path):
    assert FrameLog.read(tmp_path / "gone", 3).done == 0
