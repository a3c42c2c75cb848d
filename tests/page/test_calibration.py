"""The calibration page in a real browser: clicks in picture and plan, what comes of them, and what is saved."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surveilnav.camera_pose import FloorPlan, load_clicks
from surveilnav.cameras_file import load_cameras
from tests.clicked_points import pose_error
from tests.drawn_room import LANDMARKS, ORIGIN_M, RESOLUTION_M, T_WORLD_CAMERA, pixels_of, write_room
from tests.page.conftest import PATIENCE_MS
from tests.waiting import until

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright isn't installed: pip install -e '.[dev]'")
expect = sync_api.expect
expect.set_options(timeout=PATIENCE_MS)

SIZES = {"picture": (1280, 960), "plan": (450, 350)}
PLAN = FloorPlan(*SIZES["plan"], RESOLUTION_M, ORIGIN_M)
PICTURE_PX = pixels_of(np.array(LANDMARKS))
PLAN_PX = PLAN.pixels_of(np.array(LANDMARKS))
#: The 90th percentile of ten points in docs/results/real_cameras.md.
MAX_ERROR_M, MAX_ERROR_DEG = 0.08, 0.6


@pytest.fixture
def room(tmp_path: Path) -> Path:
    write_room(tmp_path)
    return tmp_path


@pytest.fixture
def started(room: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """``started(*options)``: the command as it is typed, and the address that it prints."""
    running: list[subprocess.Popen[str]] = []

    def start(*options: str) -> tuple[subprocess.Popen[str], str]:
        typed = ["-m", "surveilnav.cli.main", "cameras", "calibrate", "lobby", "--plan", "map.yaml", "--no-browser"]
        command = subprocess.Popen([sys.executable, *typed, *options], cwd=room, stdout=subprocess.PIPE, text=True)
        running.append(command)
        assert command.stdout
        return command, command.stdout.readline().strip()

    yield start
    for command in running:
        command.kill()
        command.wait()
        assert command.stdout
        command.stdout.close()


@pytest.fixture
def open_page(browser: Any, started: Any) -> Iterator[Callable[..., Any]]:
    """``open_page(*options)``: the page of the command; it loads nothing from elsewhere, and no script fails."""
    contexts, said = [], list[str]()

    def go(*options: str, **more: Any) -> Any:
        _, url = started(*options)
        context = browser.new_context(**({"viewport": {"width": 1200, "height": 800}} | more))
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
        page.on("request", lambda r: None if r.url.startswith((url, "blob:")) else said.append(f"asked for {r.url}"))
        page.goto(url)
        page.locator("#picture canvas").wait_for()
        page.wait_for_load_state("networkidle")
        return page

    yield go
    for context in contexts:
        context.close()
    assert [text for text in said if not text.startswith("Failed to load resource")] == []


def on_screen(page: Any, stage: str, at: Any) -> tuple[float, float]:
    """Where the screen shows a pixel while all of a picture is shown."""
    box = page.locator(f"#{stage} canvas").bounding_box()
    width, height = SIZES[stage]
    scale = min(box["width"] / width, box["height"] / height)
    left, top = box["x"] + (box["width"] - width * scale) / 2, box["y"] + (box["height"] - height * scale) / 2
    return left + (at[0] + 0.5) * scale, top + (at[1] + 0.5) * scale


def click(page: Any, stage: str, at: Any) -> None:
    page.mouse.click(*on_screen(page, stage, at))


def drag(page: Any, stage: str, start: Any, end: Any) -> None:
    page.mouse.move(*on_screen(page, stage, start))
    page.mouse.down()
    page.mouse.move(*on_screen(page, stage, (np.array(start) + end) / 2), steps=4)
    page.mouse.move(*on_screen(page, stage, end), steps=4)
    page.mouse.up()


def set_point(page: Any, number: int, off_px: tuple[float, float] = (0.0, 0.0)) -> None:
    """Clicks a landmark in the picture, and where it is on the plan, ``off_px`` beside it."""
    height = "Door top" if LANDMARKS[number][2] else "Floor"
    page.get_by_role("button", name=height, exact=True).click()
    click(page, "picture", PICTURE_PX[number])
    click(page, "plan", PLAN_PX[number] + off_px)


def rows(page: Any) -> Any:
    return page.locator("#points tr[data-point]")


def colour(page: Any, stage: str, at: Any) -> list[int]:
    x, y = on_screen(page, stage, at)
    read = """([id, x, y]) => { const c = document.querySelector(`#${id} canvas`), b = c.getBoundingClientRect();
        return [...c.getContext("2d").getImageData(Math.floor(x - b.left), Math.floor(y - b.top), 1, 1).data]; }"""
    return list(page.evaluate(read, [stage, x, y]))[:3]


def test_clicked_points_give_the_pose_and_saving_writes_it(open_page, room):
    page = open_page()
    before = (room / "cameras.yaml").read_text().splitlines()
    save = page.get_by_role("button", name="Save into cameras.yaml")
    expect(page.locator("#next")).to_contain_text("Click a point in the picture")
    expect(save).to_be_disabled()
    for number in range(len(LANDMARKS)):
        set_point(page, number)
    expect(page.locator("#next")).to_contain_text("do the pink lines follow")
    expect(rows(page)).to_have_count(len(LANDMARKS))
    assert [int(float(v)) for v in page.locator("#points input").evaluate_all("all => all.map(e => e.value)")] == [
        int(z) for _, _, z in LANDMARKS
    ]
    expect(page.locator("#verdict")).to_have_text("usable")
    expect(page.locator("#pose")).to_contain_text("yaw")
    expect(page.locator("#pose")).to_contain_text("± 0.0")
    save.click()
    expect(page.locator("#said")).to_contain_text("lobby has its new place: position_m [")
    error = pose_error(load_cameras(room / "cameras.yaml").cameras["lobby"].pose(), T_WORLD_CAMERA)
    assert np.linalg.norm(error[:3]) < MAX_ERROR_M
    assert math.degrees(np.linalg.norm(error[3:])) < MAX_ERROR_DEG
    after = (room / "cameras.yaml").read_text().splitlines()
    assert [line for line in after if line in before] == [line for line in before if "guessed" not in line]
    assert sum("# guessed" in line for line in after) == 2


def test_the_plan_is_drawn_into_the_picture(open_page):
    page = open_page()
    for number in range(len(LANDMARKS)):
        set_point(page, number)
    expect(page.locator("#verdict")).to_be_visible()
    foot, on_plan = pixels_of(np.array([(7.0, 3.8, 0.0)]))[0], PLAN.pixels_of(np.array([2.0, 2.0]))
    around = [foot + np.array([0, dv]) for dv in range(-6, 7, 2)]  # a click is only so exact

    def pink() -> bool:
        return any(r > 180 and g < 130 and b > 150 for r, g, b in (colour(page, "picture", at) for at in around))

    assert pink()
    r, g, b = colour(page, "plan", on_plan)  # in view of the camera: tinted
    assert r < 250
    assert g < 240 < b
    page.get_by_label("walls").uncheck()
    assert not pink()


def test_a_point_that_contradicts_the_others_is_named_until_it_is_dragged_right(open_page):
    page = open_page()
    wrong, off = 6, (30.0, 14.0)
    for number in range(len(LANDMARKS)):
        set_point(page, number, off if number == wrong else (0.0, 0.0))
    bad = page.locator("#points tr.bad")
    expect(bad).to_have_count(1)
    expect(bad).to_contain_text("contradicts the others")
    assert bad.get_attribute("data-point") == str(wrong + 1)
    expect(page.locator("#next")).to_have_text(
        "Check point 7: is it the same place in the picture and on the plan, and is its height right?"
    )
    drag(page, "plan", PLAN_PX[wrong] + off, PLAN_PX[wrong])
    expect(bad).to_have_count(0)
    page.keyboard.press("Control+z")  # the whole drag is one step
    expect(bad).to_have_count(1)
    bad.click()
    page.keyboard.press("Delete")
    expect(rows(page)).to_have_count(len(LANDMARKS) - 1)
    expect(bad).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(bad).to_have_count(1)


def test_a_wrong_height_is_corrected_in_the_list(open_page):
    page = open_page()
    for number in range(len(LANDMARKS)):
        set_point(page, number)
    expect(page.locator("#points tr.bad")).to_have_count(0)
    height = page.get_by_label("Height of point 4 in metres")
    height.fill("0")
    height.press("Enter")
    expect(page.locator("#points tr.bad")).to_have_attribute("data-point", "4")
    height.fill("2.0")
    height.press("Enter")
    expect(page.locator("#points tr.bad")).to_have_count(0)


def saved_points(page, n: int) -> list[dict[str, Any]]:
    """The points that the command holds, once they are ``n``: the page shows a point before the command has heard of it."""
    read = "async () => (await (await fetch('state')).json()).points"
    return until(lambda: points if len(points := page.evaluate(read)) == n else None, "the command never got them")


def test_the_top_of_a_door_takes_its_foots_place_from_the_marker(open_page):
    page = open_page()
    set_point(page, 0)
    page.get_by_role("button", name="Door top", exact=True).click()
    click(page, "picture", PICTURE_PX[2])
    click(page, "plan", PLAN_PX[0] + (4.0, 4.0))
    expect(rows(page)).to_have_count(2)
    first, second = saved_points(page, 2)
    assert second["plan_px"] == first["plan_px"]
    assert (first["z_m"], second["z_m"]) == (0, 2)


def test_one_clicks_to_a_fraction_of_a_pixel_when_zoomed_in(open_page):
    page = open_page()
    box = page.locator("#picture canvas").bounding_box()
    middle = round(box["x"] + box["width"] / 2), round(box["y"] + box["height"] / 2)  # a mouse is at whole pixels
    page.mouse.move(*middle)
    for _ in range(12):
        page.mouse.wheel(0, -300)  # what is under the pointer stays there
    for number, right in enumerate((0, 60)):
        page.mouse.click(middle[0] + right, middle[1])
        click(page, "plan", (100 + 50 * number, 200))
        expect(rows(page)).to_have_count(number + 1)
    page.keyboard.press("Shift+ArrowRight")  # the plan has the focus
    first, second = saved_points(page, 2)
    shown = on_screen(page, "picture", first["px"])  # before the zoom
    assert shown == pytest.approx(middle, abs=0.1)
    assert np.subtract(second["px"], first["px"]) == pytest.approx(
        [1.5, 0], abs=0.01
    )  # of 40 pixels of the screen each
    assert second["plan_px"][0] - first["plan_px"][0] == pytest.approx(50.25, abs=1.1)


def test_points_survive_a_reload_and_go_on_another_day(open_page, room):
    page = open_page()
    for number in range(5):
        set_point(page, number)
    expect(rows(page)).to_have_count(5)
    page.reload()
    expect(rows(page)).to_have_count(5)
    expect(page.locator("#verdict")).to_be_visible()
    page.get_by_role("button", name="Save the clicks").click()
    expect(page.locator("#said")).to_contain_text("lobby.clicks.yaml: 5 points written")
    assert load_clicks(room / "lobby.clicks.yaml").p_floor == pytest.approx(np.array(LANDMARKS[:5]), abs=0.03)
    other = open_page()
    expect(rows(other)).to_have_count(5)


def test_without_picture_and_pose_the_page_says_why(open_page, room):
    text = (room / "cameras.yaml").read_text()
    (room / "cameras.yaml").write_text(text.replace("stream: frames", "stream: gone"))
    page = open_page()
    expect(page.locator("#picture .told")).to_contain_text("the stream of lobby gives no picture")
    (room / "cameras.yaml").write_text(text)
    page.get_by_role("button", name="Take a new picture").click()
    expect(page.locator("#picture .told")).to_have_count(0)
    for number in range(3):
        set_point(page, number)
    expect(page.locator("#problem")).to_have_text("A pose needs at least 4 points, and is good from 6 on; got 3.")
    expect(page.get_by_role("button", name="Save into cameras.yaml")).to_be_disabled()
    for at in ((100, 100), (160, 100), (220, 100), (280, 140)):  # anywhere
        click(page, "picture", (at[0] + 500, 850))
        click(page, "plan", at)
    expect(page.locator("#problem")).to_contain_text("contradict each other")
    expect(page.locator("#points tr.bad")).to_have_count(3)
    expect(page.get_by_role("button", name="Save into cameras.yaml")).to_be_disabled()


def test_the_command_ends_by_ctrl_c_and_the_page_says_so(started, browser):
    command, url = started()
    page = browser.new_page(viewport={"width": 1200, "height": 800})
    page.goto(url)
    page.locator("#picture canvas").wait_for()
    page.wait_for_load_state("networkidle")
    command.send_signal(signal.SIGINT)
    assert command.wait(timeout=30) == 0
    set_point(page, 0)
    expect(page.get_by_role("alert")).to_contain_text("The command that serves this page has ended")
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_1200_pixels_and_axe_finds_nothing_serious(open_page, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python isn't installed")
    page = open_page(color_scheme=scheme, bypass_csp=True)
    for number in range(6):
        set_point(page, number, (20.0, 0.0) if number == 4 else (0.0, 0.0))
    expect(rows(page)).to_have_count(6)
    assert page.evaluate("document.documentElement.scrollWidth") <= 1200
    assert page.evaluate("document.documentElement.scrollHeight") <= 800
    found = axe.Axe().run(page).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"][:200]) for v in found if v["impact"] in ("serious", "critical")] == []
