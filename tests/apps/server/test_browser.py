"""The page in a real browser: Chromium, headless, driven by Playwright."""

import csv
import io
import os
import re
import shutil
import time
import urllib.request

import av
import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from re3.apps.cli import app as command_line
from re3.apps.server.samples import find_sample

pytest.importorskip("playwright", reason="needs Playwright: pip install playwright")
from playwright.sync_api import expect, sync_playwright

CLIP = find_sample("person.mp4").path
LAST = 29  # frame of the short clip
PERSON = (368, 58, 158, 374)
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WEBCAM_SIZE = (384, 216)
PATIENCE = 30_000  # milliseconds


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    given = os.environ.get("RE3_CHROMIUM")
    path = given or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("needs Chromium: none on the PATH; set RE3_CHROMIUM to its program")
    webcam = tmp_path_factory.mktemp("webcam") / "clip.y4m"
    write_webcam(webcam)
    flags = [
        "--no-sandbox",
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-video-capture={webcam}",
    ]
    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        yield browser
        browser.close()


def write_webcam(path):
    """The first frames of the clip forth and back, as Chromium plays the file over and over."""
    width, height = WEBCAM_SIZE
    with av.open(str(CLIP)) as container:
        frames = [
            frame.reformat(width, height, "yuv420p").to_ndarray().tobytes()
            for frame, _ in zip(container.decode(video=0), range(12), strict=False)
        ]
    with path.open("wb") as file:
        file.write(f"YUV4MPEG2 W{width} H{height} F10:1 Ip A1:1 C420jpeg\n".encode())
        for frame in frames + frames[-2:0:-1]:
            file.write(b"FRAME\n" + frame)


@pytest.fixture(scope="module")
def base(running_server):
    with running_server() as server:
        yield server.url.rstrip("/")


@pytest.fixture
def new_page(chromium, base):
    contexts, wrong = [], []

    def make(width=1280, height=900, at=base, **options):
        viewport = {"width": width, "height": height}
        context = chromium.new_context(viewport=viewport, base_url=at, **options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: check_request(at, request.url))
        page.on("console", lambda told: told.type == "error" and note(told.text))
        return page

    def check_request(at, url):
        if not url.startswith((at, "blob:" + at, at.replace("http", "ws", 1))):
            wrong.append(f"asked for {url}")

    def note(text):
        # What the server refuses is shown on the page; the browser notes it as well.
        if "status of 4" not in text and "WebSocket connection" not in text:
            wrong.append(text)

    yield make
    for context in contexts:
        context.close()
    assert wrong == []


def until(page, expression):
    """Wait for it. Playwright's own waiting evaluates strings, which the page's policy forbids."""
    deadline = time.monotonic() + PATIENCE / 1000
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, expression
        page.wait_for_timeout(40)


def open_sample(page):
    page.goto("/")
    page.get_by_role("button", name="Try the sample clip").click()
    wait_for_first_frame(page)


def wait_for_first_frame(page):
    expect(page.locator("#hint")).to_contain_text("Draw a box around something to track")
    until(page, "re3.stage.picture.width === 768")


def drag(page, box, size=(768, 432)):
    """Draw a box, given in pixels of the video."""
    area = page.locator("#stage").bounding_box()
    k = area["width"] / size[0]
    x, y, w, h = box
    page.mouse.move(area["x"] + x * k, area["y"] + y * k)
    page.mouse.down()
    page.mouse.move(area["x"] + (x + w / 2) * k, area["y"] + (y + h / 2) * k)
    page.mouse.move(area["x"] + (x + w) * k, area["y"] + (y + h) * k)
    page.mouse.up()


def boxes(page):
    return page.evaluate("fetch(`/api/sessions/${re3.id}/boxes`).then((answer) => answer.json())")


def track_to_the_end(page):
    page.locator("#speed").select_option("0")
    page.locator("#stage").focus()
    page.keyboard.press("Space")
    expect(page.locator("#hint")).to_contain_text("The end of the video")
    until(page, f"re3.model.shown === {LAST}")


