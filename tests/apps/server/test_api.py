"""REST and WebSocket, without a network."""

import csv
import io
import json
import zipfile

import cv2
import numpy as np
import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from typer.testing import CliRunner

from re3.apps.cli import app as command_line
from re3.apps.server.application import create_app
from re3.apps.server.limits import Limits
from re3.apps.server.samples import find_sample
from re3.video import VideoWriter, open_source

CLIP = find_sample("person.mp4").path
PERSON = [368.3, 58.26, 158.0, 374.0]
TABLE = [440.0, 80.0, 146.0, 260.0]
BASE = "http://127.0.0.1:8000"


@pytest.fixture(scope="module")
def app():
    return create_app(limits=Limits(upload_mb=1, duration_s=20, sessions=3, objects=2))


@pytest.fixture(scope="module")
def running(app):
    with TestClient(app, base_url=BASE) as client:
        yield client


@pytest.fixture
def client(running, app):
    yield running
    for session_id in list(app.state.sessions):
        running.delete(f"/api/sessions/{session_id}")


def create(client, source="sample", name="person.mp4"):
    answer = client.post("/api/sessions", json={"source": source, "name": name})
    assert answer.status_code == 201, answer.text
    return f"/api/sessions/{answer.json()['id']}"


def refused(answer, status, *parts):
    assert answer.status_code == status, answer.text
    for part in parts:
        assert part in answer.json()["detail"]


def command_lines_boxes(path, frames, **objects):
    given = [f"--object={name}={','.join(map(str, box))}" for name, box in objects.items()]
    arguments = ["track", str(CLIP), *given, "--max-frames", str(frames), "--results", str(path)]
    assert CliRunner().invoke(command_line, arguments).exit_code == 0


def test_the_boxes_are_those_of_the_command_line(client, tmp_path):
    at = create(client)
    for name, box in (("person", PERSON), ("table", TABLE)):
        answer = client.post(f"{at}/objects", json={"name": name, "box_xywh": box})
        assert answer.status_code == 201
    assert client.post(f"{at}/track", json={"until": 15}).json()["tracked_until"] == 15
    for ending in ("csv", "txt"):
        command_lines_boxes(tmp_path / f"b.{ending}", 16, person=PERSON, table=TABLE)
    exported = client.get(f"{at}/export/csv")
    assert exported.text == (tmp_path / "b.csv").read_text()
    assert "a_person_at_a_table-incomplete.csv" in exported.headers["content-disposition"]
    rows = list(csv.DictReader(io.StringIO(exported.text)))
    with zipfile.ZipFile(io.BytesIO(client.get(f"{at}/export/otb").content)) as packed:
        texts = {name.rsplit("-", 1)[1]: packed.read(name).decode() for name in packed.namelist()}
    assert texts == {f"{n}.txt": (tmp_path / f"b-{n}.txt").read_text() for n in ("person", "table")}
    as_json = client.get(f"{at}/export/json").json()
    assert [float(row["x"]) for row in rows] == [row["x"] for row in as_json]
    coco = client.get(f"{at}/export/coco").json()
    assert len(coco["annotations"]) == 32
    assert (coco["images"][0]["width"], coco["images"][0]["height"]) == (768, 432)
    assert len(client.get(f"{at}/export/mot").text.splitlines()) == 32
    frames = client.get(f"{at}/boxes", params={"first": 14}).json()
    assert [frame["index"] for frame in frames] == [14, 15]
    assert round(frames[1]["results"][0]["box_xywh"][0], 3) == float(rows[30]["x"])


def test_an_uploaded_video_is_tracked_corrected_and_comes_back_annotated(client, tmp_path):
    at = create(client, "upload", "../odd näme\n & <b>.mp4")
    answer = client.put(f"{at}/video", content=CLIP.read_bytes())
    assert answer.json()["title"] == "odd näme & <b>.mp4"
    assert (answer.json()["width"], answer.json()["frame_count"]) == (768, 120)
    refused(client.put(f"{at}/video", content=b"x"), 409, "has a video already")
    added = client.post(f"{at}/objects", json={"box_xywh": PERSON, "colour": "#ff0000"}).json()
    assert added["name"] == "object 1"
    client.post(f"{at}/track", json={"until": 8})
    assert client.post(f"{at}/seek", json={"frame": 4}).json()["position"] == 4
    assert client.patch(f"{at}/objects/1", json={"box_xywh": TABLE}).json()["given"] == [0, 4]
    assert client.post(f"{at}/seek", json={"frame": 9}).json()["tracked_until"] == 9
    video = tmp_path / "v.mp4"
    download = client.get(f"{at}/export/mp4")
    assert "odd_n" in download.headers["content-disposition"]
    video.write_bytes(download.content)
    with open_source(video) as source:
        frames = [frame.image for frame in source]
    assert len(frames) == 10
    blue, green, red = frames[0][300, 368].astype(int)
    assert red > 150 > green + 60 and red > blue + 90
    picture = cv2.imdecode(np.frombuffer(client.get(f"{at}/frame.jpg").content, np.uint8), 1)
    assert picture.shape == (432, 768, 3)


