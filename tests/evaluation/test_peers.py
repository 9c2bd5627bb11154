import numpy as np
import pytest

from re3.data.plain import read_track
from re3.evaluation import peers as registry
from re3.evaluation.metrics import score
from re3.evaluation.one_pass import run_one_pass
from re3.evaluation.opencv_trackers import OpenCvTracker
from re3.evaluation.peer_files import peers_folder
from re3.evaluation.peers import available_trackers, find_tracker

OPENCV = ("kcf", "kcf-persistent", "csrt", "mil", "mosse", "medianflow", "tld", "boosting")


@pytest.fixture
def without_peers(tmp_path, monkeypatch):
    """No folder of peer trackers, neither by environment nor by default."""
    monkeypatch.delenv("RE3_PEERS", raising=False)
    monkeypatch.chdir(tmp_path)


def test_names_are_unique_and_say_why_they_are_missing(without_peers):
    infos = available_trackers()
    assert len({info.name for info in infos}) == len(infos)
    assert all((info.factory is None) == (info.missing is not None) for info in infos)
    missing = {info.name for info in infos if info.missing}
    assert {"nanotrack-v2", "nanotrack-v3", "fear-xs", "vit"} <= missing
    assert missing.isdisjoint({"first-box", *OPENCV})


@pytest.mark.parametrize(
    ("name", "error", "told"),
    [
        ("kfc", ValueError, "no tracker is called 'kfc'.*kcf, "),
        ("nanotrack-v3", ValueError, "nanotrack-v3 is not available: .*--peers or RE3_PEERS"),
        ("fear-xs", ValueError, "fear-xs is not available: .*one that holds fear with --peers"),
        ("re3", ValueError, "re3 is not available: .*without weights"),
        ("gone.onnx", FileNotFoundError, "gone.onnx does not exist"),
        ("new=gone.onnx", FileNotFoundError, "gone.onnx does not exist"),
    ],
)
def test_what_cannot_be_had_is_told(without_peers, name, error, told):
    with pytest.raises(error, match=told):
        find_tracker(name)


@pytest.mark.parametrize(
    ("asked", "name"),
    [
        ("{}/a.onnx", "a"),  # the file's name
        ("new={}/a.onnx", "new"),  # a name of its own
        ("x=y={}/a.onnx", "x=y"),  # the last sign counts
        ("{}/b.safetensors", "b"),  # weights to run with PyTorch
    ],
)
def test_model_files_are_ours(tmp_path, monkeypatch, asked, name):
    made = []
    monkeypatch.setattr(registry, "OurTracker", lambda model: made.append(model))
    for file in ("a.onnx", "b.safetensors"):
        (tmp_path / file).touch()
    info = find_tracker(asked.format(tmp_path))
    assert info.name == name
    info.factory()
    assert made == [asked.format(tmp_path).rpartition("=")[2]]


def test_the_folder_of_peers(tmp_path, monkeypatch):
    named, default = tmp_path / "named", tmp_path / "shared" / "peers"
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.delenv("RE3_PEERS", raising=False)
    assert peers_folder() is None
    default.mkdir(parents=True)
    assert peers_folder().resolve() == default
    monkeypatch.setenv("RE3_PEERS", str(named))
    with pytest.raises(NotADirectoryError, match=r"named is not a folder.*RE3_PEERS"):
        peers_folder()
    named.mkdir()
    assert peers_folder() == named
    assert peers_folder(default) == default
    (info,) = (info for info in available_trackers() if info.name == "nanotrack-v2")
    assert info.missing is not None and info.missing.endswith("does not exist")


def test_the_floor_stays():
    tracker = find_tracker("first-box").factory()
    frame = np.zeros((4, 4, 3), np.uint8)
    tracker.init(frame, (1, 2, 3, 4))
    box, _ = tracker.update(frame)
    assert list(box) == [1, 2, 3, 4]


@pytest.mark.parametrize("name", OPENCV)
def test_opencv_follows_what_is_easy(moving_patch, name):
    images, boxes = moving_patch
    floor = np.tile(boxes[0], (len(boxes), 1))
    best = 0.0
    for _ in range(3):  # MIL draws its samples by the clock, and loses the patch now and then
        tracker = find_tracker(name).factory()
        tracker.init(images[0], boxes[0])
        answers = [tracker.update(image) for image in images[1:]]
        assert all(0.0 <= value <= 1.0 for _, value in answers)
        followed = np.array([boxes[0], *(box for box, _ in answers)])
        best = max(best, score(followed, boxes).ao)
        if best > score(floor, boxes).ao + 0.2:
            return
    pytest.fail(f"overlap {best:.2f} at best; the first box has {score(floor, boxes).ao:.2f}")


class GivesUp:
    """What OpenCV's trackers look like from outside."""

    def __init__(self):
        self.given = None
        self.answers = [(True, (5, 6, 7, 8)), (False, (0, 0, 0, 0)), (True, (6, 6, 7, 8))]

    def init(self, frame, box):
        self.given = box

    def update(self, frame):
        return self.answers.pop(0)


def test_the_last_box_stays_where_opencv_gives_up():
    tracker = OpenCvTracker(GivesUp)
    frame = np.zeros((4, 4, 3), np.uint8)
    tracker.init(frame, (1, 2, 3, 4))
    assert [tracker.update(frame) for _ in range(3)] == [
        ((5, 6, 7, 8), 1.0),
        ((5, 6, 7, 8), 0.0),
        ((6, 6, 7, 8), 1.0),
    ]


@pytest.mark.parametrize(
    ("whole", "box", "given"),
    [
        (True, (1.4, 1.6, 3.2, 4.7), (1, 2, 3, 5)),  # cv2 takes integers
        (True, (1.0, 2.0, 0.3, 0.4), (1, 2, 1, 1)),  # and needs a pixel
        (False, (1.4, 1.6, 3.2, 4.7), (1.4, 1.6, 3.2, 4.7)),  # cv2.legacy takes floats
    ],
)
def test_boxes_as_opencv_wants_them(whole, box, given):
    inner = GivesUp()
    OpenCvTracker(lambda: inner, whole_pixels=whole).init(np.zeros((4, 4, 3), np.uint8), box)
    assert inner.given == given


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [("nanotrack-v2", 0.85), ("nanotrack-v3", 0.85)],  # measured: 0.895 and 0.913
)
def test_nanotrack_follows_a_real_clip(shared_data, peers, name, least):
    sequence = read_track(shared_data / "val" / "davis" / "blackswan.mp4")
    track = run_one_pass(find_tracker(name, peers).factory, sequence)
    assert track.failure is None
    assert score(track.boxes_xywh, sequence.boxes_xywh).auc > least
    assert (np.nan_to_num(track.scores) <= 1.0).all()
