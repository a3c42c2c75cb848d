"""The report in a real browser: the film strip, keyboard, phone, paper, dark and light, and what foreign words may do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from surveilnav.cli.report.page import write_report
from tests.made_up_run import made_up_run

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright isn't installed: pip install -e '.[dev]'")
expect = sync_api.expect

PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
EVIL = """</script><img src=x onerror="document.title='evil'"><b id=evil>"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(made_up_run(), path)
    return path


@pytest.fixture
def open_page(browser: Any) -> Iterator[Any]:
    """``open_page(path, **more)``: a page whose console must stay silent, and that may load nothing."""
    opened: list[tuple[Any, list[str]]] = []

    def go(path: Path, **more: Any) -> Any:
        context = browser.new_context(**({"viewport": DESK} | more))
        page, said = context.new_page(), list[str]()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on(
            "request", lambda r: None if r.url.startswith(("file:", "data:")) else said.append(f"asked for {r.url}")
        )
        page.goto(path.as_uri())
        opened.append((context, said))
        if more.get("java_script_enabled", True):
            page.locator("#film-at").wait_for()  # the key moments are drawn first
        return page

    yield go
    for context, said in opened:
        context.close()
        # that a test reads the canvas often isn't the page's fault
        assert [text for text in said if "willReadFrequently" not in text] == []


SCRUB = "k => { const s = document.querySelector('#film-at'); s.value = k; s.dispatchEvent(new Event('input')) }"
#: How many pixels of the map have the colour of obstacles (#3b4654).
OBSTACLES = """() => { const c = document.querySelector('#map canvas');
    const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
    let n = 0; for (let i = 0; i < d.length; i += 4) n += d[i] === 0x3b && d[i + 1] === 0x46 && d[i + 2] === 0x54; return n }"""


def obstacles(page: Any) -> int:
    """The pixels of obstacles, once they stay as they are: layers come within a second."""
    seen: list[int] = []
    while len(seen) < 4 or len(set(seen[-4:])) > 1:
        page.wait_for_timeout(400)
        seen.append(int(page.evaluate(OBSTACLES)))
    return seen[-1]


def test_keys_move_through_the_search(open_page, report):
    page = open_page(report)
    scrubber, when = page.locator("#film-at"), page.locator("#film-when")
    expect(when).to_have_text("42 of 42, 0:34, 10.6 m")
    assert scrubber.get_attribute("aria-valuetext") == "step 42 of 42, 0:34, 10.6 m"
    assert page.locator("#objects").get_by_text("potted plant").count() == 1
    assert "confirmed potted plant #4" in page.locator("#film-why").inner_text().lower()
    page.locator("#film-play").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "film-at"
    page.keyboard.press("Home")
    expect(when).to_contain_text("0 of 42, 0:00")
    expect(page.locator("#film-weighed")).to_contain_text("frontier")
    expect(page.locator("#objects")).to_contain_text("Nothing is confirmed yet.")
    for _ in range(12):
        page.keyboard.press("ArrowRight")
    expect(when).to_contain_text("12 of 42")
    page.locator("#objects").get_by_role("button", name="candidate").click()
    expect(page.locator("#objects .object").first).to_contain_text("potted plant#4camera")
    view = page.locator("#film-view")
    assert view.evaluate("e => e.complete && e.naturalWidth") > 100
    assert view.get_attribute("alt") == "What the robot saw at step 12"


def test_an_object_tells_its_history(open_page, report):
    page = open_page(report)
    page.locator("#objects .object").first.click()
    history = page.get_by_role("dialog").locator(".history")
    expect(history.locator("li")).to_have_count(3)
    expect(history).to_contain_text("new: nothing near overlaps")


def test_the_map_is_the_same_from_either_side(open_page, report):
    """It grows with the steps. Going back shows what was there on the way forth, and of the end nothing stays."""
    page = open_page(report)
    forth = {}
    for k in (0, 17, 30):
        page.evaluate(SCRUB, k)
        forth[k] = obstacles(page)
    assert len(set(forth.values())) == 3
    page.evaluate(SCRUB, 42)
    expect(page.locator(".legend")).to_contain_text("value 0.20")
    for k in (30, 17, 0):
        page.evaluate(SCRUB, k)
        assert obstacles(page) == forth[k]
    expect(page.locator(".legend")).not_to_contain_text("value 0.20")


def test_it_plays_and_chapters_jump(open_page, report):
    page = open_page(report)
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").click()
    chapter = page.get_by_role("button", name="goes to the confirmed target")
    chapter.click()
    expect(chapter).to_have_attribute("aria-current", "true")
    expect(page.locator("#film-when")).to_contain_text("21 of 42")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone_and_axe_finds_nothing_serious(open_page, report, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python isn't installed")
    page = open_page(report, viewport=PHONE, color_scheme=scheme, bypass_csp=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    found = axe.Axe().run(page).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"][:200]) for v in found if v["impact"] in ("serious", "critical")] == []


def test_on_paper_and_without_scripts_there_are_key_moments(open_page, report):
    page = open_page(report, color_scheme="dark")
    moments = page.locator("#moments")
    assert not moments.is_visible()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")  # as browsers say before they print
    page.emulate_media(media="print", color_scheme="dark")
    assert moments.is_visible()
    assert not page.locator("#film").is_visible()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    drawn = page.locator("#moments canvas").evaluate_all(
        "all => all.map(c => new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size > 40)"
    )
    assert drawn == [True] * len(drawn) != []
    still = open_page(report, java_script_enabled=False)
    assert still.locator("#moments img").count() >= 4
    assert still.locator("#moments").is_visible()
    assert not still.locator("#film").is_visible()


def test_foreign_words_stay_words(open_page, tmp_path):
    run = made_up_run()
    plan = msgspec.structs.replace(run.plans[-1], why=EVIL)
    objects = [msgspec.structs.replace(o, label=EVIL, reason=EVIL) for o in run.objects]
    write_report(replace(run, target=EVIL, room=EVIL, plans=[plan], objects=objects), tmp_path / "r.html")
    page = open_page(tmp_path / "r.html")
    assert EVIL in page.locator("#film-why").inner_text()
    assert EVIL in page.locator("#objects").inner_text()
    assert page.title() != "evil"
    assert page.locator("#evil").count() == 0


def test_a_script_that_slipped_in_would_not_run(browser, report, tmp_path):
    html = report.read_text(encoding="utf-8").replace("</main>", "<script>document.title='evil'</script></main>")
    (tmp_path / "r.html").write_text(html, encoding="utf-8")
    page = browser.new_page()
    page.goto((tmp_path / "r.html").as_uri())
    page.locator("#film-at").wait_for()
    assert page.title() != "evil"
    page.close()