def test_objects_are_changed_ended_and_removed(client):
    at = create(client)
    for name in ("a", "b"):
        client.post(f"{at}/objects", json={"box_xywh": PERSON, "name": name})
    refused(client.post(f"{at}/objects", json={"box_xywh": PERSON}), 409, "--max-objects")
    refused(
        client.patch(f"{at}/objects/2", json={"name": "a"}), 422, "another object is called 'a'"
    )
    assert client.patch(f"{at}/objects/2", json={"colour": "#00ff00"}).json()["colour"] == "#00ff00"
    client.post(f"{at}/seek", json={"frame": 3})
    assert client.post(f"{at}/objects/2/end").json()["objects"][1]["ends"] == [3]
    assert client.delete(f"{at}/objects/1").status_code == 204
    found = client.get(f"{at}/boxes").json()
    assert [[r["name"] for r in frame["results"]] for frame in found] == [["b"]] * 3 + [[]]
    refused(client.delete(f"{at}/objects/1"), 404, "there is no object 1; there are [2]")


@pytest.mark.parametrize(
    ("box", "part"),
    [
        ([0, 0, 0, 0], "no area"),
        ([900, 0, 10, 10], "wholly outside the frame of 768 x 432"),
        ([1, 2, 3], "box_xywh"),
        (["a", 2, 3, 4], "box_xywh"),
    ],
)
def test_boxes_of_no_use_are_refused(client, box, part):
    refused(client.post(f"{create(client)}/objects", json={"box_xywh": box}), 422, part)


def test_limits_are_named(client, app, tmp_path):
    at = create(client, "upload", "x.mp4")
    refused(client.put(f"{at}/video", content=bytes(1_000_001)), 413, "1 MB", "--max-upload")
    at = create(client, "upload", "x.mp4")
    pieces = (bytes(100_000) for _ in range(11))
    refused(client.put(f"{at}/video", content=pieces), 413, "--max-upload")
    with VideoWriter(tmp_path / "long.mp4", 1, (64, 48)) as writer:
        for _ in range(22):
            writer.write(np.zeros((48, 64, 3), np.uint8))
    at = create(client, "upload", "x.mp4")
    long = (tmp_path / "long.mp4").read_bytes()
    refused(client.put(f"{at}/video", content=long), 413, "22 seconds", "--max-duration")
    assert len(app.state.sessions) == 0
    for _ in range(3):
        create(client, "upload", "x")
    answer = client.post("/api/sessions", json={"source": "camera"})
    refused(answer, 429, "3 sessions are open", "--max-sessions")
    assert answer.json()["limit"] == "sessions"
    first, second, third = map(app.state.sessions.get, app.state.sessions)
    first.viewers.add(object())
    for session, seconds in ((first, 900), (second, 61), (third, 70)):
        session.used_at -= seconds
    create(client, "upload", "takes the place of the one left alone longest")
    assert third.id not in app.state.sessions
    second.path = tmp_path  # is being uploaded
    refused(client.post("/api/sessions", json={"source": "camera"}), 429)
    first.viewers.clear()
    create(client, "camera")
    assert first.id not in app.state.sessions
    assert second.id in app.state.sessions


@pytest.mark.parametrize("content", [b"", b"text", CLIP.read_bytes()[:5000]])
def test_what_is_no_video_is_refused_and_leaves_nothing(client, app, content):
    at = create(client, "upload", "x.mp4")
    refused(client.put(f"{at}/video", content=content), 422)
    assert list(app.state.sessions.folder.iterdir()) == []
    refused(client.get(at), 404, "no such session (any more)")


