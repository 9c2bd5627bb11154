"""Changes over REST and WebSocket: what they leave alone, and undo."""

import json
import time
from urllib.parse import unquote

import pytest
from starlette.testclient import TestClient

from re3.apps.server.application import create_app
from re3.apps.server.limits import Limits
from re3.apps.server.playing import Player

PERSON = [368.3, 58.26, 158.0, 374.0]
NUDGED = [373.3, 58.26, 158.0, 374.0]
TABLE = [440.0, 80.0, 146.0, 260.0]
BASE = "http://127.0.0.1:8000"
LAST = 29


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(limits=Limits(objects=3)), base_url=BASE) as client:
        yield client


@pytest.fixture
def at(client, short_clip):
    """A session whose clip is tracked to its end, with two objects."""
    made = client.post("/api/sessions", json={"source": "upload", "name": "short.mp4"}).json()
    at = f"/api/sessions/{made['id']}"
    client.put(f"{at}/video", content=short_clip.read_bytes())
    for name, box in (("person", PERSON), ("table", TABLE)):
        client.post(f"{at}/objects", json={"name": name, "box_xywh": box})
    assert client.post(f"{at}/track", json={}).json()["tracked_until"] == LAST
    yield at
    client.delete(at)


def found(client, at):
    """Frame -> name -> box."""
    frames = client.get(f"{at}/boxes").json()
    return {f["index"]: {r["name"]: r["box_xywh"] for r in f["results"]} for f in frames}


def wait_until_caught_up(client, at):
    deadline = time.monotonic() + 30
    while (state := client.get(at).json())["catching_up"]:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return state


def test_a_box_dragged_in_the_first_frame_leaves_all_frames_tracked(client, at):
    before = found(client, at)
    client.post(f"{at}/seek", json={"frame": 0})
    client.patch(f"{at}/objects/1", json={"box_xywh": NUDGED})
    state = wait_until_caught_up(client, at)
    assert (state["tracked_until"], state["position"], state["untracked"]) == (LAST, 0, [])
    after = found(client, at)
    assert [frame["table"] for frame in after.values()] == [f["table"] for f in before.values()]
    assert after[0]["person"] == NUDGED
    assert after[LAST]["person"] != before[LAST]["person"]
    assert client.post(f"{at}/undo").json()["undo"] == "new object table"
    assert found(client, at) == before
    client.post(f"{at}/redo")
    assert found(client, at) == after


def test_an_object_added_or_ended_early_leaves_the_others(client, at):
    before = found(client, at)
    client.post(f"{at}/seek", json={"frame": 4})
    client.post(f"{at}/objects", json={"name": "third", "box_xywh": NUDGED})
    assert wait_until_caught_up(client, at)["objects"][2]["tracked"] == [[4, LAST]]
    after = found(client, at)
    assert {name: after[LAST][name] for name in ("person", "table")} == before[LAST]
    assert client.post(f"{at}/objects/2/end").json()["untracked"] == []
    assert [name in found(client, at)[LAST] for name in ("person", "table", "third")] == [
        True,
        False,
        True,
    ]
    client.post(f"{at}/undo")
    client.post(f"{at}/undo")
    assert found(client, at) == before


def test_undo_reaches_back_to_the_beginning_and_no_further(client, at):
    client.delete(f"{at}/objects/1")
    client.patch(f"{at}/objects/2", json={"name": "desk", "colour": "#010203"})
    told = [client.post(f"{at}/undo").json()["redo"] for _ in range(4)]
    assert told == ["name of table", "removal of person", "new object table", "new object person"]
    answer = client.post(f"{at}/undo")
    assert (answer.status_code, answer.json()["detail"]) == (409, "there is nothing to undo")
    assert client.get(at).json()["objects"] == []
    for _ in range(4):
        state = client.post(f"{at}/redo").json()
    assert [(each["name"], each["colour"]) for each in state["objects"]] == [("desk", "#010203")]
    assert client.post(f"{at}/redo").status_code == 409