def exported_rows(page):
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    return list(csv.DictReader(io.StringIO(download.value.path().read_text())))


def rows_of_the_command_line(clip, box, start=0):
    numbers = ",".join(map(repr, box))
    path = clip.with_suffix(f".{start}.csv")
    given = ["track", str(clip), "--object", f"object 1={numbers}", "--results", str(path)]
    given += ["--start-frame", str(start)]
    assert CliRunner().invoke(command_line, given).exit_code == 0
    return list(csv.DictReader(path.open()))


def test_draw_track_correct_and_export(new_page, short_clip):
    page = new_page()
    page.goto("/")
    page.locator("#choose:enabled").wait_for()
    page.locator("#file").set_input_files(short_clip)
    wait_for_first_frame(page)
    drag(page, PERSON)
    expect(page.locator("#hint")).to_have_text("Press Space to track. Or draw more boxes.")
    (first,) = boxes(page)
    drawn = first["results"][0]["box_xywh"]
    assert drawn == pytest.approx(PERSON, abs=2)
    track_to_the_end(page)
    rows = exported_rows(page)
    assert rows == rows_of_the_command_line(short_clip, drawn)
    assert len(rows) == LAST + 1

    # Seek by the chart, correct by dragging, and go on.
    area = page.locator("#chart").bounding_box()
    page.mouse.click(area["x"] + area["width"] * 0.5, area["y"] + area["height"] / 2)
    until(page, f"Math.abs(re3.model.shown - {LAST / 2}) < 3")
    at = page.evaluate("re3.model.shown")
    page.keyboard.press("ArrowLeft")
    until(page, f"re3.model.shown === {at - 1}")
    page.keyboard.press("ArrowRight")
    until(page, f"re3.model.shown === {at}")
    x, y, w, h = page.evaluate("re3.model.box(1)")
    drag(page, (x + w / 2, y + h / 2, 20, 10))  # inside the selected box: moves it
    until(page, f"re3.model.object(1).given.includes({at})")
    until(page, "re3.model.session.catching_up === 0")
    corrected = boxes(page)[at]["results"][0]["box_xywh"]
    inside = (min(x + 20, 768 - w), min(y + 10, 432 - h), w, h)
    assert corrected == pytest.approx(inside, abs=2)
    assert corrected[2:] == pytest.approx([w, h], abs=0.01)  # boxes are drawn in 1/100 pixels
    track_to_the_end(page)
    again = exported_rows(page)
    assert again[:at] == rows[:at]
    assert again[at:] == rows_of_the_command_line(short_clip, corrected, start=at)

    # The link opens the same session in another tab.
    other = new_page()
    other.goto(page.url)
    until(other, f"window.re3?.model.shown === {LAST}")
    assert other.evaluate("re3.model.results().length") == 1
    expect(other.get_by_role("textbox", name="Name of object 1")).to_have_value("object 1")


