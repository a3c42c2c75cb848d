"""The page as people use it: in a browser, on real processes, a robot that really searches."""

from __future__ import annotations

import re
from typing import Any

import httpx
import pytest

from surveilnav.bus import clock_ns
from surveilnav.contract import PASSAGE_STATE
from surveilnav.messages import PassageState
from tests.page.conftest import PHONE
from tests.waiting import until

pytestmark = pytest.mark.slow


def submit(page: Any, target: str) -> str:
    """Sends a mission by the form; its id."""
    known = ids(page)
    page.fill("#target", target)
    page.get_by_role("button", name="Search", exact=True).click()
    return until(lambda: next(iter(ids(page) - known), None), lambda: page.inner_text("#missions"), timeout_s=60)


def ids(page: Any) -> set[str]:
    return set(page.locator("tr[data-mission]").evaluate_all("rows => rows.map(r => r.dataset.mission)"))


def row(page: Any, id: str) -> Any:
    return page.locator(f"tr[data-mission='{id}']")


def where(page: Any) -> str:
    """The robot's place as the page has it in words."""
    return str(page.locator("[data-robot]").inner_text())


def pixels(page: Any, canvas: str = "canvas") -> int:
    """How many pixels of the map are drawn."""
    drawn = """c => {
        const { data } = c.getContext("2d").getImageData(0, 0, c.width, c.height);
        return new Uint32Array(data.buffer).filter(p => p >>> 24).length;
    }"""
    return int(page.locator(canvas).evaluate(drawn))


def test_a_search_from_the_form_to_the_confirmed_object(open_page):
    page = open_page()
    until(lambda: pixels(page) > 10_000, "the map stays empty", timeout_s=60)
    before = where(page)
    id = submit(page, "bed")
    page.locator(".tile.invoked").first.wait_for()
    card = page.locator(f"article[data-mission='{id}']")
    if card.count():  # a search may be over before one looks
        assert card.get_by_role("button", name="Cancel").is_visible()
    until(lambda: row(page, id).locator(".badge").inner_text() not in ("active", "queued", "confirming"), timeout_s=150)
    until(lambda: row(page, id).locator(".badge").inner_text() == "found, and right", "the simulator's word is missing")
    assert where(page) != before, "the robot didn't move"
    page.get_by_label("Filter objects by name").fill("bed")  # else it may not be among the twelve that are shown
    page.locator("button.object", has_text="bed").first.click()
    page.locator("dialog .history li").first.wait_for()
    assert "confirmed" in page.locator("dialog").inner_text()
    page.keyboard.press("Escape")
    until(lambda: page.locator("dialog").count() == 0)


def test_suggestions_are_what_is_there_and_what_perception_knows(open_page):
    page = open_page()
    options = page.locator("#targets option")
    until(lambda: options.count() > 70)
    page.locator(".chip").first.click()
    assert page.input_value("#target") == page.locator(".chip").first.inner_text()


def test_the_cameras_are_asked_without_a_robot(open_page):
    page = open_page()
    page.get_by_role("button", name="Only ask the cameras").click()
    assert page.locator("#target:invalid").count(), "nothing is asked for nothing"
    page.fill("#target", "chair")
    page.get_by_role("button", name="Only ask the cameras").click()
    answer = page.get_by_role("region", name="What the cameras see")
    answer.locator("li img").first.wait_for()
    until(lambda: answer.locator("li img").first.evaluate("i => i.naturalWidth") > 0, "its picture doesn't load")
    assert "confirmed" in answer.inner_text()
    answer.locator("li button").first.click()
    page.locator("dialog", has_text="chair").wait_for()
    page.keyboard.press("Escape")
    page.fill("#target", "xylophone")
    page.get_by_role("button", name="Only ask the cameras").click()
    until(lambda: "No camera sees a xylophone" in answer.inner_text() or page.locator(".toast.bad").count())
    answer.get_by_role("button", name="Close").click()
    assert not answer.count()


def test_a_mission_is_paused_goes_on_and_is_cancelled(open_page):
    page = open_page()
    id = submit(page, "airplane")  # nobody has one: it goes on and on
    card = page.locator(f"article[data-mission='{id}']")
    card.get_by_role("button", name="Pause").click()
    card.locator(".badge", has_text="paused").wait_for()
    page.fill("#target", "couch")
    page.get_by_role("button", name="Search", exact=True).click()
    page.locator(".toast.bad", has_text="robot").wait_for()  # the one robot has a mission
    assert page.input_value("#target") == "couch", "who is refused mustn't type it all again"
    card.get_by_role("button", name="Resume").click()
    card.locator(".badge", has_text="active").wait_for()
    card.get_by_text(re.compile("place.* weighed")).click()
    assert card.locator(".candidates li .note").first.inner_text()
    card.get_by_role("button", name="Cancel").click()
    row(page, id).locator(".badge", has_text="cancelled").wait_for()
    until(lambda: card.count() == 0)


