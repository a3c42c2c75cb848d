"""A browser, and a running system of a small home with two cameras, whose page it shows."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from surveilnav.bus.router import free_port
from tests.e2e.conftest import System, starting

_CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or ""
_DESKTOP = {"width": 1440, "height": 900}
PHONE = {"width": 390, "height": 844}
#: A busy machine is slow, not wrong.
PATIENCE_MS = 60_000


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.page)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Debian's Chromium without a window."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright isn't installed: pip install -e '.[dev]'"
    )
    if not _CHROMIUM:
        pytest.skip("no Chromium here: apt-get install chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def home(browser: Any, tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[System]:
    """The system; the tests of a file share it. Nothing starts where there is no browser."""
    with starting(tmp_path_factory.mktemp("home"), home_cache) as start:
        yield start(cameras=2, perception="simulated", gateway_port=free_port())


@pytest.fixture
def open_page(browser: Any, home: System) -> Iterator[Callable[..., Any]]:
    """``open_page(size, scheme)``: the page when it has the state; at the end no script may have failed."""
    with ExitStack() as stack:
        said: list[str] = []

        def open_one(size: dict[str, int] | None = None, scheme: str = "light") -> Any:
            context = browser.new_context(viewport=size or _DESKTOP, color_scheme=scheme, reduced_motion="reduce")
            stack.callback(context.close)
            page = context.new_page()
            page.set_default_timeout(PATIENCE_MS)
            page.on("pageerror", lambda error: said.append(str(error)))
            page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
            page.goto(f"http://127.0.0.1:{home.gateway_port}/")
            page.locator("#readiness.good").wait_for()
            return page

        yield open_one
        # What the network loses (a test that kills says so) is no fault of the page: the browser logs it by itself.
        faults = [text for text in said if not text.startswith("Failed to load resource")]
        assert not faults, faults