def test_several_objects_names_colours_and_mistakes(new_page):
    page = new_page()
    open_sample(page)
    drag(page, PERSON)
    until(page, "re3.model.selected === 1")
    page.get_by_role("button", name="Add object").click()
    expect(page.locator("#hint")).to_have_text("Draw a box around the new object.")
    drag(page, (400, 150, 120, 200))  # inside the first object's box
    until(page, "re3.model.objects.length === 2")
    name = page.get_by_role("textbox", name="Name of object 2")
    name.fill("object 1")
    name.press("Enter")
    expect(page.locator(".object .problem").nth(1)).to_contain_text("another object is called")
    name = page.get_by_role("textbox", name="Name of object 2")
    name.fill("the door")
    name.press("Enter")
    page.get_by_label("Colour of the door").fill("#ff8800")
    until(page, "re3.model.object(2).colour === '#ff8800'")
    page.locator("#forward").click()
    until(page, "re3.model.shown === 1 && re3.model.results().length === 2")
    expect(page.locator("#hint")).to_contain_text("Drag the box or its corners")
    expect(page.locator(".object .status").nth(0)).not_to_have_text("drawn here")
    drag(page, (700, 100, 200, 100))  # beyond the edge: cut off there
    until(page, "re3.model.box(3) !== null")
    expect(page.locator(".object .status").nth(2)).to_have_text("drawn here")
    x, _, w, _ = page.evaluate("re3.model.box(3)")
    assert x + w == pytest.approx(768)
    page.get_by_role("button", name="Remove object 3").click()
    page.get_by_role("button", name="Redraw the door").click()
    expect(page.locator("#hint")).to_have_text("Draw a box around the door.")
    drag(page, PERSON)
    until(page, "re3.model.object(2).given.length === 2")
    page.locator("#forward").click()
    until(page, "re3.model.shown === 2")
    page.get_by_role("button", name="End here the door").click()
    until(page, "re3.model.results().length === 1 && re3.model.object(2).ends[0] === 2")
    expect(page.locator(".object .status").nth(1)).to_have_text("ended")
    page.go_back()
    page.get_by_role("button", name="Try the sample clip").wait_for()


def test_keyboard_alone(new_page):
    page = new_page()
    page.goto("/")
    page.locator("#sample:enabled").focus()
    page.keyboard.press("Enter")
    until(page, "document.activeElement.id === 'stage' && re3.stage.picture.width === 768")
    page.keyboard.press("Enter")
    for key in ("ArrowRight", "ArrowDown", "Shift+ArrowDown", "Shift+ArrowLeft"):
        page.keyboard.press(key)
    expect(page.locator("#hint")).to_contain_text("pixels at")
    page.keyboard.press("Enter")
    until(page, "re3.model.box(1) !== null")
    assert page.evaluate("re3.model.box(1)") == pytest.approx((297.6, 139.2, 182.4, 182.4), abs=0.1)
    page.keyboard.press("Space")
    until(page, "re3.model.shown > 3")
    page.keyboard.press("Space")
    expect(page.locator("#hint")).to_contain_text("Paused.")
    page.locator("#chart").focus()
    page.keyboard.press("Home")
    until(page, "re3.model.shown === 0")
    page.locator("#stage").focus()
    asked = []
    page.on("dialog", lambda dialog: (asked.append(dialog.message), dialog.accept()))
    page.keyboard.press("Delete")
    until(page, "re3.model.objects.length === 0")
    assert re.fullmatch(r"Remove object 1 and its boxes in \d+ frames\?", asked[0])


def test_a_finger_on_a_phone(new_page):
    page = new_page(390, 844, has_touch=True, is_mobile=True)
    open_sample(page)
    area = page.locator("#stage").bounding_box()
    touch = page.context.new_cdp_session(page)
    path = [(0.48, 0.14), (0.55, 0.5), (0.68, 0.98)]
    for kind, point in zip(("touchStart", "touchMove", "touchMove"), path, strict=True):
        x, y = area["x"] + point[0] * area["width"], area["y"] + point[1] * area["height"]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, "re3.model.objects.length === 1")
    for _ in range(10):  # Chromium makes no click of a tap soon after a drag
        page.wait_for_timeout(300)
        if page.locator("#play").inner_text() != "Track":
            break
        page.locator("#play").tap()
    until(page, "re3.model.shown > 2")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.get_by_text("drop a video file").is_hidden()  # nothing can be dropped
    expect(page.locator("#hint")).to_contain_text("Tap")


