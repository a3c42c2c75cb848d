"""The page's modules as one script: in the order of their needs, and a refusal of what isn't understood."""

from __future__ import annotations

import re

import pytest

from surveilnav.cli.report import page_code


def test_modules_come_after_what_they_need_and_once():
    script = page_code.script('import { all, put } from "./store.js";\nimport { MapPanel } from "./map/panel.js";\n')
    order = re.findall(r'^modules\["([^"]+)"\] =', script, re.MULTILINE)
    assert len(set(order)) == len(order)
    assert order[-1] == "page/report-entry.js"
    for name, body in zip(order, script.split("\nmodules[")[1:], strict=True):
        needed = re.findall(r'= modules\["([^"]+)"\];', body)
        assert all(order.index(other) < order.index(name) for other in needed), name
    assert 'const { all, put } = modules["page/store.js"];' in script
    assert not re.search(r"^(import|export)\b", script, re.MULTILINE)


def test_names_that_are_given_another_and_lists_are_kept():
    script = page_code.script('import { metres as m } from "./format.js";\nexport const x = m;\nexport { x as y };\n')
    assert 'const { metres: m } = modules["page/format.js"];' in script
    assert script.rstrip().endswith("return { y: x, x };\n})();")


def test_what_is_not_understood_is_refused():
    with pytest.raises(ValueError, match=r"page/report-entry.js: this isn't understood: export default"):
        page_code.script("export default 3;\n")
    with pytest.raises(FileNotFoundError):
        page_code.script('import { x } from "./nothing.js";\n')


def test_styles_have_the_colours_of_the_map():
    assert "--map-explored" in page_code.styles()
