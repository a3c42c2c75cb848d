"""What MkDocs does otherwise than GitHub: pages outside docs/, the order of pages, anchors; and nothing from elsewhere.

The pages are written for GitHub, and the site is made of them as they are. MkDocs loads this file as a hook (mkdocs.yml).
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
SOURCE = "https://github.com/surveilnav/surveilnav/blob/main"

#: Pages that lie elsewhere in the repository than in the site. docs/README.md gives way to the README, the site's first page.
MOVED = {
    "README.md": "index.md",
    "docs/README.md": "documentation.md",
    "ARCHITECTURE.md": "architecture.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
    "CREDITS.md": "credits.md",
    "training/detector/README.md": "understand/training.md",
    "training/depth/README.md": "understand/training_depth.md",
}
REPOSITORY_PATH = {site: repository for repository, site in MOVED.items()}

#: The tabs, in order: a page, or a folder of pages.
TABS = ["index.md", "use", "operate", "extend", "understand", "reference", "results"]
#: The pages of the first tab.
HOME = ["index.md", "documentation.md", "changelog.md", "contributing.md", "security.md", "credits.md"]
#: Folders without a README of their own.
TITLES = {"understand/adr": "Decisions"}

_LINK = re.compile(r"(?<=\]\()([^)\s]+)(?=\))")
_CODE = re.compile(r"^```.*?^```[^\n]*$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
#: A list that begins on the line after a paragraph, which Python-Markdown takes for more of the paragraph.
_TIGHT_LIST = re.compile(r"^(?![-*|#>] |\d+\. |\s|$)(.+)\n(?=[-*] |1\. )", re.MULTILINE)


# --- files --------------------------------------------------------------------------------------------------------


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Adds the pages that lie outside docs/, and puts all of them in order."""
    if shadowed := files.get_file_from_path("README.md"):
        files.remove(shadowed)
    for repository, site in MOVED.items():
        files.append(File.generated(config, site, content=(ROOT / repository).read_text(encoding="utf-8")))
    pages = [file.src_uri for file in files.documentation_pages()]
    home = [uri for uri in HOME if uri in pages]
    config.nav = [{"SurveilNav": home}, *(section(tab, pages) for tab in TABS if tab != "index.md")]
    return files


def section(folder: str, pages: list[str]) -> dict[str, Any]:
    """A folder's entry of the navigation: its README, the pages that it links to, in that order, then all others."""
    readme = f"{folder}/README.md"
    linked = [f"{folder}/{uri}" for uri in _links(readme)] if readme in pages else []
    if folder == "understand":
        linked.insert(0, "architecture.md")
    own = {uri for uri in pages if posixpath.dirname(uri) == folder} - {readme}
    own |= {"architecture.md"} if folder == "understand" else set()
    order = [uri for uri in dict.fromkeys(map(posixpath.normpath, linked)) if uri in own]
    below = sorted({"/".join(uri.split("/")[: folder.count("/") + 2]) for uri in pages if uri.startswith(f"{folder}/")})
    folders = [path for path in below if path not in pages]
    entries: list[Any] = [*([readme] if readme in pages else []), *order, *sorted(own - set(order))]
    return {_title(folder): entries + [section(path, pages) for path in folders]}


def _links(uri: str) -> Iterator[str]:
    for link in _LINK.findall((ROOT / "docs" / uri).read_text(encoding="utf-8")):
        yield link.partition("#")[0]


def _title(folder: str) -> str:
    """What the folder's README is headed."""
    readme = ROOT / "docs" / folder / "README.md"
    if folder in TITLES or not readme.exists():
        return TITLES.get(folder, posixpath.basename(folder).capitalize())
    return readme.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")


# --- pages --------------------------------------------------------------------------------------------------------


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Gives headings the anchors that they have on GitHub."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = slug
    return config


def slug(heading: str, separator: str) -> str:
    """The anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", separator)


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Has links lead to where the site has a page, or to the file in the repository."""
    here = REPOSITORY_PATH.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    text, at = "", 0
    for code in _CODE.finditer(markdown):
        text += _prose(markdown[at : code.start()], here, page.file.src_uri) + code[0]
        at = code.end()
    return text + _prose(markdown[at:], here, page.file.src_uri)


def _prose(text: str, here: str, site: str) -> str:
    text = _TIGHT_LIST.sub(r"\1\n\n", text)
    return _LINK.sub(lambda link: relinked(link[0], here, site), text)


def relinked(link: str, here: str, site: str) -> str:
    """A link of the page ``here`` of the repository as the page ``site`` must have it. What leads nowhere stays as it is,
    so that MkDocs complains of it."""
    name, hash_, anchor = link.partition("#")
    if not name or re.match(r"[a-z]+:", link):
        return link
    target = posixpath.normpath(posixpath.join(posixpath.dirname(here), name))
    if target in MOVED:
        found = MOVED[target]
    elif target.startswith("docs/") and not target.endswith((".csv", ".json")) and (ROOT / target).is_file():
        found = target.removeprefix("docs/")
    elif (ROOT / target).exists():
        return f"{SOURCE}/{target}{hash_}{anchor}"
    else:
        return link
    return posixpath.relpath(found, posixpath.dirname(site) or ".") + hash_ + anchor


# --- the finished site --------------------------------------------------------------------------------------------

_LOADED = re.compile(
    r"""<(?:script|img|iframe|source|audio|video)\b[^>]*?\ssrc=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|<link\b[^>]*?rel=["']?(?:stylesheet|preload|preconnect|icon)["'\s][^>]*?href=["']?((?:https?:)?//[^"'\s>]+)"""
    r"""|url\(["']?((?:https?:)?//[^"')]+)|@import ["']((?:https?:)?//[^"']+)""",
)


def on_post_build(*, config: MkDocsConfig) -> None:
    """Makes sure that readers' browsers load nothing from elsewhere: no fonts, scripts, styles or pictures."""
    for path in sorted(Path(config.site_dir).rglob("*")):
        if path.suffix in (".html", ".css") and (found := loaded_from_elsewhere(path.read_text(encoding="utf-8"))):
            raise PluginError(f"{path.relative_to(config.site_dir)} loads from elsewhere: {', '.join(found)}")


def loaded_from_elsewhere(text: str) -> list[str]:
    """Addresses of other machines that a browser loads for this page or style sheet. Links may lead anywhere."""
    return sorted({next(filter(None, groups)) for groups in _LOADED.findall(text)})