def test_a_webcam_is_tracked_end_to_end(new_page):
    page = new_page()
    page.goto("/")
    page.get_by_role("button", name="Use the webcam").click()
    until(page, "re3.model.shown > 2")
    width, height = page.evaluate("re3.stage.size")
    k = width / 768
    assert height == pytest.approx(432 * k, abs=1)
    drag(page, [v * k for v in PERSON], (width, height))
    until(page, "re3.model.objects.length === 1")
    start = page.evaluate("re3.model.object(1).first")
    until(page, f"re3.model.shown > {start} + 25")
    page.keyboard.press("Space")
    expect(page.locator("#hint")).to_contain_text("Paused.")
    until(page, "re3.camera.sent.size === 0")
    found = page.evaluate("re3.model.result(1)")
    assert found["score"] > 0.5
    assert found["box_xywh"] == pytest.approx([v * k for v in PERSON], abs=60 * k)
    assert 0 < page.evaluate("re3.camera.most") <= 2
    assert re.fullmatch(r"\d+ ms", page.locator("#latency").inner_text())
    rows = exported_rows(page)
    assert len(rows) >= 25
    shown = page.evaluate("re3.model.shown")
    page.keyboard.press("ArrowLeft")
    until(page, f"re3.model.shown === {shown - 1}")
    page.keyboard.press("Space")
    until(page, f"re3.model.shown > {shown} + 3")


def test_a_video_is_dropped_onto_the_page_and_mistakes_are_told(new_page, tmp_path):
    page = new_page()
    page.goto("/")
    (tmp_path / "no video.mp4").write_text("text")
    page.locator("#file").set_input_files(tmp_path / "no video.mp4")
    expect(page.locator("#banner")).to_contain_text("not one that can be tracked in")
    data = page.evaluate_handle(
        """async () => {
            const session = await (await fetch('/api/sessions', {method: 'POST',
              headers: {'Content-Type': 'application/json'},
              body: JSON.stringify({source: 'sample', name: 'person.mp4'})})).json();
            const picture = await (await fetch(`/api/sessions/${session.id}/frame.jpg`)).blob();
            const data = new DataTransfer();
            data.items.add(new File([picture], 'ä "drop" <b>.jpg'));
            return data;
        }"""
    )
    page.dispatch_event("#drop", "drop", {"dataTransfer": data})
    expect(page.locator("#title")).to_have_text('ä "drop" <b>.jpg')
    until(page, "re3.stage.picture.width === 768")


def test_a_file_chosen_before_the_server_has_answered_is_opened(new_page, tmp_path):
    page = new_page()
    held = []
    page.route("**/api/about", lambda route: held.append(route))
    page.goto("/")
    (tmp_path / "no video.mp4").write_text("text")
    page.locator("#file").set_input_files(tmp_path / "no video.mp4")
    assert page.locator("#choose").is_disabled()
    (asked,) = held
    asked.continue_()
    expect(page.locator("#banner")).to_contain_text("not one that can be tracked in")


def open_short(page, short_clip):
    """The short clip, with the person tracked to its end."""
    page.goto("/")
    page.locator("#choose:enabled").wait_for()
    page.locator("#file").set_input_files(short_clip)
    wait_for_first_frame(page)
    drag(page, PERSON)
    until(page, "re3.model.objects.length === 1")
    track_to_the_end(page)


def go_to_the_first_frame(page):
    page.locator("#chart").focus()
    page.keyboard.press("Home")
    until(page, "re3.model.shown === 0")
    page.locator("#stage").focus()


def known(page):
    """Frames of the first object that the page knows."""
    return page.evaluate(
        "[...re3.model.frames].filter(([, f]) => f.results.some((r) => r.object === 1)).length"
    )


def status(page, path):
    return page.evaluate(f"fetch('{path}').then((answer) => answer.status)")


