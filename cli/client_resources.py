"""``python -m surveilnav.cli.client_resources``: the resources of the REST interface as types of the client."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

from surveilnav.services.gateway.app import create_app
from surveilnav.services.gateway.core.resources.event import Event

_HEAD = '''"""What the gateway answers, as types: dictionaries, as JSON has them.

Generated from the OpenAPI document by `make docs`; don't edit.
"""

from __future__ import annotations

from typing import NotRequired, TypedDict
'''
_PLAIN = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}


def source() -> str:
    """``surveilnav/client/resources.py``."""
    api = create_app(MagicMock(), None).openapi()
    schemas: dict[str, Any] = api["components"]["schemas"]
    kept = {name: s for name, s in schemas.items() if "_" not in name} | {"Event": Event.model_json_schema()}
    return "\n\n".join([_HEAD, *(_class(name, schema) for name, schema in sorted(kept.items()))])


def _class(name: str, schema: dict[str, Any]) -> str:
    """One type; what may be missing is ``NotRequired``."""
    required = schema.get("required", [])
    lines = [f"class {name}(TypedDict):"]
    for field, kind in schema["properties"].items():
        written = _type(kind)
        lines.append(f"    {field}: {written if field in required else f'NotRequired[{written}]'}")
    return "\n".join(lines) + "\n"


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(_type(s) for s in schema["anyOf"]))
    kind = schema.get("type")
    if kind == "array":
        items = schema.get("prefixItems") or [schema.get("items", {})]
        return f"list[{' | '.join(dict.fromkeys(_type(s) for s in items))}]"
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"dict[str, {_type(values)}]" if isinstance(values, dict) else "dict[str, Any]"
    return _PLAIN.get(str(kind), "Any")


if __name__ == "__main__":
    print(source(), end="")
