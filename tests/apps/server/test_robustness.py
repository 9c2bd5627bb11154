"""Errors, full disks, idle connections, slow players: what is told, and that the rest goes on."""

import errno
import json
import socket
import time
from pathlib import Path

import httpx2
import pytest
from starlette.testclient import TestClient

from re3.apps.server import bodies, exports, running
from re3.apps.server.application import create_app
from re3.apps.server.limits import Limits
from re3.apps.server.samples import find_sample
from re3.apps.server.tracked_video import TrackedVideo

CLIP = find_sample("person.mp4").path
PERSON = [368.3, 58.26, 158.0, 374.0]
BASE = "http://127.0.0.1:8000"


@pytest.fixture(scope="module")
def app():
    return create_app(limits=Limits(sessions=4))


@pytest.fixture(scope="module")
def running_client(app):
    with TestClient(app, base_url=BASE, raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def client(running_client, app):
    yield running_client
    for session_id in list(app.state.sessions):
        running_client.delete(f"/api/sessions/{session_id}")


def create(client, source="sample", name="person.mp4"):
    made = client.post("/api/sessions", json={"source": source, "name": name})
    assert made.status_code == 201, made.text
    return f"/api/sessions/{made.json()['id']}"


def stream(client, at):
    return client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream")


def receive(socket, kind):
    """The next message of a kind; pictures are acknowledged."""
    while True:
        message = socket.receive()
        if data := message.get("bytes"):
            head = json.loads(data[4 : 4 + int.from_bytes(data[:4], "big")])
            socket.send_json({"do": "shown"})
        else:
            head = json.loads(message["text"])
        if head["type"] == kind:
            return head


def fail(*_, **__):
    raise RuntimeError("out of luck")


def test_a_player_that_fails_leaves_the_session_usable(client, monkeypatch):
    at = create(client)
    client.post(f"{at}/objects", json={"box_xywh": PERSON})
    client.post(f"{at}/track", json={"until": 3})
    monkeypatch.setattr(TrackedVideo, "forward", fail)
    for _ in range(2):
        answer = client.post(f"{at}/track", json={"until": 6})
        assert answer.status_code == 500
        assert "tracking stopped after frame 3: out of luck" in answer.json()["detail"]
    assert client.get(at).json()["playing"] is False
    with stream(client, at) as page:
        page.send_json({"do": "play", "speed": 0})
        assert "tracking stopped after frame 3" in receive(page, "error")["error"]
        page.send_json({"do": "step"})
        assert "an error inside re3 (RuntimeError)" in receive(page, "error")["error"]
        monkeypatch.undo()
        page.send_json({"do": "step"})
        assert receive(page, "frame")["index"] == 4
    assert client.post(f"{at}/track", json={"until": 6}).json()["tracked_until"] == 6
    assert client.post(f"{at}/pause").status_code == 200


def test_tracking_again_that_fails_leaves_the_session_usable(client, monkeypatch):
    at = create(client)
    client.post(f"{at}/objects", json={"box_xywh": PERSON})
    client.post(f"{at}/track", json={"until": 5})
    client.post(f"{at}/seek", json={"frame": 0})
    monkeypatch.setattr(TrackedVideo, "catch_up", fail)
    assert client.patch(f"{at}/objects/1", json={"box_xywh": PERSON}).status_code == 200
    client.post(f"{at}/seek", json={"frame": 1, "track": False})
    monkeypatch.undo()
    assert client.post(f"{at}/track", json={"until": 5}).json()["tracked_until"] == 5


def test_unexpected_errors_are_told_as_json(client, monkeypatch):
    at = create(client)
    monkeypatch.setattr(TrackedVideo, "add", fail)
    answer = client.post(f"{at}/objects", json={"box_xywh": PERSON})
    assert answer.status_code == 500
    assert answer.json()["limit"] is None
    assert "an error inside re3 (RuntimeError)" in answer.json()["detail"]


def test_pause_does_not_wait_for_the_next_frame(client):
    at = create(client)
    with stream(client, at) as page:
        page.send_json({"do": "play", "speed": 0.05})
        while receive(page, "frame")["index"] < 1:
            pass
        started = time.monotonic()
        page.send_json({"do": "pause"})
        while receive(page, "state")["session"]["playing"]:
            pass
        assert client.get(at).json()["playing"] is False
        assert time.monotonic() - started < 1


@pytest.mark.parametrize("speed", ["1e-9", "0.049", "-1", "17", "NaN", "Infinity", '"x"'])
def test_speeds_that_would_hold_a_session(client, speed):
    with stream(client, create(client)) as page:
        page.send_text(f'{{"do": "play", "speed": {speed}}}')
        assert "not a command" in receive(page, "error")["error"]
        page.send_json({"do": "step"})
        while receive(page, "frame")["index"] != 1:
            pass


def test_sessions_that_play_for_nobody_end_and_make_room(client, app):
    at = create(client)
    with stream(client, at) as page:
        page.send_json({"do": "play", "speed": 0.05})
        receive(page, "frame")
    session = app.state.sessions.get(at.rsplit("/", 1)[1])
    session.used_at -= 61
    for _ in range(3):
        create(client, "upload", "x")
    create(client, "camera")
    assert client.get(at).status_code == 404


NESTED = 20_000 * "["


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"source": "camera", "name": "' + 70_000 * b"x" + b'"}', 413),
        (iter([b'{"source": "', 70_000 * b"x", b'"}']), 413),
        (NESTED.encode(), 400),
        (b'{"name": ' + NESTED.encode(), 400),
        (b"{", 422),
        (b"\xff", 400),
    ],
    ids=["large", "in pieces", "nested", "nested value", "cut off", "not text"],
)
def test_json_bodies_are_limited(client, body, status):
    headers = {"content-type": "application/json"}
    answer = client.post("/api/sessions", content=body, headers=headers)
    assert answer.status_code == status
    assert set(answer.json()) == {"detail", "limit"}