def test_what_is_asked_for_too_early_or_is_unknown(client):
    at = create(client, "upload", "x.mp4")
    refused(client.post(f"{at}/objects", json={"box_xywh": PERSON}), 409, "no video yet")
    refused(client.post(f"{at}/frames", content=b"x"), 409, "of source 'camera' only")
    refused(client.post(f"{at}/done"), 409, "nobody waits")
    refused(client.post("/api/sessions", json={"source": "sample", "name": "x"}), 404, "person.mp4")
    at = create(client)
    refused(client.get(f"{at}/export/csv"), 422, "draw a box first")
    refused(client.get(f"{at}/export/pdf"), 404, "expected one of csv, json")
    assert client.get("/nowhere").status_code == 404


def picture(index, ending=".jpg"):
    with open_source(CLIP, start_frame=index) as source:
        return cv2.imencode(ending, next(iter(source)).image)[1].tobytes()


def test_frames_of_a_camera_are_tracked_as_they_come(client):
    at = create(client, "camera")
    first = client.post(f"{at}/frames", content=picture(0)).json()
    assert (first["index"], first["results"]) == (0, [])
    client.post(f"{at}/objects", json={"box_xywh": PERSON, "name": "person"})
    for index in (1, 2):
        told = client.post(f"{at}/frames", content=picture(index, ".png")).json()
        assert (told["index"], told["results"][0]["name"]) == (index, "person")
    refused(client.post(f"{at}/frames", content=b"nothing"), 422, "JPEG, PNG or WebP")
    assert client.get(at).json()["frame_count"] == 3
    client.post(f"{at}/seek", json={"frame": 1})
    client.patch(f"{at}/objects/1", json={"box_xywh": TABLE})
    assert client.post(f"{at}/frames", content=picture(3)).json()["index"] == 3
    found = client.get(f"{at}/boxes").json()
    assert [frame["index"] for frame in found] == [0, 1, 2, 3]
    assert found[1]["results"][0]["box_xywh"] == TABLE
    times = [frame["timestamp"] for frame in found]
    assert times == sorted(times) and times[0] == 0 < times[1]
    assert client.get(f"{at}/export/mp4").status_code == 200


def receive(socket, kind):
    """The next message of a kind; pictures are acknowledged."""
    while True:
        message = socket.receive()
        if message.get("bytes"):
            data = message["bytes"]
            size = int.from_bytes(data[:4], "big")
            head = {**json.loads(data[4 : 4 + size]), "picture": data[4 + size :]}
            socket.send_json({"do": "shown"})
        else:
            head = json.loads(message["text"])
        if head["type"] == kind:
            return head


def test_a_page_is_told_of_every_frame(client, short_clip):
    at = create(client, "upload", "short.mp4")
    client.put(f"{at}/video", content=short_clip.read_bytes())
    client.post(f"{at}/objects", json={"box_xywh": PERSON})
    with client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream") as socket:
        assert receive(socket, "state")["session"]["objects"][0]["given"] == [0]
        assert receive(socket, "boxes")["frames"][0]["results"][0]["box_xywh"] == PERSON
        assert receive(socket, "frame")["picture"].startswith(b"\xff\xd8")
        socket.send_json({"do": "play", "speed": 0})
        seen = [receive(socket, "frame") for _ in range(29)]
        assert [frame["index"] for frame in seen] == list(range(1, 30))
        assert any("picture" in frame for frame in seen)
        assert all(frame["results"] for frame in seen)
        while not (state := receive(socket, "state")["session"])["ended"]:
            pass
        assert (state["playing"], state["position"], state["frame_count"]) == (False, 29, 30)
        socket.send_json({"do": "step", "by": -1})
        assert receive(socket, "frame")["index"] == 28
        socket.send_json({"do": "seek", "frame": 3})
        assert receive(socket, "frame")["index"] == 3
        socket.send_json({"do": "step"})
        assert receive(socket, "frame")["index"] == 4
        socket.send_json({"do": "dance"})
        assert "unknown command 'dance'" in receive(socket, "error")["error"]
        socket.send_text("[")
        assert "not a command" in receive(socket, "error")["error"]
        assert client.delete(at).status_code == 204
        assert receive(socket, "gone")["why"] == "ended"