def test_a_refused_box_leaves_no_object(client, at):
    for _ in range(5):
        for box in ([0, 0, 0, 0], [9000, 0, 5, 5], [1, 1, 1e-9, 1e-9]):
            answer = client.post(f"{at}/objects", json={"box_xywh": box})
            assert answer.status_code == 422
        assert (
            client.post(f"{at}/objects", json={"box_xywh": TABLE, "name": "a\0"}).status_code == 422
        )
    assert len(client.get(at).json()["objects"]) == 2
    answer = client.post(f"{at}/objects", json={"box_xywh": TABLE})
    assert (answer.status_code, answer.json()["name"]) == (201, "object 3")


def test_an_export_of_a_clip_not_tracked_to_its_end_says_so(client, at, monkeypatch):
    monkeypatch.setattr(Player, "catch_up", lambda *_: None)
    complete = client.get(f"{at}/export/csv")
    assert 'filename="short.csv"' in complete.headers["content-disposition"]
    assert "re3-untracked" not in complete.headers
    client.post(f"{at}/seek", json={"frame": 4})
    client.patch(f"{at}/objects/1", json={"box_xywh": NUDGED, "name": "die Tür"})
    state = client.get(at).json()
    assert state["untracked"] == [f"die Tür in frames 5 to {LAST}"]
    for kind in ("csv", "json", "otb", "mot", "coco", "mp4"):
        answer = client.get(f"{at}/export/{kind}")
        assert "short-incomplete." in answer.headers["content-disposition"]
        assert unquote(answer.headers["re3-untracked"]) == state["untracked"][0]
    client.post(f"{at}/track", json={})
    assert 'filename="short.csv"' in client.get(f"{at}/export/csv").headers["content-disposition"]


def heads(socket, kind, count):
    """The next messages of a kind."""
    got = []
    while len(got) < count:
        message = socket.receive()
        if message.get("bytes"):
            data = message["bytes"]
            head = json.loads(data[4 : 4 + int.from_bytes(data[:4], "big")])
            socket.send_json({"do": "shown"})
        else:
            head = json.loads(message["text"])
        if head["type"] == kind:
            got.append(head)
    return got


def test_pages_are_sent_what_was_tracked_again_and_what_undo_brings_back(client, at):
    before = found(client, at)
    with client.websocket_connect(f"ws://127.0.0.1:8000{at}/stream") as socket:
        heads(socket, "boxes", 1)
        socket.send_json({"do": "look", "frame": 20})
        assert heads(socket, "frame", 2)[-1]["index"] == 20
        client.patch(f"{at}/objects/2", json={"box_xywh": PERSON})
        frames = []
        while len(frames) < LAST - 20:
            frames += heads(socket, "boxes", 1)[0]["frames"]
        assert [frame["index"] for frame in frames] == list(range(21, LAST + 1))
        socket.send_json({"do": "undo"})
        (message,) = heads(socket, "boxes", 1)
        sent = {f["index"]: f["results"][1]["box_xywh"] for f in message["frames"]}
        assert sent == {index: boxes["table"] for index, boxes in before.items()}
        for _ in range(3):
            socket.send_json({"do": "undo"})
        assert heads(socket, "error", 1)[0]["error"] == "there is nothing to undo"


def test_tracking_again_goes_on_after_playing(client, at):
    client.post(f"{at}/seek", json={"frame": 0})
    client.patch(f"{at}/objects/1", json={"box_xywh": NUDGED})
    assert client.post(f"{at}/seek", json={"frame": 3}).json()["position"] == 3
    state = wait_until_caught_up(client, at)
    assert (state["position"], state["tracked_until"]) == (3, LAST)


def test_tracking_again_can_be_stopped(client, at):
    client.post(f"{at}/seek", json={"frame": 0})
    client.patch(f"{at}/objects/1", json={"box_xywh": NUDGED})
    state = client.post(f"{at}/pause").json()
    assert (state["catching_up"], state["playing"]) == (0, False)
    assert client.post(f"{at}/track", json={}).json()["untracked"] == []


def test_a_frame_is_looked_at_without_tracking(client, at):
    client.post(f"{at}/seek", json={"frame": 0})
    client.patch(f"{at}/objects/1", json={"box_xywh": NUDGED})
    client.post(f"{at}/pause")
    until = client.get(at).json()["tracked_until"]
    state = client.post(f"{at}/seek", json={"frame": 20, "track": False}).json()
    assert (state["position"], state["tracked_until"]) == (20, until)
    state = client.post(f"{at}/seek", json={"frame": 20}).json()
    assert (state["position"], state["tracked_until"]) == (20, 20)