@pytest.mark.parametrize("text", [NESTED, '{"do":' + NESTED, '{"do": "' + 5000 * "x" + '"}', "7"])
def test_commands_of_no_use_are_answered(client, text):
    with stream(client, create(client)) as page:
        page.send_text(text)
        assert receive(page, "error")["error"]
        page.send_json({"do": "step"})
        while receive(page, "frame")["index"] != 1:
            pass


def test_a_large_picture_of_a_camera_is_refused(client):
    answer = client.post(f"{create(client, 'camera')}/frames", content=bytes(34_000_000))
    assert answer.status_code == 413
    assert "the picture has more than" in answer.json()["detail"]


def full(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device", "/secret/path")


def told_full(answer):
    assert answer.status_code == 507, answer.text
    assert "disk" in answer.json()["detail"]
    assert "/secret" not in answer.text
    return True


def test_a_full_disk_is_told(client, app, monkeypatch, capfd):
    video = CLIP.read_bytes()
    picture = client.get(f"{create(client)}/frame.jpg").content
    camera, upload, sample = create(client, "camera"), create(client, "upload"), create(client)
    client.post(f"{sample}/objects", json={"box_xywh": PERSON})
    assert len(app.state.sessions) == 4
    with monkeypatch.context() as patch:
        patch.setattr(Path, "mkdir", full)
        client.delete(f"/api/sessions/{next(iter(app.state.sessions))}")
        assert told_full(client.post("/api/sessions", json={"source": "camera"}))
        assert told_full(client.post(f"{camera}/frames", content=picture))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        assert told_full(client.post(f"{camera}/frames", content=picture))
        with stream(client, camera) as page:
            page.send_bytes(picture)
            assert "disk" in receive(page, "refused")["error"]
    assert client.post(f"{camera}/frames", content=picture).json()["index"] == 0
    with monkeypatch.context() as patch:
        patch.setattr(exports, "open_results", full)
        assert told_full(client.get(f"{sample}/export/csv"))
        patch.setattr(exports, "_write_job", full)
        assert told_full(client.get(f"{sample}/export/mp4"))
        patch.setattr("re3.apps.server.export_routes.tempfile.mkdtemp", full)
        assert told_full(client.get(f"{sample}/export/csv"))
    assert client.get(f"{sample}/export/csv").status_code == 200
    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", full)
        assert told_full(client.put(f"{upload}/video", content=video))
    assert client.get(upload).status_code == 404
    assert len(app.state.sessions) == 2
    assert "Traceback" not in "".join(capfd.readouterr())


def until_closed(connection, seconds):
    """How long the server keeps the connection."""
    connection.settimeout(seconds)
    started = time.monotonic()
    while connection.recv(4096):
        pass
    return time.monotonic() - started


def test_connections_on_which_no_request_comes_are_closed(running_server, monkeypatch):
    monkeypatch.setattr(running, "IDLE_SECONDS", 0.5)
    with running_server() as server:
        at = server.url.split("/")[2].split(":")
        address = (at[0], int(at[1]))
        for beginning in (b"", b"GET /api/about HT", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nA: "):
            with socket.create_connection(address) as connection:
                connection.sendall(beginning)
                assert until_closed(connection, 5) < 3
        whole = b"GET /api/about HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        with socket.create_connection(address) as connection:
            connection.sendall(whole)
            connection.recv(65536)
            connection.sendall(b"GET /api")  # a second request that does not come
            assert until_closed(connection, 5) < 3
        with socket.create_connection(address) as connection:
            for _ in range(3):
                connection.sendall(whole)
                assert connection.recv(65536)
                time.sleep(0.4)
        made = httpx2.post(
            f"{server.url}api/sessions", json={"source": "sample", "name": CLIP.name}
        )
        path = f"/api/sessions/{made.json()['id']}/stream".encode()
        with socket.create_connection(address) as connection:  # a WebSocket stays
            connection.sendall(
                b"GET " + path + b" HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\n"
                b"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
            )
            connection.settimeout(1.5)
            with pytest.raises(TimeoutError):
                while connection.recv(65536):
                    pass


def start_upload(server, length=5_000_000):
    made = httpx2.post(f"{server.url}api/sessions", json={"source": "upload", "name": "x"}).json()
    host, port = server.url.split("/")[2].split(":")
    connection = socket.create_connection((host, int(port)))
    head = f"PUT /api/sessions/{made['id']}/video HTTP/1.1\r\nHost: {host}\r\n"
    connection.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode() + bytes(100_000))
    return connection, made["id"]


def test_a_reload_during_an_upload_removes_the_session_without_a_word(running_server, capfd):
    with running_server() as server:
        connection, session_id = start_upload(server)
        time.sleep(0.3)
        connection.close()
        deadline = time.monotonic() + 5
        while session_id in list(server.app.state.sessions) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert list(server.app.state.sessions) == []
        assert list(server.app.state.sessions.folder.iterdir()) == []
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_session_that_is_ended_ends_its_upload(running_server, capfd):
    with running_server() as server:
        connection, session_id = start_upload(server)
        httpx2.delete(f"{server.url}api/sessions/{session_id}")
        connection.sendall(bytes(100_000))
        connection.settimeout(5)
        assert b"409" in connection.recv(4096)
        connection.close()
    assert "Traceback" not in "".join(capfd.readouterr())


def test_an_upload_that_stands_still_is_given_up(running_server, monkeypatch):
    monkeypatch.setattr(bodies, "STALLED_SECONDS", 0.3)
    monkeypatch.setattr(bodies, "JSON_SECONDS", 0.3)
    with running_server() as server:
        connection, session_id = start_upload(server)
        connection.settimeout(30)
        answer = connection.recv(4096)
        assert b"408" in answer
        assert b"nothing of the upload came" in answer + connection.recv(4096)
        assert session_id not in list(server.app.state.sessions)
        connection.close()
        host, port = server.url.split("/")[2].split(":")
        with socket.create_connection((host, int(port))) as connection:
            connection.sendall(
                b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 50\r\n\r\n{"
            )
            connection.settimeout(30)
            assert b"408" in connection.recv(4096)
