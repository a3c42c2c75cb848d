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
    "init": "`folder`, `files`, `next` (commands)",
    "demo": "the run's `run.json`",
    "prepare": "`building`, `floors`, `cameras`, `perception`, `notes`, `seconds`",
    "buildings": "items: `name`, `about`, `floors`, `rooms`, `area_m2`",
    "homes": "`folder`, `homes`",
    "doctor": "`findings`: `what`, `level`, `detail`, `remedy`",
    "find": "`Mission`, when it has ended",
    "missions": "items: `Mission`",
    "missions show": "`Mission`",
    "missions why": "`MissionPlan`",
    "missions cancel": "`Mission`",
    "missions pause": "`Mission`",
    "missions resume": "`Mission`",
    "where": "`Sightings`",
    "cameras": "items: `Camera`",
    "cameras pause": "`Camera`",
    "cameras resume": "`Camera`",
    "cameras remove": "`id`, `removed`; with `--from-maps` `Removal`, when it has ended",
    "cameras delete-pictures": "items: `PictureKeeper`",
    "cameras check": "`cameras` (views by name), `problems`",
    "cameras calibrate": "`camera`, `position_m`, `yaw_deg`, `pitch_deg`, `roll_deg`, `hfov_deg`, "
    "`position_sigma_m`, `angle_sigma_deg`, `points`, `written`",
    "cameras calibrate-tag": "`cameras` (by name: `position_m`, `yaw_deg`, `pitch_deg`, `roll_deg`, `position_sigma_m`, "
    "`angle_sigma_deg`, `stops`, `residual_px`), `refused`, `left_out`, `tag_on_robot_m`, `written`",
    "cameras draw-tag": "`file`",
    "replay": "with `--check`: `recorded`, `replayed`, `views`, `began_with`, `ended`, `missing`, `same`",
    "status": "`services`, `robots`, `cameras`, `perception`, `missions`, `removals`: items each; "
    "`wrong_clocks`, `other_releases` and `problems` if there are any",
    "watch": "one object for each line: `id`, `event`, `data` (`Event`)",
    "objects": "items: `Object`",
    "map": "`Layer`",
    "traffic": "`Traffic`; with `--mission` `MissionTraffic`",
    "traffic plan": "by link (`camera`, `robot`, `server`): `mission_bytes`, `hour_bytes`, `hour_low_bytes`, `hour_high_bytes`",
    "robots": "items: `Robot`",
    "robots remove": "`Removal`, when it has ended",
    "robots check": "`checks`: `part`, `ok`, `message` each",
    "robots frame": "`T_building_map`, `residual_m`, `left_out` (numbers of pairs or stops), `written`",
    "stop": "items: `RobotHalt`",
    "release": "items: `RobotHalt`",
    "backup": "`file`, `bytes`, `program`, `created`, `contents` (items: `name`, `bytes`, numbers of what is in it), `left_out`",
    "restore": "as `backup`",
    "security init": "`folder`, `building`, `identities`",
    "security check": "`faults`, `warnings`",
    "security issue": "`name`, `folder`",
    "security renew": "items: names",
    "security remove": "`name`",
    "security rules": "`file`",
    "security key add": "`name`, `key`",
    "security key list": "items: `name`, `role`, `id`, `created`",
    "security key rotate": "`name`, `key`",
    "security key revoke": "`name`",
    "models list": "items: models",
    "models pull": "paths by model",
    "models check": "`ok`, `fault`, `id` by model",
    "dataset build": "the manifest",
    "dataset check": "`errors`, `notes`, `faults`",
    "dataset show": "`scenes`",
    "bench run": "`sr`, `spl`, `episodes`, ...",
    "bench table": "`tables`",
    "bench explain": "`said`, `searches`, `sr`, `spl`, `missing` (points by part), `groups`, `bounds`, `page`, `picture`; "
    "intervals are [mean, low, high]",
    "bench policies": "what each is about, by name",
}

_HEAD = """# The command line

The command `surveilnav` starts simulated systems, asks running ones, and plays the benchmark. Start a system in one terminal:

```
surveilnav prepare --building studio            # once, with a network: afterwards none is needed
surveilnav up --building studio                 # keeps running until Ctrl-C
```

Then use it from another:

```bash
surveilnav find tv                              # send a robot, and follow it
surveilnav missions                             # list the searches
surveilnav cameras                              # list the cameras, and what they saw
surveilnav traffic                              # how many bytes that took
surveilnav map                                  # draw the map with characters
surveilnav map value --target tv --out tv.png   # or write it as a picture; .npy is an array
```

`surveilnav watch` shows what is going on, until Ctrl-C. `surveilnav COMMAND --help` lists the options of a command. If the
virtual environment isn't active, write `.venv/bin/surveilnav`. `make docs` writes this page.

"""
_COMMANDS = """## Commands

The commands under "The running system" ask its gateway at `http://127.0.0.1:8080`; name another one by `--url` or
`SURVEILNAV_URL`. If it needs a key, put that into `SURVEILNAV_API_KEY`. In place of the id of a mission or camera you may type
its beginning, if no other id begins in the same way. `security`, `backup`
and `restore` work on files, and ask nothing.

"""
_JSON = """## For programs

With `--json` a command prints one JSON object on standard output; `watch` prints one for each line. A list is
`{"items": [...], "total": n}`. Items and single things are [resources of REST](rest.md), with all their fields. If the command
fails, the object is `{"error": {"type", "message"}}`. It also has the `name` of the problem, if the gateway or the mission gave
one.

Results go to standard output, progress and errors to standard error. If the output is a pipe or a file, a table has one line
for each thing, however long.

"""
_EXITS = """## Exit codes

| code | meaning |
|---|---|
"""
_TAIL = """
## Completion

After `surveilnav --install-completion`, bash, zsh, fish or PowerShell completes commands, options, and ids of missions and
cameras.
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
