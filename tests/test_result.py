"""How a result prints."""

import pytest

from re3.result import Result, Status

BOX = (384.04, 62.55, 150.2499, 369.5)


@pytest.mark.parametrize(
    ("result", "shown", "said"),
    [
        (
            Result(BOX, 0.912, Status.TRACKED, 1),
            "Result(box_xywh=(384.0, 62.5, 150.2, 369.5), score=0.91, status=TRACKED, "
            "frame_index=1)",
            "object 0, frame 1: 150.2 x 369.5 at (384.0, 62.5), score 0.91, tracked",
        ),
        (
            Result((0.0, 0.0, 1.0, 2.0), float("nan"), Status.LOST, 20, 3, "the 'red' car"),
            "Result(box_xywh=(0.0, 0.0, 1.0, 2.0), score=nan, status=LOST, frame_index=20, "
            "object_id=3, name=\"the 'red' car\")",
            "the 'red' car, frame 20: 1.0 x 2.0 at (0.0, 0.0), score nan, lost",
        ),
    ],
)
def test_a_result_prints_short_and_whole(result, shown, said):
    assert repr(result) == shown
    assert str(result) == said