def test_a_camera_is_taken_out_of_the_maps(open_page, home):
    page = open_page()
    removals = f"http://127.0.0.1:{home.gateway_port}/api/v1/removals"
    cameras = f"http://127.0.0.1:{home.gateway_port}/api/v1/cameras"
    camera = until(lambda: next((c["id"] for c in httpx.get(cameras).json()["items"] if c["views_processed"]), None))
    page.get_by_role("button", name=f"Take camera {camera} out of the maps").click()
    dialog = page.get_by_role("dialog", name="Take out of the maps")
    assert dialog.locator("select").input_value() == f"camera/{camera}"
    assert "robot/" in dialog.locator("select").inner_text()
    assert "can't be undone" in dialog.inner_text()
    dialog.get_by_role("button", name="Cancel").click()
    until(lambda: page.locator("dialog").count() == 0)
    assert httpx.get(removals).json()["total"] == 0, "nothing is taken out unasked"
    page.get_by_role("button", name=f"Take camera {camera} out of the maps").click()
    dialog.get_by_role("button", name="Take it out").click()
    page.locator(".toast.good", has_text=f"camera/{camera}: taken out of the maps").wait_for()
    tile = page.locator(f"#camera-{camera}")
    until(lambda: tile.get_attribute("data-state") == "paused", "a wrong camera would come in again")
    (removal,) = httpx.get(removals).json()["items"]
    assert (removal["source"], removal["state"], removal["since"]) == (f"camera/{camera}", "done", None)
    page.get_by_role("button", name=f"Resume camera {camera}").click()
    until(lambda: tile.get_attribute("data-state") == "live")


def test_everything_stops_and_is_released(open_page):
    page = open_page()
    page.get_by_role("button", name="Emergency stop").click()
    page.locator("[data-alert=halted]").wait_for()
    page.get_by_role("button", name="Release robots").click()
    until(lambda: page.locator("[data-alert=halted]").count() == 0, timeout_s=30)


def test_a_camera_that_dies_is_stale_then_offline_then_back(open_page, home):
    page = open_page()
    name = next(n for n in home.stack.processes if n.startswith("camera-"))
    tile = page.locator(f"[data-camera='{name.removeprefix('camera-')}']")
    until(lambda: tile.get_attribute("data-state") == "live", timeout_s=30)
    tile.locator("img").wait_for()
    home.kill(name)
    try:
        until(lambda: tile.get_attribute("data-state") == "stale", timeout_s=30)
        until(lambda: tile.get_attribute("data-state") == "offline", timeout_s=30)
        alert = page.locator(f"[data-alert='camera {name.removeprefix('camera-')}']")
        until(lambda: re.search(r"is offline\s+since \d\d:\d\d:\d\d, \d+ s ago", alert.inner_text()))  # drawn by itself
    finally:
        home.stack.start(name)
    until(lambda: tile.get_attribute("data-state") == "live", timeout_s=60)
    until(lambda: alert.count() == 0)


def test_a_gateway_that_is_gone_is_said_and_comes_back(open_page, home):
    page = open_page()
    home.kill("gateway")
    try:
        page.locator("[role=alert]", has_text="doesn't answer").wait_for()
        assert re.search(r"What you see is \d+ s old", page.locator("[role=alert]").inner_text())
        assert page.locator(".tile").count() > 0, "what was known stays"
    finally:
        home.stack.start("gateway")
    until(lambda: page.locator("[role=alert]").count() == 0, timeout_s=60)
    page.locator("#readiness.good").wait_for()


def test_the_map_is_moved_by_keys(open_page):
    page = open_page()
    until(lambda: pixels(page) > 10_000, timeout_s=60)
    canvas = page.locator("canvas")
    canvas.focus()
    before = canvas.screenshot()
    for key in ("+", "ArrowLeft", "ArrowUp"):
        page.keyboard.press(key)
    until(lambda: canvas.screenshot() != before)


def test_layers_are_switched(open_page):
    page = open_page()
    drawn = 0

    def is_whole():
        """Layers come one by one; what is drawn by the first alone says nothing about all."""
        nonlocal drawn
        before, drawn = drawn, pixels(page)
        page.wait_for_timeout(500)
        return drawn > 10_000 and drawn == before

    until(is_whole, timeout_s=60)
    for name in ("explored", "obstacles", "frontiers", "value", "camera views"):
        page.get_by_role("button", name=name, exact=True).click()
    until(lambda: pixels(page) < drawn / 2, lambda: (drawn, pixels(page)), 30)


BUILDING = """building: test
floors:
  "0":
    keepout:
      server room: [[1.0, 1.0], [2.5, 1.0], [2.5, 2.5], [1.0, 2.5]]
    passages:
      lobby: {kind: door, outline_m: [[3.0, 1.0], [3.4, 1.0], [3.4, 2.2], [3.0, 2.2]]}
"""


