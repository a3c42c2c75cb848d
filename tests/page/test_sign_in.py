"""The page of a gateway that needs a key: it asks for it, keeps a session and no key, and asks again when that has ended."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from surveilnav.bus.router import free_port
from surveilnav.security.api_keys import ApiKeysFile
from surveilnav.security.roles import Role
from tests.e2e.conftest import System, starting
from tests.page.conftest import PATIENCE_MS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> ApiKeysFile:
    return ApiKeysFile(tmp_path_factory.mktemp("keys") / "keys.json")


@pytest.fixture(scope="module")
def guarded(
    browser: Any, keys: ApiKeysFile, tmp_path_factory: pytest.TempPathFactory, home_cache: Path
) -> Iterator[System]:
    with (
        pytest.MonkeyPatch.context() as environ,
        starting(tmp_path_factory.mktemp("guarded"), home_cache) as start,
    ):
        environ.setenv("SURVEILNAV_GATEWAY__KEYS_FILE", str(keys.path))
        keys.add("first", Role.viewer)
        yield start(cameras=1, gateway_port=free_port())


@pytest.fixture
def page(browser: Any, guarded: System) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 1200, "height": 800}, reduced_motion="reduce")
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"http://127.0.0.1:{guarded.gateway_port}/")
    yield page
    context.close()
    assert not faults


def sign_in(page: Any, key: str) -> None:
    page.get_by_label("Key", exact=True).fill(key)
    page.get_by_role("button", name="Sign in").click()


def test_a_key_opens_the_page_for_its_session(page, keys):
    key = keys.add("anna", Role.operator)
    assert page.locator("canvas").count() == 0
    sign_in(page, "snav_00000000_" + "a" * 43)
    page.get_by_text("this key isn't known here").wait_for()
    sign_in(page, key)
    page.locator("#readiness.good").wait_for()
    page.locator(".tile img").first.wait_for()  # a stream with pictures
    page.reload()
    page.locator("#readiness.good").wait_for()
    kept = page.evaluate("() => JSON.stringify([document.cookie, {...localStorage}, {...sessionStorage}])")
    assert key not in kept
    assert "surveilnav_session" not in kept
    page.fill("#target", "tv")
    page.get_by_role("button", name="Search", exact=True).click()
    page.locator("tr[data-mission]").first.wait_for()
    page.get_by_role("button", name="Sign out").click()
    page.get_by_label("Key", exact=True).wait_for()
    assert page.locator("canvas").count() == 0


def test_who_may_not_is_told_so(page, keys):
    sign_in(page, keys.add("bert", Role.viewer))
    page.locator("#readiness.good").wait_for()
    page.get_by_role("button", name="Emergency stop").click()
    page.get_by_text("needs the role operator").wait_for()


def test_a_revoked_key_closes_the_page(page, keys):
    sign_in(page, keys.add("carl", Role.viewer))
    page.locator("#readiness.good").wait_for()
    keys.revoke("carl")
    page.get_by_label("Key", exact=True).wait_for()  # by itself: the gateway ends its streams
    assert page.locator("canvas").count() == 0


def test_the_form_is_accessible(page):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page.get_by_label("Key", exact=True).wait_for()
    assert axe.run(page).violations_count == 0