def test_pictures_wait_for_the_page_and_boxes_do_not(client):
    at = create(client)
    client.post(f"{at}/objects", json={"box_xywh": PERSON})
    with client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream") as socket:
        socket.send_json({"do": "seek", "frame": 12})
        pictures, boxes = [], []
        while not boxes or boxes[-1] != 12:
            message = socket.receive()
            if message.get("bytes"):
                size = int.from_bytes(message["bytes"][:4], "big")
                pictures.append(json.loads(message["bytes"][4 : 4 + size])["index"])
                boxes.append(pictures[-1])
            elif json.loads(message["text"])["type"] == "frame":
                boxes.append(json.loads(message["text"])["index"])
        assert len(pictures) == 2
        assert boxes[-12:] == list(range(1, 13))
        socket.send_json({"do": "shown"})
        assert receive(socket, "frame")["index"] == 12


def test_two_pages_see_the_same(client):
    at = create(client)
    url = f"ws://127.0.0.1:8000{at}/stream"
    with client.websocket_connect(url) as one, client.websocket_connect(url) as two:
        client.post(f"{at}/objects", json={"box_xywh": PERSON, "name": "person"})
        one.send_json({"do": "step"})
        for socket in (one, two):
            while receive(socket, "frame")["index"] != 1:
                pass


def test_of_a_camera_s_frames_that_wait_only_the_newest_is_tracked(client):
    at = create(client, "camera")
    with client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream") as socket:
        frames = [picture(index) for index in range(8)]
        socket.send_bytes(b"no picture")
        assert "JPEG" in receive(socket, "refused")["error"]
        for each in frames:
            socket.send_bytes(each)
        told, dropped = [], []
        while 8 not in told:
            message = json.loads(socket.receive()["text"])
            if message["type"] == "frame" and "number" in message:
                told.append(message["number"])
            elif message["type"] == "dropped":
                dropped.append(message["number"])
        assert sorted(told + dropped) == list(range(1, 9))
        assert dropped
        assert client.get(at).json()["frame_count"] == len(told)


def test_an_unknown_session_is_told_of_over_the_websocket(client):
    with client.websocket_connect("ws://127.0.0.1:8000/api/sessions/x/stream") as socket:
        assert "no such session" in socket.receive_json()["detail"]
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_json()
        assert closed.value.code == 4404


def test_sessions_that_nobody_uses_end(client, app):
    at = create(client)
    session = app.state.sessions.get(at.rsplit("/", 1)[1])
    with client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream") as socket:
        receive(socket, "frame")
        session.used_at -= 60 * 30 + 1
        assert receive(socket, "gone")["why"] == "expired"
    refused(client.get(at), 404, "nobody has used them for 30 minutes")
    assert not session.folder.exists()


def test_files_are_private_and_removed_when_the_server_stops():
    app = create_app()
    with TestClient(app, base_url=BASE) as client:
        at = create(client, "upload", "c.mp4")
        client.put(f"{at}/video", content=CLIP.read_bytes())
        folder = app.state.sessions.folder
        assert folder.stat().st_mode & 0o077 == 0
        assert [path.name for path in folder.glob("*/*")] == ["video"]
    assert not folder.exists()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 201),
        ({"origin": BASE}, 201),
        ({"origin": "http://127.0.0.1:9000"}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"host": "evil.example"}, 403),
        ({"host": "localhost:8000", "origin": "http://localhost:8000"}, 201),
        ({"host": "[::1]:8000"}, 201),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"host": "["}, 403),
    ],
)
def test_other_sites_are_kept_out(client, headers, status):
    answer = client.post("/api/sessions", json={"source": "upload"}, headers=headers)
    assert answer.status_code == status
    assert "default-src 'self'" in answer.headers["content-security-policy"]


def test_other_sites_are_kept_from_the_websocket(client):
    url = f"ws://127.0.0.1:8000{create(client)}/stream"
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect(url, headers={"origin": "https://evil.example"}),
    ):
        pass


def test_the_api_describes_itself_and_loads_nothing_from_elsewhere(client):
    paths = client.get("/openapi.json").json()["paths"]
    assert "/api/sessions/{session_id}/objects" in paths
    assert set(client.get("/api/about").json()["limits"]) == set(vars(Limits()))
    for page in ("/", "/s/anything", "/docs"):
        answer = client.get(page)
        assert answer.status_code == 200
        assert "//" not in answer.text.replace("<!doctype", "").split("<body")[0]