@pytest.fixture
def with_areas(home, tmp_path):
    """The planner reads a building file with a keepout zone and a door."""
    file = tmp_path / "building.yaml"
    file.write_text(BUILDING)

    def restart():
        home.kill("planner")
        home.stack.start("planner")
        until(lambda: httpx.get(f"http://127.0.0.1:{home.gateway_port}/readyz").status_code == 200, timeout_s=60)

    home.stack.environment["SURVEILNAV_PLANNER__BUILDING_FILE"] = str(file)
    restart()
    yield
    file.write_text("building: test")  # nothing else of it shall stay on the map
    until(lambda: httpx.get(f"http://127.0.0.1:{home.gateway_port}/api/v1/areas").json()["total"] == 0, timeout_s=60)
    del home.stack.environment["SURVEILNAV_PLANNER__BUILDING_FILE"]
    restart()


def test_keepout_zones_and_doors_are_on_the_map_and_in_words(with_areas, open_page, home):
    page = open_page()
    zone, lobby = page.locator("[data-area='0/keepout/server room']"), page.locator("[data-area='0/door/lobby']")
    zone.wait_for(state="attached")
    assert zone.inner_text() == "keepout: server room, at 1.8, 1.8 metres: no robot is sent there"
    legend = page.locator(".legend")
    assert "keepout zone" in legend.inner_text()
    door = home.node.publisher(PASSAGE_STATE, floor="0", passage="lobby")

    def says(state: str) -> bool:
        door.put(PassageState(stamp_ns=clock_ns(), state=state))
        return f"door lobby, {state}" in lobby.inner_text()

    until(lambda: says("open"), lobby.inner_text, timeout_s=30)
    until(lambda: pixels(page) > 10_000, timeout_s=60)
    page.wait_for_timeout(500)
    open_red = red_pixels(page)
    until(lambda: says("closed"), lobby.inner_text, timeout_s=30)
    until(lambda: says("closed") and red_pixels(page) > open_red + 100, "a closed door looks as an open one does")
    page.get_by_role("button", name="zones and doors", exact=True).click()
    until(lambda: red_pixels(page) < open_red / 2, "nothing of the zone was drawn")
    assert "keepout zone" not in legend.inner_text()


def red_pixels(page: Any) -> int:
    """How many pixels of the map are red, as the hatch of zones is."""
    red = """c => {
        const { data } = c.getContext("2d").getImageData(0, 0, c.width, c.height);
        let n = 0;
        for (let i = 0; i < data.length; i += 4) n += data[i] > 150 && data[i + 1] < 120 && data[i + 2] < 120;
        return n;
    }"""
    return int(page.locator("canvas").evaluate(red))


def test_the_cloud_is_loaded_when_it_is_opened_and_given_back(open_page):
    page = open_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.get_by_role("button", name="3D", exact=True).click()
    page.locator(".cut .soft").filter(has_text=re.compile("points|WebGL")).wait_for()
    if "WebGL" in page.locator(".cut .soft").inner_text():
        pytest.skip("this Chromium draws nothing in 3D")
    assert any("/page/cloud/" in url for url in asked), "loaded before anybody wanted it"
    until(lambda: pixels(page, "canvas.names") > 500)
    page.locator("canvas.names").focus()
    page.keyboard.press("ArrowLeft")
    page.get_by_role("button", name="3D", exact=True).click()
    page.locator(".switches").wait_for()


def test_a_page_left_open_for_a_day_takes_no_more_and_no_more_memory(open_page):
    """A day of poses and traffic in a second, put where the stream puts them."""
    page = open_page()
    kept = page.evaluate("""async () => {
        const base = document.querySelector("script[type=module]").src.replace("main.js", "");
        const [store, trails, rates] = await Promise.all(["store", "trails", "rates"].map(n => import(`${base}${n}.js`)));
        const robot = store.all("robot")[0];
        const at = i => ({ ...robot, id: "walker", position_m: [i * 0.1, Math.sin(i), 0] });
        for (let i = 0; i < 86400; i++) store.put("robot", "walker", at(i));
        for (let i = 0; i < 2000; i++) rates.sample(1000 * i);
        const kept = { trail: trails.trailOf("walker").length, rates: rates.ratesOf("total").length };
        store.put("robot", "walker", null);
        return { ...kept, after: trails.trailOf("walker").length };
    }""")
    assert 100 < kept["trail"] <= 1200
    assert 100 < kept["rates"] <= 300
    assert kept["after"] == 0, "who is gone leaves no trail"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("phone", [False, True])
def test_nothing_serious_for_who_sees_or_hears_otherwise(open_page, scheme, phone):
    """axe, the checker of WCAG: contrast, names, roles, order."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = open_page(PHONE if phone else None, scheme)
    page.locator("button.object").first.wait_for()
    until(lambda: page.locator("tr").count() > 3, timeout_s=30)
    faults = [v for v in axe.run(page).response["violations"] if v["impact"] in ("serious", "critical")]
    assert not faults, [(v["id"], [n["html"] for n in v["nodes"]][:3]) for v in faults]


def test_a_phone_shows_all_without_scrolling_sideways(open_page):
    page = open_page(PHONE)
    until(lambda: pixels(page) > 5_000, timeout_s=60)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    for section in ("Map", "Missions", "Cameras", "Objects", "Traffic"):
        page.get_by_role("link", name=section).click()
    assert page.get_by_role("button", name="Emergency stop").is_visible()