def test_an_early_change_is_tracked_again_and_can_be_undone(new_page, short_clip):
    page = new_page()
    open_short(page, short_clip)
    before = boxes(page)
    go_to_the_first_frame(page)
    x, y, w, h = page.evaluate("re3.model.box(1)")
    drag(page, (x + w / 2, y + h / 2, 5, 0))
    until(page, "re3.model.session.undo === 'box of object 1'")
    until(page, "re3.model.session.catching_up === 0")
    assert page.evaluate("re3.model.shown") == 0
    assert known(page) == LAST + 1
    after = boxes(page)
    assert len(after) == LAST + 1
    assert after[5] != before[5]
    page.keyboard.press("Control+z")
    until(page, "re3.model.session.redo === 'box of object 1'")
    assert boxes(page) == before
    until(page, f"re3.model.box(1)[0] === {before[0]['results'][0]['box_xywh'][0]}")
    page.keyboard.press("Control+Shift+z")
    until(page, "re3.model.session.redo === null")
    assert boxes(page) == after
    page.get_by_role("button", name="Undo").click()
    until(page, "re3.model.session.redo !== null")
    page.keyboard.press("Control+y")
    until(page, "re3.model.session.redo === null")
    assert known(page) == LAST + 1

    page.on("dialog", lambda dialog: dialog.accept())
    page.keyboard.press("Backspace")
    until(page, "re3.model.objects.length === 0")
    assert known(page) == 0
    page.keyboard.press("Control+z")
    until(page, "re3.model.objects.length === 1 && re3.model.box(1) !== null")
    until(page, "re3.model.frames.get(20).results.length === 1")
    assert known(page) == LAST + 1


def test_what_is_not_tracked_is_told_and_a_video_is_written(new_page, short_clip):
    page = new_page()
    open_short(page, short_clip)
    expect(page.locator("#untracked")).to_be_hidden()
    go_to_the_first_frame(page)
    page.evaluate("fetch(`/api/sessions/${re3.id}/objects/1`, {method: 'DELETE'})")
    until(page, "re3.model.objects.length === 0")
    drag(page, PERSON)
    until(page, "re3.model.objects.length === 1")
    expect(page.locator("#untracked-text")).to_have_text(
        f"Not tracked: object 2 in frames 1 to {LAST}."
    )
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").click()
    assert download.value.suggested_filename == "short-incomplete.csv"
    expect(page.locator("#hint")).to_contain_text("The file is not complete")
    page.get_by_role("button", name="Track the rest").click()
    expect(page.locator("#hint")).to_contain_text("The end of the video")
    expect(page.locator("#untracked")).to_be_hidden()
    with page.expect_download() as download:
        page.get_by_role("link", name="MP4").click()
        expect(page.locator("#writing-text")).to_contain_text("Writing the video")
    assert download.value.suggested_filename == "short.mp4"
    with av.open(str(download.value.path())) as container:
        assert sum(1 for _ in container.decode(video=0)) == LAST + 1
    expect(page.locator("#writing")).to_be_hidden()
    page.get_by_role("link", name="MP4").click()
    page.locator("#writing-cancel").click()
    expect(page.locator("#writing")).to_be_hidden()
    expect(page.locator("#banner")).to_be_hidden()
    page.wait_for_timeout(500)
    with page.expect_download():
        page.get_by_role("link", name="JSON", exact=True).click()


def test_an_upload_shows_how_far_it_is_and_can_be_cancelled(new_page, tmp_path):
    page = new_page()
    page.goto("/")
    page.locator("#choose:enabled").wait_for()
    network = page.context.new_cdp_session(page)
    slow = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": 400_000}
    network.send("Network.enable")
    network.send("Network.emulateNetworkConditions", slow)
    (tmp_path / "large.mp4").write_bytes(CLIP.read_bytes() + bytes(3_000_000))
    with page.expect_response(lambda answer: answer.url.endswith("/api/sessions")) as made:
        page.locator("#file").set_input_files(tmp_path / "large.mp4")
    session = made.value.json()["id"]
    expect(page.locator("#busy-text")).to_have_text(
        re.compile(r"Uploading large\.mp4: [1-9]\d? % of \d\.\d MB")
    )
    assert 0 < page.evaluate("document.getElementById('busy-bar').value") < 1
    page.locator("#busy-cancel").click()
    expect(page.locator("#busy")).to_be_hidden()
    expect(page.locator("#banner")).to_be_hidden()
    assert status(page, f"/api/sessions/{session}") == 404
    page.get_by_role("button", name="Try the sample clip").click()
    wait_for_first_frame(page)


