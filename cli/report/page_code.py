"""The gateway's page as one script and one style sheet, for a file that must stand alone.

The page is made of ES modules that import each other by relative path. ``script`` takes an entry module and all that it imports,
wraps each in a function, and puts them in the order in which they need each other. A browser could import modules from ``data:``
addresses, too, but then the report's security policy would have to allow every script at such an address.
"""

from __future__ import annotations

import posixpath
import re
from importlib.resources import files

_STATIC = files("surveilnav.services.gateway") / "static"
_STYLES = ("tokens", "layout", "parts", "panels")
_NAMES = r"(\{[^}]*\}|\* as \w+)"
_IMPORT = re.compile(rf'^import {_NAMES} from "([^"]+)";', re.MULTILINE)
_EXPORT_FROM = re.compile(r'^export \{([^}]*)\} from "([^"]+)";', re.MULTILINE)
_EXPORT_LIST = re.compile(r"\bexport ?\{([^}]*)\};?\s*\Z")
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def styles() -> str:
    """The page's style sheets, one after the other."""
    return "\n".join((_STATIC / "style" / f"{name}.css").read_text(encoding="utf-8") for name in _STYLES)


def script(entry: str) -> str:
    """The script of ``entry``, the text of a module that imports from the page as if it lay in the page's folder.

    Raises:
        ValueError: a module imports or exports in a way that isn't understood, or modules import each other in a circle.
    """
    done: dict[str, str] = {}
    _add("page/report-entry.js", entry, done, ())
    return '"use strict";\nconst modules = {};\n' + "\n".join(done.values())


def _add(name: str, text: str, done: dict[str, str], importing: tuple[str, ...]) -> None:
    """Adds a module to ``done`` after all that it imports."""
    if name in importing:
        raise ValueError(f"modules import each other in a circle: {' -> '.join((*importing, name))}")
    exported: list[str] = []

    def needed(path: str) -> str:
        """How a module is named in the script, once it stands there."""
        other = posixpath.normpath(posixpath.join(posixpath.dirname(name), path))
        if other not in done:
            _add(other, _STATIC.joinpath(*other.split("/")).read_text(encoding="utf-8"), done, (*importing, name))
        return f'modules["{other}"]'

    def imports(match: re.Match[str]) -> str:
        what = match[1].replace(" as ", ": ") if match[1].startswith("{") else match[1].removeprefix("* as ")
        return f"const {what} = {needed(match[2])};"

    def exports_from(match: re.Match[str]) -> str:
        exported.extend(names := [n.strip() for n in match[1].split(",") if n.strip()])
        return f"const {{ {', '.join(names)} }} = {needed(match[2])};"

    def export_list(match: re.Match[str]) -> str:
        pairs = (n.split(" as ") for n in match[1].split(","))
        exported.extend(f"{outside.strip()}: {inside.strip()}" for inside, outside in pairs)
        return ""

    def export(match: re.Match[str]) -> str:
        exported.append(match[1])
        return ""

    body = _EXPORT_FROM.sub(exports_from, _IMPORT.sub(imports, text))
    body = _EXPORT.sub(export, _EXPORT_LIST.sub(export_list, body))
    if left := re.search(r"^(import|export)\b.*", body, re.MULTILINE):
        raise ValueError(f"{name}: this isn't understood: {left[0][:80]}")
    done[name] = f'modules["{name}"] = (() => {{\n{body}\nreturn {{ {", ".join(exported)} }};\n}})();'
