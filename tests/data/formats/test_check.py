import av
import layouts
import numpy as np
import pytest

from re3.data.formats.check import check_dataset


def broken_otb(folder):
    """Two good sequences, one with a broken truth and one with none."""
    layouts.otb(folder)
    layouts.images(folder / "Car" / "img", 4)
    layouts.text(folder / "Car" / "groundtruth_rect.txt", *layouts.boxes(3))
    layouts.images(folder / "Dog" / "img", 2)
    layouts.images(folder / "Fish" / "img", 2)
    layouts.text(folder / "Fish" / "groundtruth_rect.txt", *layouts.boxes(1), "0,0,0,0")
    return folder


def test_a_broken_sequence_does_not_stop_the_check(tmp_path):
    done = []
    name, findings = check_dataset(
        broken_otb(tmp_path / "OTB"), on_progress=lambda *progress: done.append(progress)
    )
    assert name == "otb"
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
    bolt, car, dog, fish = findings
    assert (bolt.name, bolt.dataset, bolt.frames, bolt.boxes, bolt.gaps) == ("Bolt", "OTB", 3, 3, 0)
    assert (bolt.occluded, bolt.median_size) == (None, (3.0, 4.0))
    assert (bolt.errors, len(bolt.warnings)) == ((), 1)
    assert "side below 4 px in 3 of 3 frames" in bolt.warnings[0]
    assert (car.name, car.frames) == ("Car", 0)
    assert "3 lines" in car.errors[0]
    assert "4 images" in car.errors[0]
    assert "Dog has no groundtruth_rect.txt" in dog.errors[0]
    assert (fish.boxes, fish.gaps, fish.errors) == (1, 1, ())


def test_marks_and_attributes_are_counted(tmp_path):
    layouts.text(layouts.vot(tmp_path) / "ball" / "occlusion.tag", "0", "1", "1")
    _, (ball,) = check_dataset(tmp_path)
    assert (ball.occluded, ball.attributes) == (2, ("occlusion",))


def test_a_sequence_without_any_box_cannot_be_used(tmp_path):
    layouts.text(layouts.vot(tmp_path) / "ball" / "groundtruth.txt", "0", "0", "0")
    _, (ball,) = check_dataset(tmp_path)
    assert (ball.errors, ball.median_size) == (("no frame has a box",), None)


def test_a_clip_without_a_track_is_told(tmp_path):
    layouts.text(layouts.motchallenge(tmp_path) / "train/MOT16-02/gt/gt.txt", "1,1,1,1,2,2,0,1,1")
    _, (clip,) = check_dataset(tmp_path)
    assert (clip.name, clip.errors) == ("MOT16-02", ("no object with a box",))


def video(path, frames):
    """Black frames; Matroska's file does not say how many."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height = 64, 48
        for _ in range(frames):
            image = np.zeros((48, 64, 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())


@pytest.mark.parametrize("decode", [False, True])
@pytest.mark.parametrize("kind", ["images", ".mp4", ".mkv"])
@pytest.mark.parametrize(
    ("rows", "error", "warning"),
    [
        (5, "4 frames in {}, but boxes for 5; expected as many", None),
        (4, None, None),
        (3, None, "boxes for 3 of 4 frames; expected a line a frame"),
        (1, None, "boxes for 1 of 4 frames; expected a line a frame"),
    ],
)
def test_as_many_lines_as_frames_are_expected(tmp_path, decode, kind, rows, error, warning):
    clip = tmp_path / "duck"
    if kind == "images":
        layouts.images(clip, 4)
    else:
        clip = clip.with_suffix(kind)
        video(clip, 4)
    layouts.text(tmp_path / "duck.txt", *["1,2,9,9"] * rows)
    _, (duck,) = check_dataset(tmp_path, decode=decode)
    assert len(duck.errors) == (error is not None)
    assert all(error.format(clip) in told for told in duck.errors)
    assert len(duck.warnings) == (warning is not None)
    assert all(warning in told for told in duck.warnings)


def test_tracks_may_end_before_the_clip(tmp_path):
    video(tmp_path / "street.mp4", 4)
    lines = [
        f'{{"frame": {frame}, "objects": [{{"id": 1, "box_xywh": [1, 2, 9, 9]}}]}}'
        for frame in (1, 2)
    ]
    layouts.text(tmp_path / "street.jsonl", *lines)
    _, (track,) = check_dataset(tmp_path)
    assert (track.errors, track.warnings) == ((), ())
    layouts.text(tmp_path / "street.jsonl", *lines, lines[0].replace("1,", "4,", 1))
    _, (track,) = check_dataset(tmp_path)
    assert "4 frames in" in track.errors[0]


def test_an_image_that_cannot_be_read_is_found_by_decoding(tmp_path):
    folder = layouts.motchallenge(tmp_path) / "train" / "MOT16-02" / "img1"
    (folder / "000003.jpg").write_bytes(b"nothing")
    whole = (folder / "000004.jpg").read_bytes()
    (folder / "000004.jpg").write_bytes(whole[:-20])
    _, quick = check_dataset(tmp_path)
    assert [finding.errors for finding in quick] == [(), ()]
    _, (third, tenth) = check_dataset(tmp_path, decode=True)
    assert len(third.errors) == 2
    assert "000003.jpg cannot be read" in third.errors[0]
    assert "000004.jpg cannot be read" in third.errors[1]  # cut short
    assert tenth.errors == ()  # its only frame is the second


@pytest.mark.parametrize("decode", [False, True])
def test_a_first_image_that_cannot_be_read_is_found_either_way(tmp_path, decode):
    (layouts.otb(tmp_path) / "Bolt/img/0001.jpg").write_bytes(b"nothing")
    _, (bolt,) = check_dataset(tmp_path, decode=decode)
    assert len(bolt.errors) == 1
    assert "0001.jpg cannot be read" in bolt.errors[0]


def test_a_video_that_is_none_is_an_error(tmp_path):
    (tmp_path / "clip.mp4").write_bytes(b"nothing")
    layouts.text(tmp_path / "clip.txt", *["1,2,9,9"] * 5)
    _, (clip,) = check_dataset(tmp_path)
    assert "clip.mp4" in clip.errors[0]


def test_a_folder_that_is_no_dataset_is_an_error(tmp_path):
    with pytest.raises(ValueError, match="holds no annotated clip"):
        check_dataset(tmp_path)
