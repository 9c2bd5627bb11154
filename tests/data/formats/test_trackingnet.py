import layouts
import pytest

from re3.data.formats import read_dataset


def test_frames_are_in_the_order_of_their_numbers_and_boxes_as_they_stand(tmp_path):
    (video,) = read_dataset(layouts.trackingnet(tmp_path / "TrackingNet"))
    assert video.boxes_xywh[:, 0].tolist() == list(range(1, 13))
    assert (video.name, video.dataset) == ("a_1", "TrackingNet-TRAIN_0")
    # Image 10 is the eleventh, not the third.
    assert int(list(video.frames())[10][0, 0, 0]) == pytest.approx(100, abs=2)


def test_chunks_come_in_order_and_a_test_video_has_its_first_box_alone(tmp_path):
    layouts.trackingnet(tmp_path)
    for chunk in ("TRAIN_10", "TRAIN_2", "TEST"):
        layouts.images(tmp_path / chunk / "frames" / "b_0", 3, first=0, digits=1)
        rows = 1 if chunk == "TEST" else 3
        layouts.text(tmp_path / chunk / "anno" / "b_0.txt", *layouts.boxes(rows))
    found = read_dataset(tmp_path)
    names = [s.dataset.removeprefix(f"{tmp_path.name}-") for s in found]
    assert names == ["TEST", "TRAIN_0", "TRAIN_2", "TRAIN_10"]
    assert found[0].annotated.tolist() == [True, False, False]


def test_broken_videos_name_the_file(tmp_path):
    text = layouts.trackingnet(tmp_path) / "TRAIN_0" / "anno" / "a_1.txt"
    layouts.text(text, *layouts.boxes(11))
    with pytest.raises(ValueError, match=r"a_1\.txt has 11 lines, but .*a_1 12 images"):
        read_dataset(tmp_path)
    layouts.text(text, *layouts.boxes(12))
    layouts.text(text.with_name("b_1.txt"), *layouts.boxes(2))
    with pytest.raises(FileNotFoundError, match="b_1 does not exist"):
        read_dataset(tmp_path)
