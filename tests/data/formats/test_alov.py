import layouts
import numpy as np
import pytest

from re3.data.formats import read_dataset

ANN = "annotations/01-Light/01-Light_video00001.ann"


def test_sparse_boxes_are_the_outermost_of_their_corners(tmp_path):
    (video,) = read_dataset(layouts.alov(tmp_path / "ALOV"))
    gap = layouts.NAN
    np.testing.assert_array_equal(video.boxes_xywh, [[4, 2, 6, 4], gap, gap, gap, [8, 2, 6, 4]])
    assert (video.name, video.dataset) == ("01-Light_video00001", "ALOV")
    assert (video.start_frame, video.attributes) == (0, ("Light",))
    assert video.source == tmp_path / "ALOV/imagedata++/01-Light/01-Light_video00001"


def test_interpolation_is_an_option(tmp_path):
    (video,) = read_dataset(layouts.alov(tmp_path), "alov-interpolated")
    np.testing.assert_allclose(video.boxes_xywh, [[4 + t, 2, 6, 4] for t in range(5)])


def test_a_track_that_starts_late(tmp_path):
    layouts.text(layouts.alov(tmp_path) / ANN, "3 2 2 4 2 4 5 2 5", "4 2 2 2 2 2 2 2 2")
    (video,) = read_dataset(tmp_path)
    # The second has no area and no later one follows.
    assert (video.start_frame, video.boxes_xywh.tolist()) == (2, [[1, 1, 2, 3]])


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["1 2 3 4"], "line 1: 4 numbers; expected frame x1 y1"),
        (["1 2 2 4 2 4 5 2 5", "8 2 2 4 2 4 5 2 5"], "line 2: .* has no image 8"),
        (["1 a b c d e f g h"], "line 1: .* is not numbers"),
        (["1 2 2 2 2 2 2 2 2"], "no line has a box with an area"),
    ],
)
def test_broken_annotations_name_the_line(tmp_path, lines, told):
    layouts.text(layouts.alov(tmp_path) / ANN, *lines)
    with pytest.raises(ValueError, match=rf"video00001\.ann.*{told}"):
        read_dataset(tmp_path)


def test_a_missing_video_is_told(tmp_path):
    layouts.text(layouts.alov(tmp_path) / ANN.replace("00001", "00002"), "1 2 2 4 2 4 5 2 5")
    with pytest.raises(FileNotFoundError, match="video00002 does not exist; expected a folder of"):
        read_dataset(tmp_path)
