import cv2
import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs torch (the train extra)")

from re3.apps.validation import Validation, figures
from re3.data.plain import read_folder
from re3.evaluation.floors import FirstBox

HERE, THERE = "5,5,20,20", "40,20,20,20"


@pytest.fixture
def clips(tmp_path):
    """Folder of clips `a`, `b`, ... of 20 frames, each with an object that leaps or does not."""

    def write(*boxes_of_clips):
        for name, boxes in zip("abcdefgh", boxes_of_clips, strict=False):
            (tmp_path / name).mkdir()
            for index in range(len(boxes)):
                picture = np.zeros((48, 64, 3), np.uint8)
                cv2.imwrite(str(tmp_path / name / f"{index:04d}.png"), picture)
            (tmp_path / f"{name}.txt").write_text("".join(f"{box}\n" for box in boxes))
        return tmp_path

    return write


def test_drops_are_counted_with_the_tracker_started_again(clips):
    folder = clips([HERE] * 20, [HERE] * 5 + [THERE] * 15)
    got = figures(FirstBox, read_folder(folder))
    # The second clip is right in a quarter of its frames; at the threshold of 1 nothing is.
    assert got["AUC"] == pytest.approx((1 + 0.25) / 2 * 20 / 21)
    assert got["drops"] == 1
    # Counted are 20 frames of the first clip and, of the second, five and that of the drop: the
    # nine left begin with the restart, within its ten frames of grace.
    assert got["accuracy"] == pytest.approx(25 / 26)
    assert got["robustness"] == pytest.approx(np.exp(-30 / 40))
    assert next(iter(got)) == "AUC"  # decides which weights are best


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (None, "abcde"),
        (9, "abcde"),
        (5, "abcde"),
        (3, "ace"),
        (2, "ae"),
        (1, "a"),
    ],
)
def test_clips_are_taken_evenly(clips, count, expected):
    folder = clips(*[[HERE] * 2] * 5)
    assert "".join(s.name for s in Validation(folder, count).sequences) == expected


def test_a_number_of_clips_below_one_is_refused(clips):
    with pytest.raises(ValueError, match="0 clips to validate on; expected 1 or more"):
        Validation(clips([HERE] * 2), 0)
