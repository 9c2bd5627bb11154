"""`re3 serve`, `re3 track --select` and the client example, as users call them."""

import csv
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import httpx2
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app
from re3.apps.server import running
from re3.apps.server.limits import Limits
from re3.apps.server.samples import find_sample

ROOT = Path(__file__).parents[3]
CLIP = find_sample("person.mp4").path
BOX = [368.125, 58.5, 158, 374]


def start(*arguments):
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        [sys.executable, "-m", "re3", *map(str, arguments)],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )


def address(process):
    line = process.stderr.readline()
    found = re.search(r"http://127\.0\.0\.1:\d+/\S*", line)
    assert found, line + process.stderr.read()
    return found[0]


@pytest.fixture
def server():
    process = start("serve", "--port", "0", "--idle-timeout", "5")
    yield address(process).rstrip("/"), process
    process.kill()
    process.communicate()


def test_the_client_example_prints_the_boxes_of_the_command_line(server, tmp_path):
    url, process = server
    short = tmp_path / "short.mp4"
    trim = ["track", CLIP, "--box", "1,1,50,50", "--max-frames", "10", "--out", short]
    assert CliRunner().invoke(app, [str(each) for each in trim]).exit_code == 0
    box = ",".join(map(str, BOX))
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "client.py", short, box, url],
        capture_output=True,
        text=True,
        check=True,
    )
    table = tmp_path / "b.csv"
    given = ["track", str(short), "--box", box, "--results", str(table)]
    assert CliRunner().invoke(app, given).exit_code == 0
    expected = [[float(row[side]) for side in "xywh"] for row in csv.DictReader(table.open())]
    printed = [[float(v) for v in line.split()[1:5]] for line in done.stdout.splitlines()]
    assert printed == [pytest.approx(box, abs=5e-4) for box in expected]
    assert len(printed) == 10
    with urllib.request.urlopen(f"{url}/api/about") as answer:
        assert b'"idle_minutes":5.0' in answer.read()
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) in (0, 130)


def test_the_client_example_has_about_20_lines():
    lines = (ROOT / "examples" / "client.py").read_text().splitlines()
    code = [line for line in lines if line.strip() and not line.startswith('"""')]
    assert len(code) <= 22


def test_every_limit_has_an_option_in_the_help():
    text = " ".join(
        re.sub(r"[^\w,.:;'-]+", " ", CliRunner().invoke(app, ["serve", "--help"]).output).split()
    )
    options = ("upload", "duration", "resolution", "sessions", "objects")
    for option in (*(f"--max-{name}" for name in options), "--idle-timeout"):
        assert option in text
    assert "3840x2160" in text
    assert Limits().upload_mb == 500


@pytest.mark.parametrize(
    ("host", "public"),
    [
        ("127.0.0.1", None),
        ("127.0.0.2", None),
        ("localhost", None),
        ("0.0.0.0", "http://{own}:{port}/"),
        ("", "http://{own}:{port}/"),
    ],
)
def test_the_address_that_others_reach(monkeypatch, host, public):
    monkeypatch.setattr(running, "_own_address", lambda: "192.168.7.7")
    server = running.Server(None, host, 0)
    port = server.url.rstrip("/").rsplit(":", 1)[1]
    expected = public and public.format(own="192.168.7.7", port=port)
    assert server.public_url == expected
    shown = host if public is None else "127.0.0.1"
    assert server.url == f"http://{shown}:{port}/"
    server._socket.close()


def test_a_public_server_warns_and_says_how_others_reach_it():
    process = start("serve", "--host", "0.0.0.0", "--port", "0")
    try:
        port = address(process).rstrip("/").rsplit(":", 1)[1]
        line = process.stderr.readline()
    finally:
        process.kill()
        process.communicate()
    own = running._own_address()
    assert f"warning: others reach it at http://{own}:{port}/" in line
    assert "without a password" in line
    assert own not in ("127.0.0.1", "0.0.0.0", "")


def test_a_port_in_use_and_other_mistakes_are_told():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        result = CliRunner().invoke(app, ["serve", "--port", port])
    assert result.exit_code == 2
    assert f"cannot listen on 127.0.0.1, port {port}" in result.output
    result = CliRunner().invoke(app, ["serve", "--max-resolution", "large"])
    assert result.exit_code == 2
    assert "'large' is not WIDTHxHEIGHT" in result.output
    result = CliRunner().invoke(app, ["serve", "--model", "nothing"])
    assert result.exit_code == 2
    assert "unknown model" in result.output


def test_boxes_drawn_on_the_page_are_tracked_in_the_terminal(tmp_path):
    table = tmp_path / "b.csv"
    process = start(
        "track", CLIP, "--select", "--start-frame", 3, "--max-frames", 4, "--results", table
    )
    page = address(process)
    session = page.replace("/s/", "/api/sessions/")
    state = httpx2.get(session).json()
    assert (state["source"], state["width"], state["title"]) == ("select", 768, "person.mp4")
    assert "draw one first" in httpx2.post(f"{session}/done").json()["detail"]
    httpx2.post(f"{session}/objects", json={"box_xywh": BOX, "name": "the person"})
    assert httpx2.post(f"{session}/done").status_code == 204
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "--object 'the person=368.125,58.5,158,374'" in err
    rows = list(csv.DictReader(table.open()))
    assert [(row["frame"], row["object"]) for row in rows] == [
        (str(frame), "the person") for frame in range(3, 7)
    ]
    assert [float(rows[0][side]) for side in "xywh"] == BOX
    plain = tmp_path / "plain.csv"
    box = "the person=" + ",".join(map(str, BOX))
    given = ["track", CLIP, "--object", box, "--start-frame", 3, "--max-frames", 4]
    CliRunner().invoke(app, [*map(str, given), "--results", str(plain)])
    assert plain.read_text() == table.read_text()


def test_ctrl_c_while_boxes_are_drawn_tracks_nothing(tmp_path):
    process = start("track", CLIP, "--select", "--results", tmp_path / "b.csv")
    address(process)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30)
    assert process.returncode in (2, 130)
    assert list(tmp_path.iterdir()) == []


def test_select_and_boxes_exclude_each_other():
    result = CliRunner().invoke(app, ["track", str(CLIP), "--select", "--box", "1,1,5,5"])
    assert result.exit_code == 2
    assert "leave out --box" in result.output
