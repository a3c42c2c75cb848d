"""The report in a real browser: the film strip, keyboard, phone, paper, dark and light, and what foreign words may do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from surveilnav.cli.report import write_report
from tests.made_up_run import made_up_run

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
        return page

    yield go
    for context, said in opened:
        context.close()
        assert said == []


def cells_drawn(page: Any) -> int:
    """How many cells of the map aren't transparent."""
    count = """() => { const c = document.querySelector('#film-map canvas');
        return c.getContext('2d').getImageData(0, 0, c.width, c.height).data.filter((v, i) => i % 4 == 3 && v).length }"""
    return int(page.evaluate(count))


def test_keys_move_through_the_search(open_page, report):
    page = open_page(report)
    scrubber, when = page.locator("#film-at"), page.locator("#film-when")
    assert when.inner_text() == "42 of 42, 0:33, 10.6 m"
    assert scrubber.get_attribute("aria-valuetext").startswith("step 42 of 42, 0:33")
    whole = cells_drawn(page)
    page.locator("#film-play").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "film-at"
    page.keyboard.press("Home")
    assert when.inner_text().startswith("0 of 42, 0:00")
    assert "an edge of what is known at (1.5, 5)" in page.locator("#film-weighed").inner_text()
    assert page.locator("#film-believed").inner_text() == "Nothing so far."
    assert 0 < cells_drawn(page) < whole / 4
    for _ in range(12):
        page.keyboard.press("ArrowRight")
    assert when.inner_text().startswith("12 of 42")
    assert (
        "#4: candidate as potted plant, at best 0.72, seen by camera c2" in page.locator("#film-believed").inner_text()
    )
    view = page.locator("#film-view")
    assert view.evaluate("e => e.complete && e.naturalWidth") > 100
    assert view.get_attribute("alt") == "What the robot saw at step 12"
    page.keyboard.press("End")
    assert cells_drawn(page) == whole
    assert "confirmed potted plant #4" in page.locator("#film-why").inner_text()


def test_the_map_is_the_same_from_either_side(open_page, report):
    """Going back makes the map anew: it is what it was on the way forth."""
    page = open_page(report)
    step = "k => { const s = document.querySelector('#film-at'); s.value = k; s.dispatchEvent(new Event('input')) }"
    forth = {}
    for k in (0, 5, 17, 30):
        page.evaluate(step, k)
        forth[k] = cells_drawn(page)
    assert len(set(forth.values())) == 4
    for k in (30, 17, 5, 0):
        page.evaluate(step, k)
        assert cells_drawn(page) == forth[k]


def test_it_plays_and_chapters_jump(open_page, report):
    page = open_page(report)
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").click()
    chapter = page.get_by_role("button", name="goes to the confirmed target")
    chapter.click()
    assert chapter.get_attribute("aria-current") == "true"
    assert page.locator("#film-when").inner_text().startswith("21 of 42")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone_and_axe_finds_nothing_serious(open_page, report, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python isn't installed")
    page = open_page(report, viewport=PHONE, color_scheme=scheme, bypass_csp=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    found = axe.Axe().run(page).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"][:200]) for v in found if v["impact"] in ("serious", "critical")] == []


def test_on_paper_and_without_scripts_there_are_key_moments(open_page, report):
    page = open_page(report)
    moments = page.locator("#moments")
    assert not moments.is_visible()
    page.emulate_media(media="print", color_scheme="dark")
    assert moments.is_visible()
    assert not page.locator("#film").is_visible()
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
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
    assert page.title() != "evil"
    assert page.locator("#evil").count() == 0


def test_a_script_that_slipped_in_would_not_run(browser, report, tmp_path):
    html = report.read_text(encoding="utf-8").replace("</main>", "<script>document.title='evil'</script></main>")
    (tmp_path / "r.html").write_text(html, encoding="utf-8")
    page = browser.new_page()
    page.goto((tmp_path / "r.html").as_uri())
    assert page.title() != "evil"
    assert page.locator("#film").is_visible()
    page.close()
