"""A recording on the page: played, held, taken back, and the same afterwards."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from surveilnav.bus.router import free_port
from surveilnav.messages import FINISHED_STATES
from tests.e2e.conftest import starting
from tests.waiting import until


@pytest.fixture(scope="module")
def replay_url(browser: Any, tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[str]:
    """A short search was recorded; its replay has come to its end."""
    with starting(tmp_path_factory.mktemp("recorded"), home_cache) as start:
        s = start(cameras=1, perception="simulated", gateway_port=free_port(), recorder=True)
        s.search("bed", mission="short", max_steps=12)
        s.wait(lambda m: m.state in FINISHED_STATES, 200, "short")
        folder = Path(s.stack.environment["SURVEILNAV_RECORDER__FOLDER"])
        url = f"http://127.0.0.1:{s.gateway_port}/api/v1/recordings"
        until(lambda: [r["state"] for r in httpx.get(url).json()["items"]] == ["complete"], "no recording", 60.0)
    (file,) = folder.glob("*.mcap")
    port = free_port()
    command = [sys.executable, "-m", "surveilnav.cli.main", "replay", str(file), "--speed", "50", "--port", str(port)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, env=os.environ | {"PYTHONPATH": os.getcwd()})
    url = f"http://127.0.0.1:{port}"

    def at_its_end() -> bool:
        assert process.poll() is None, process.stderr and process.stderr.read()
        try:
            replay = httpx.get(f"{url}/api/v1/replay").json()
        except httpx.HTTPError:
            return False
        return replay.get("at_s") == replay.get("duration_s", 0)

    try:
        until(at_its_end, "the replay never ended", 120.0)
        yield url
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def replay_of(url: str) -> dict[str, Any]:
    """Where the replay is."""
    return httpx.get(f"{url}/api/v1/replay").json()  # type: ignore[no-any-return]


def test_the_slider_takes_a_search_back_and_forth(browser: Any, replay_url: str) -> None:
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    page.set_default_timeout(60_000)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(replay_url)
    slider = page.get_by_label("Moment of the recording")
    slider.wait_for()
    page.get_by_role("region", name="Replay").get_by_role("button", name="Play").wait_for()  # it stands at its end
    whole_s = float(slider.get_attribute("max"))
    assert float(slider.input_value()) == pytest.approx(whole_s, abs=0.2)
    page.locator("#missions-past tbody tr").wait_for()
    under_way = page.get_by_label("steps used")
    under_way.wait_for(state="detached")

    slider.focus()
    slider.press("Home")
    for _ in range(2):
        slider.press("PageUp")  # a tenth
    until(lambda: replay_of(replay_url)["at_s"] == pytest.approx(0.2 * whole_s, abs=0.2), "it wasn't taken back")
    under_way.wait_for()
    assert not replay_of(replay_url)["playing"]  # it stood at its end, so it stands still where it was taken to
    page.get_by_label("Speed").select_option("16")
    page.get_by_role("button", name="Play").click()
    under_way.wait_for(state="detached")
    until(lambda: float(slider.input_value()) == pytest.approx(whole_s, abs=0.2), "it didn't play to its end", 60.0)

    box = slider.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] - 8, y)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, y)  # dragged away ...
    page.mouse.move(box["x"] + box["width"] - 8, y)  # ... and put back: the browser calls that no change
    page.mouse.up()
    httpx.patch(f"{replay_url}/api/v1/replay", json={"at_s": 0.5 * whole_s, "playing": False})
    until(lambda: float(slider.input_value()) == pytest.approx(0.5 * whole_s, abs=0.2), "the slider stays held", 10.0)

    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert not faults
