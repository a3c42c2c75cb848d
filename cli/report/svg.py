"""SVG as text: elements, pictures inside, no scripts, nothing from elsewhere."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape


def tag(name: str, *children: str, **attributes: object) -> str:
    """An element; ``children`` are SVG already. ``stroke_width`` writes stroke-width, ``class_`` writes class."""
    written = "".join(f' {k.rstrip("_").replace("_", "-")}="{_value(v)}"' for k, v in attributes.items())
    return f"<{name}{written}>{''.join(children)}</{name}>" if children else f"<{name}{written}/>"


def _value(value: object) -> str:
    return f"{value:.1f}" if isinstance(value, float) else escape(str(value))


def drawing(size: tuple[float, float], parts: Iterable[str], title: str, kind: str = "map") -> str:
    """The whole picture, ``size`` (width, height) [px] at most; ``kind`` is its class."""
    width, height = size
    return tag(
        "svg",
        f"<title>{escape(title)}</title>",
        *parts,
        viewBox=f"0 0 {width:.0f} {height:.0f}",
        class_=kind,
        style=f"max-width:{width:.0f}px",
        role="img",
    )


def data_uri(kind: str, data: bytes) -> str:
    """A "png" or "jpeg" as an address that holds it."""
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
