"""Annotated videos are written by a process of their own: one a session, and only for somebody."""

import json
import threading
import time

import httpx2
import psutil
import pytest
from websockets.sync.client import connect

from re3.apps.server import exports

PERSON = [368.3, 58.26, 158.0, 374.0]


@pytest.fixture(scope="module")
def server(running_server):
    with running_server() as server:
        yield server


@pytest.fixture
def at(server, short_clip):
    made = httpx2.post(f"{server.url}api/sessions", json={"source": "upload", "name": "s.mp4"})
    at = f"{server.url}api/sessions/{made.json()['id']}"
    httpx2.put(f"{at}/video", content=short_clip.read_bytes())
    httpx2.post(f"{at}/objects", json={"box_xywh": PERSON})
    httpx2.post(f"{at}/track", json={}, timeout=60)
    yield at
    httpx2.delete(at)


def workers():
    found = []
    for process in psutil.Process().children(recursive=True):
        try:
            if "re3.apps.server.export_worker" in process.cmdline():
                found.append(process.pid)
        except psutil.Error:
            continue
    return found


def test_several_at_once_are_written_one_after_the_other(at):
    answers, most = [], 0
    threads = [
        threading.Thread(target=lambda: answers.append(httpx2.get(f"{at}/export/mp4", timeout=90)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        most = max(most, len(workers()))
        time.sleep(0.05)
    assert most == 1
    assert [answer.status_code for answer in answers] == [200] * 3
    assert len({answer.content for answer in answers}) == 1
    assert workers() == []


def test_a_client_that_goes_ends_the_process_and_leaves_no_file(server, at):
    session = server.app.state.sessions.get(at.rsplit("/", 1)[1])
    before = set(session.folder.iterdir())
    with pytest.raises(httpx2.TimeoutException):
        httpx2.get(f"{at}/export/mp4", timeout=0.3)
    deadline = time.monotonic() + 10
    while session.exporting.locked() or workers():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert set(session.folder.iterdir()) == before
    assert httpx2.get(f"{at}/export/mp4", timeout=60).status_code == 200


def test_a_session_that_ends_ends_the_process(at):
    answers = []
    thread = threading.Thread(
        target=lambda: answers.append(httpx2.get(f"{at}/export/mp4", timeout=60))
    )
    thread.start()
    deadline = time.monotonic() + 10
    while not workers():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    httpx2.delete(at)
    thread.join(timeout=5)
    assert answers[0].status_code == 409
    assert "has been ended while the file was written" in answers[0].json()["detail"]
    while workers():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_pages_are_told_how_far_it_is(at):
    url = at.replace("http", "ws", 1) + "/stream"
    with connect(url) as page:
        assert httpx2.get(f"{at}/export/mp4", timeout=60).status_code == 200
        told = []
        while None not in told:
            message = page.recv(timeout=10)
            if isinstance(message, str) and (head := json.loads(message))["type"] == "export":
                assert head["kind"] == "mp4"
                told.append(head["done"])
    assert told[0] == 0
    assert told[:-1] == sorted(told[:-1])
    assert all(0 <= each <= 1 for each in told[:-1])


def test_a_process_that_crashes_is_told(at, monkeypatch):
    monkeypatch.setitem(exports.ENVIRONMENT, "PYTHONPATH", "/nowhere")
    monkeypatch.setitem(exports.ENVIRONMENT, "PYTHONHOME", "/nowhere")
    answer = httpx2.get(f"{at}/export/mp4", timeout=60)
    assert answer.status_code == 422
    assert "the process that writes the video crashed" in answer.json()["detail"]
