"""The page in a real browser: Chromium, headless, driven by Playwright."""

import csv
import io
import os
import re
import shutil
import time
import urllib.request

import av
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