def test_small_objects_are_drawn_zoomed_in(new_page):
    page = new_page()
    open_sample(page)
    area = page.locator("#stage").bounding_box()
    k = area["width"] / 768
    page.mouse.move(area["x"] + 400 * k, area["y"] + 100 * k)
    while page.evaluate("re3.stage.zoom") < 5:
        page.mouse.wheel(0, -120)
        page.wait_for_timeout(20)
    zoom, (left, top) = page.evaluate("[re3.stage.zoom, re3.stage.corner]")
    # The point under the pointer has stayed.
    assert left + 400 / zoom == pytest.approx(400, abs=1)
    assert top + 100 / zoom == pytest.approx(100, abs=1)
    drag(page, ((398 - left) * zoom, (98 - top) * zoom, 6 * zoom, 5 * zoom))
    until(page, "re3.model.box(1) !== null")
    assert page.evaluate("re3.model.box(1)") == pytest.approx((398, 98, 6, 5), abs=0.3)
    page.mouse.down(button="middle")
    page.mouse.move(area["x"] + 300 * k, area["y"] + 50 * k)
    page.mouse.up(button="middle")
    assert page.evaluate("re3.stage.corner[0]") > left
    page.locator("#stage").focus()
    page.keyboard.press("0")
    expect(page.locator("#zoom-fit")).to_have_text("100 %")
    page.get_by_role("button", name="Zoom in").click()
    expect(page.locator("#zoom-fit")).to_have_text("150 %")
    x, y = page.evaluate("[0, 1].map((i) => re3.stage.corner[i] + re3.stage.size[i] / 3)")
    assert (x, y) == pytest.approx((401, 144), abs=1)  # the box in the middle, as far as it can be
    page.keyboard.press("-")
    assert page.evaluate("[re3.stage.zoom, ...re3.stage.corner]") == [1, 0, 0]


def test_large_frames_are_shown_in_all_their_pixels_when_zoomed(new_page, tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (1080, 1920, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "large.png"), image)
    page = new_page()
    page.goto("/")
    page.locator("#choose:enabled").wait_for()
    page.locator("#file").set_input_files(tmp_path / "large.png")
    until(page, "re3.stage.picture.width === 1280")
    page.locator("#stage").focus()
    page.keyboard.press("+")
    until(page, "re3.stage.picture.width === 1920")


def test_dragging_in_the_chart_looks_through_the_video(new_page, short_clip):
    page = new_page()
    page.goto("/")
    page.locator("#choose:enabled").wait_for()
    page.locator("#file").set_input_files(short_clip)
    wait_for_first_frame(page)
    drag(page, PERSON)
    until(page, "re3.model.objects.length === 1")
    area = page.locator("#chart").bounding_box()
    seen = set()
    page.mouse.move(area["x"] + 10, area["y"] + 20)
    page.mouse.down()
    for step in range(1, 20):
        page.mouse.move(area["x"] + 10 + step * area["width"] / 25, area["y"] + 20)
        page.wait_for_timeout(60)
        seen.add(page.evaluate("re3.model.shown"))
    page.mouse.up()
    until(page, "re3.looking === null && re3.model.shown > 20")
    assert len(seen) > 4
    assert page.evaluate("re3.model.session.tracked_until") == 0
    expect(page.locator("#hint")).to_contain_text("Not tracked up to here.")
    expect(page.locator(".object .status")).to_have_text("not tracked yet")
    page.locator("#speed").select_option("0")
    page.locator("#stage").focus()
    page.keyboard.press("Space")
    until(page, f"re3.model.shown === {LAST}")
    assert len(boxes(page)) == LAST + 1


