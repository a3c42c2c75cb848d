"""YAML files that people write: read as nodes that know their lines, so that a mistake can be named where it stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from surveilnav.errors import ConfigError

_MAX_BYTES = 4 << 20
#: Lists and tables in each other, and entries altogether; an alias counts as what it stands for.
_MAX_DEPTH, _MAX_ENTRIES = 50, 500_000
#: PyYAML looks at each open bracket for each word, so that 500 open brackets take seconds: it stops at so many.
_MAX_BRACKETS = 2 * _MAX_DEPTH

_Model = TypeVar("_Model", bound=BaseModel)


class ShallowLoader(yaml.SafeLoader):  # type: ignore[misc]
    """PyYAML's safe loader, which refuses brackets in more brackets than anybody writes."""

    def fetch_flow_collection_start(self, TokenClass: type) -> None:
        if self.flow_level >= _MAX_BRACKETS:
            raise yaml.scanner.ScannerError(None, None, f"more than {_MAX_BRACKETS} open brackets", self.get_mark())
        super().fetch_flow_collection_start(TokenClass)


def entry_fault(error: ErrorDetails) -> str:
    """What is wrong with an entry, after the entry's name."""
    return f"{'.'.join(map(str, error['loc']))}: {error['msg']}"


def read_table(
    path: Path,
    what: str,
    model: type[_Model],
    expected: str,
    text: str | None = None,
    *,
    as_text: bool = False,
    fault: Callable[[ErrorDetails], str] = entry_fault,
    max_faults: int | None = 1,
) -> tuple[_Model, yaml.Node]:
    """A file that holds one table: its entries, and its root node, of which ``line_of`` tells where an entry stands.

    Args:
        what: what the file is, for messages, such as "building file".
        expected: what the file should hold, for the message about a file without a table.
        text: what the file is going to hold; None: what it holds now.
        as_text: numbers, dates and the like stay the text that was written (``plain``).
        fault: what is wrong with an entry, for messages.
        max_faults: how many mistakes the message names at most, each on a line of its own; None: all of them.

    Raises:
        ConfigError: it can't be read or used; the message names the line.
    """
    root = compose(path, what, text)
    if not isinstance(root, yaml.MappingNode):
        raise ConfigError(f"{path}: expected {expected}")
    try:
        return model.model_validate(plain(root, as_text=as_text)), root
    except ValidationError as error:
        faults = [f"{path}, line {line_of(root, e['loc'])}: {fault(e)}" for e in error.errors()[:max_faults]]
        raise ConfigError("\n".join(faults)) from None
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def compose(path: Path, what: str, text: str | None = None) -> yaml.Node | None:
    """The root node of a file; None if the file is empty.

    Args:
        what: what the file is, for messages, such as "file of cameras".
        text: what the file is going to hold; None: what it holds now.

    Raises:
        ConfigError: the file can't be read, is larger than 4 MiB, isn't YAML, or has keys that are no words.
    """
    try:
        if text is None:
            if path.stat().st_size > _MAX_BYTES:
                raise ConfigError(f"{path}: a {what} has at most {_MAX_BYTES >> 20} MiB")
            text = path.read_text(encoding="utf-8")
        root: yaml.Node | None = yaml.compose(text, ShallowLoader)
    except (OSError, ValueError) as error:  # not UTF-8, or no path that a system has
        raise ConfigError(f"the {what} can't be read: {error}") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{where}: isn't YAML: {getattr(error, 'problem', None) or error}") from error
    if root is not None:
        _check(path, what, root)
    return root


def _check(path: Path, what: str, root: yaml.Node) -> None:
    """Raises ConfigError if a key is no scalar, or if nodes are nested too deeply, as in themselves, or too many by aliases."""
    waiting, n_entries = [(root, 0)], 0
    while waiting:
        node, depth = waiting.pop()
        n_entries += 1
        if depth > _MAX_DEPTH or n_entries > _MAX_ENTRIES:
            raise ConfigError(f"{path}, line {node.start_mark.line + 1}: a {what} is simpler than this")
        if isinstance(node, yaml.MappingNode):
            for key, child in node.value:
                if not isinstance(key, yaml.ScalarNode):
                    raise ConfigError(f"{path}, line {key.start_mark.line + 1}: expected a word before the colon")
                waiting.append((child, depth + 1))
        elif isinstance(node, yaml.SequenceNode):
            waiting += [(child, depth + 1) for child in node.value]


def plain(node: yaml.Node, *, as_text: bool = False) -> Any:
    """The value of a node. ``as_text``: numbers, dates and the like stay the text that was written, such as 0123.

    Raises:
        ValueError: it has a key twice, or a value that its tag doesn't allow.
    """
    if isinstance(node, yaml.MappingNode):
        value: dict[str, Any] = {}
        for key, child in node.value:
            if key.value in value:
                raise ValueError(f"line {key.start_mark.line + 1}: {key.value!r} stands there twice")
            value[key.value] = plain(child, as_text=as_text)
        return value
    if isinstance(node, yaml.SequenceNode):
        return [plain(child, as_text=as_text) for child in node.value]
    if as_text and node.tag != "tag:yaml.org,2002:null":
        return node.value
    try:
        return yaml.SafeLoader("").construct_object(node)
    except (yaml.YAMLError, ValueError) as error:  # such as 2026-02-30
        raise ValueError(f"line {node.start_mark.line + 1}: {getattr(error, 'problem', error)}") from None


def line_of(node: yaml.Node, path: Sequence[int | str]) -> int:
    """The line of the entry at a path; that of the nearest entry around it if there is none."""
    line: int = node.start_mark.line + 1
    for part in path:
        if isinstance(node, yaml.MappingNode):
            child = next(((k, v) for k, v in node.value if k.value == part), None)
            if child is None:
                break
            line, node = child[0].start_mark.line + 1, child[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
        else:
            break
    return line
