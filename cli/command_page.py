"""``python -m surveilnav.cli.command_page``: docs/use/command-line.md, from the commands themselves (``make docs``)."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import cleandoc
from itertools import groupby
from typing import Any

import typer

from surveilnav.cli.exits import Exit
from surveilnav.cli.main import app

#: What ``--json`` prints, by command: `Name` is a resource of REST.
SHAPES: dict[str, str] = {
    "demo": "the run's `run.json`",
    "prepare": "`building`, `floors`, `cameras`, `perception`, `notes`, `seconds`",
    "buildings": "items: `name`, `about`, `floors`, `rooms`, `area_m2`",
    "homes": "`folder`, `homes`",
    "doctor": "`findings`: `what`, `level`, `detail`, `remedy`",
    "find": "`Mission`, when it has ended",
    "missions": "items: `Mission`",
    "missions show": "`Mission`",
    "missions plan": "`MissionPlan`",
    "missions cancel": "`Mission`",
    "missions pause": "`Mission`",
    "missions resume": "`Mission`",
    "cameras": "items: `Camera`",
    "cameras pause": "`Camera`",
    "cameras resume": "`Camera`",
    "cameras forget": "`id`, `forgotten`",
    "cameras delete-pictures": "items: `PictureKeeper`",
    "replay": "with `--check`: `recorded`, `replayed`, `views`, `began_with`, `ended`, `same`",
    "status": "`services`, `robots`, `cameras`, `perception`, `missions`: items each",
    "watch": "an object a line: `id`, `event`, `data` (`Event`)",
    "objects": "items: `Object`",
    "map": "`Layer`",
    "traffic": "`Traffic`; with `--mission` `MissionTraffic`",
    "stop": "items: `RobotHalt`",
    "release": "items: `RobotHalt`",
    "models list": "items: models",
    "models pull": "paths by model",
    "models check": "`ok`, `fault`, `id` by model",
    "dataset build": "the manifest",
    "dataset check": "`errors`, `notes`, `faults`",
    "dataset show": "`scenes`",
    "bench run": "`sr`, `spl`, `episodes`, ...",
    "bench table": "`tables`",
    "bench policies": "what each is about, by name",
}

_HEAD = """# The command line

`surveilnav COMMAND --help` has every option. Where the virtual environment isn't active, write
`.venv/bin/surveilnav`. `make docs` writes this page.

```
surveilnav prepare --building studio            # once, with a network: afterwards none is needed
surveilnav up --building studio                 # keeps running; go on in another terminal
surveilnav watch                                # what is going on, until Ctrl-C
```

```bash
surveilnav find tv                              # send a robot, and follow it
surveilnav missions                             # which searches there are
surveilnav cameras                              # what cameras saw
surveilnav traffic                              # what that cost
surveilnav map                                  # what is mapped, drawn with characters
surveilnav map value --target tv --out tv.png   # or as a picture; .npy is an array
```

"""
_COMMANDS = """## Commands

Commands of a running system ask its gateway at `http://127.0.0.1:8080`; `--url` or `SURVEILNAV_URL` name another one. The id of a
mission or camera may be cut short where no other begins so.

"""
_JSON = """## For programs

`--json` prints one JSON object on standard output. A list is `{"items": [...], "total": n}`. Items and single things are
[REST's resources](rest.md), with all their fields. `watch` prints an object a line. If a command fails, the object is
`{"error": {"type", "message"}}`, with the `name` of the gateway's or the mission's problem where there is one.

Results are on standard output, progress and mistakes on standard error. In a pipe or a file a table has one line for each
thing, however long.

"""
_EXITS = """## Exit codes

| code | meaning |
|---|---|
"""
_TAIL = """
## Completion

`surveilnav --install-completion` has bash, zsh, fish or PowerShell complete commands, options, and ids of missions and cameras.
"""


def markdown() -> str:
    """The whole page."""
    exits = "".join(f"| {int(code)} | {code.about} |\n" for code in Exit)
    return _HEAD + _COMMANDS + "\n".join(_tables()) + "\n" + _JSON + _EXITS + exits + _TAIL


def commands(command: Any, names: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Everything that does something, as it is typed, in the help's order. A group that lists by itself is one, too."""
    subs = getattr(command, "commands", {})
    if names and (not subs or command.invoke_without_command):
        yield " ".join(names), command
    for name, sub in subs.items():
        yield from commands(sub, (*names, name))


def _tables() -> Iterator[str]:
    """A table for each panel of the help."""
    root: Any = typer.main.get_command(app)
    for panel, found in groupby(
        commands(root), key=lambda named: root.commands[named[0].partition(" ")[0]].rich_help_panel
    ):
        yield f"**{panel}**\n\n| command | what it does | `--json` |\n|---|---|---|"
        for name, command in found:
            words = " ".join((cleandoc(command.callback.__doc__ or "")).split("\n\n")[0].split())
            yield f"| `surveilnav {name}` | {words} | {SHAPES.get(name, '')} |"
        yield ""


if __name__ == "__main__":
    print(markdown(), end="")