def test_messages_do_not_move_the_video_and_fingers_find_the_buttons(new_page):
    for options in ({}, {"width": 390, "height": 844, "has_touch": True, "is_mobile": True}):
        page = new_page(**options)
        open_sample(page)
        drag(page, PERSON)
        until(page, "re3.model.objects.length === 1")
        place = page.locator("#stage").bounding_box()
        page.evaluate("re3.banner('what is wrong, and what to do about it; '.repeat(8), 'Do it')")
        expect(page.locator("#banner")).to_contain_text("What is wrong")
        assert page.locator("#stage").bounding_box() == place
        page.get_by_role("button", name="Close this message").click()
        expect(page.locator("#banner")).to_be_hidden()
    small = page.evaluate(
        """[...document.querySelectorAll("button, select, summary, a, input")]
          .filter((each) => each.offsetParent && Math.min(each.offsetWidth, each.offsetHeight) < 44)
          .map((each) => `${each.id} ${each.textContent}`)"""
    )
    assert small == []


def test_two_fingers_zoom_and_draw_nothing(new_page):
    page = new_page(390, 844, has_touch=True, is_mobile=True)
    open_sample(page)
    area = page.locator("#stage").bounding_box()
    touch = page.context.new_cdp_session(page)
    middle = (area["x"] + area["width"] / 2, area["y"] + area["height"] / 2)
    for step, kind in enumerate(("touchStart", *["touchMove"] * 5)):
        points = [
            {"x": middle[0] + side * (20 + 15 * step), "y": middle[1], "id": number}
            for number, side in enumerate((-1, 1))
        ]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert page.evaluate("re3.stage.zoom") > 2
    assert page.evaluate("re3.stage.corner[0] + re3.stage.size[0] / re3.stage.zoom / 2") == (
        pytest.approx(384, abs=40)
    )
    assert page.evaluate("re3.model.objects.length") == 0


def test_another_video_frees_the_session(new_page):
    page = new_page()
    open_sample(page)
    drag(page, PERSON)
    until(page, "re3.model.objects.length === 1")
    session = page.evaluate("re3.id")
    asked = []
    page.once("dialog", lambda dialog: (asked.append(dialog.message), dialog.dismiss()))
    page.get_by_role("button", name="Another video").click()
    assert "Its boxes are forgotten" in asked[0]
    assert status(page, f"/api/sessions/{session}") == 200
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Another video").click()
    page.get_by_role("button", name="Try the sample clip").wait_for()
    assert status(page, f"/api/sessions/{session}") == 404
    expect(page.locator("#banner")).to_be_hidden()


def test_a_session_that_ends_and_a_server_that_stops_are_told_of(new_page, running_server):
    with running_server() as server:
        url = server.url.rstrip("/")
        page = new_page(at=url)
        open_sample(page)
        session = page.evaluate("re3.id")
        request = urllib.request.Request(f"{url}/api/sessions/{session}", method="DELETE")
        urllib.request.urlopen(request).close()
        expect(page.locator("#banner")).to_contain_text("This session has been ended.")
        assert page.locator("#play").is_disabled()
        page.goto(f"/s/{session}")
        expect(page.locator("#banner")).to_contain_text("There is no such session")
        page.get_by_role("button", name="Try the sample clip").click()
        until(page, "re3.model.ready")
    expect(page.locator("#banner")).to_contain_text("connection to the server is lost")
    expect(page.locator("#hint")).to_have_text("Waiting for the server …")
    assert page.locator("#play").is_disabled()


def test_labels_and_contrast_pass_axe(new_page):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = new_page(reduced_motion="reduce")  # colours change at once

    def check(screen):
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            until(page, f"document.documentElement.dataset.theme === '{scheme}'")
            found = axe.run(page)
            assert found.violations_count == 0, f"{screen}, {scheme}: {found.generate_report()}"

    page.goto("/")
    page.locator("#sample:enabled").wait_for()
    check("start")
    page.locator("#sample").click()
    wait_for_first_frame(page)
    drag(page, PERSON)
    until(page, "re3.model.objects.length === 1")
    check("work")
    page.goto("/docs")
    page.get_by_text("SessionState").first.wait_for()
    check("docs")
