"""How the site's pages are made of GitHub's: links, order, anchors, and nothing that is loaded from elsewhere.

`make docs-site` builds the site itself, and fails where a link leads nowhere.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

pytest.importorskip("mkdocs", reason="MkDocs isn't installed: pip install -e '.[docs]'")
_spec = importlib.util.spec_from_file_location("docs_site", ROOT / "tools" / "docs_site.py")
assert _spec
assert _spec.loader
docs_site = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(docs_site)


@pytest.mark.parametrize(
    ("link", "here", "site", "leads_to"),
    [
        ("docs/use/page.md#maps", "README.md", "index.md", "use/page.md#maps"),
        ("docs/README.md", "README.md", "index.md", "documentation.md"),
        ("../../README.md", "docs/use/page.md", "use/page.md", "../index.md"),
        ("../README.md", "docs/use/page.md", "use/page.md", "../documentation.md"),
        ("README.md", "docs/use/page.md", "use/page.md", "README.md"),
        ("../../ARCHITECTURE.md", "docs/understand/paper.md", "understand/paper.md", "../architecture.md"),
        ("../images/page.png", "docs/use/page.md", "use/page.md", "../images/page.png"),
        ("../../pyproject.toml", "docs/use/page.md", "use/page.md", f"{docs_site.SOURCE}/pyproject.toml"),
        ("LICENSE", "README.md", "index.md", f"{docs_site.SOURCE}/LICENSE"),
        ("https://zenoh.io", "README.md", "index.md", "https://zenoh.io"),
        ("#try-it", "README.md", "index.md", "#try-it"),
        ("nowhere.md", "docs/use/page.md", "use/page.md", "nowhere.md"),
    ],
)
def test_a_link_leads_to_the_sites_page_or_into_the_repository(link, here, site, leads_to):
    assert docs_site.relinked(link, here, site) == leads_to


def test_code_keeps_its_links_and_a_list_gets_its_blank_line():
    text = (
        "**Bold**\n- [a](docs/use/page.md)\n- b\n\n`[c](docs/d.md)`\n```\ntext\n- [e](docs/f.md)\n```\n| x |\n|---|\n"
    )
    page = type("Page", (), {"file": type("File", (), {"src_uri": "index.md"})})
    made = docs_site.on_page_markdown(text, page=page, config=None, files=None)
    assert made == text.replace("**Bold**\n", "**Bold**\n\n").replace("(docs/use/page.md)", "(use/page.md)")


def test_headings_have_githubs_anchors():
    assert docs_site.slug("A heading: `code` – and, more_of it", "-") == "a-heading-code--and-more_of-it"


def test_pages_stand_in_the_order_of_their_readme():
    pages = [f"use/{name}.md" for name in ("README", "rest", "zebra", "building", "settings", "deep/one")]
    (entries,) = docs_site.section("use", pages).values()
    linked = re.findall(r"\]\(([\w-]+\.md)\)", (ROOT / "docs/use/README.md").read_text())
    known = [f"use/{uri}" for uri in linked if f"use/{uri}" in pages]
    assert entries == ["use/README.md", *known, "use/zebra.md", {"Deep": ["use/deep/one.md"]}]


def test_what_browsers_load_from_elsewhere_is_found():
    page = """<script src="https://a.org/x.js"></script><link rel="stylesheet" href="//b.org/y.css"><img src=https://c.org/z.png>
    <a href="https://fine.org">fine</a><link rel="canonical" href="https://fine.org"><img src="images/fine.png">"""
    style = "@import 'https://d.org/q.css'; p {background: url(https://e.org/r.png)} i {background: url(data:image/svg+xml;x)}"
    assert docs_site.loaded_from_elsewhere(page) == ["//b.org/y.css", "https://a.org/x.js", "https://c.org/z.png"]
    assert docs_site.loaded_from_elsewhere(style) == ["https://d.org/q.css", "https://e.org/r.png"]
