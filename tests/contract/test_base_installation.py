"""`pip install surveilnav` without extras: its commands need no package that it doesn't bring; the others name their extra.

Here packages that the base installation lacks are hidden from a process of this environment. `tests/e2e/test_wheel.py`
installs the wheel itself.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import typer

from surveilnav.cli.main import app

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

#: Commands that ask a running system, as people type them.
ASKING = {
    "find": ["find", "tv"],
    "missions": ["missions"],
    "missions show": ["missions", "show", "m1"],
    "missions why": ["missions", "why", "m1"],
    "missions cancel": ["missions", "cancel", "m1"],
    "missions pause": ["missions", "pause", "m1"],
    "missions resume": ["missions", "resume", "m1"],
    "cameras": ["cameras"],
    "cameras pause": ["cameras", "pause", "c0-1"],
    "cameras resume": ["cameras", "resume", "c0-1"],
    "cameras remove": ["cameras", "remove", "c0-1"],
    "cameras delete-pictures": ["cameras", "delete-pictures"],
    "where": ["where", "tv"],
    "status": ["status"],
    "watch": ["watch"],
    "objects": ["objects"],
    "map": ["map"],
    "traffic": ["traffic"],
    "robots": ["robots"],
    "robots remove": ["robots", "remove", "r", "--from-maps"],
    "stop": ["stop"],
    "release": ["release"],
}
#: Commands that work on files and need nothing but the base, as people type them.
ON_FILES = {
    "backup": ["backup", "x", "--state", "/nowhere"],
    "restore": ["restore", "/nowhere"],
}
#: Every other command: its extra, and how it is typed.
NEEDING = {
    "init": ("services", ["init", "x"]),
    "traffic plan": ("services", ["traffic", "plan", "--cameras", "8"]),
    "demo": ("simulator", ["demo"]),
    "up": ("simulator", ["up"]),
    "prepare": ("simulator", ["prepare"]),
    "buildings": ("simulator", ["buildings"]),
    "homes": ("simulator", ["homes", "."]),
    "doctor": ("simulator", ["doctor"]),
    "replay": ("services", ["replay", "x.mcap"]),
    "models list": ("services", ["models", "list"]),
    "models pull": ("services", ["models", "pull", "yolox-nano"]),
    "models check": ("services", ["models", "check"]),
    "cameras check": ("services", ["cameras", "check", "cameras.yaml"]),
    "cameras calibrate": ("services", ["cameras", "calibrate", "lobby", "--clicks", "clicks.yaml"]),
    "cameras calibrate-tag": ("services", ["cameras", "calibrate-tag", "--offline"]),
    "cameras draw-tag": ("services", ["cameras", "draw-tag", "tag.png"]),
    "robots check": ("services", ["robots", "check", "robot.yaml"]),
    "robots frame": ("services", ["robots", "frame", "robot.yaml", "--pair", "0,0=1,1"]),
    "cameras schema": ("services", ["cameras", "schema"]),
    "security init": ("services", ["security", "init", "x"]),
    "security check": ("services", ["security", "check", "x"]),
    "security issue": ("services", ["security", "issue", "x", "camera-a"]),
    "security renew": ("services", ["security", "renew", "x"]),
    "security remove": ("services", ["security", "remove", "x", "camera-a"]),
    "security rules": ("services", ["security", "rules", "x"]),
    "security key add": ("services", ["security", "key", "add", "anna", "--role", "viewer"]),
    "security key list": ("services", ["security", "key", "list"]),
    "security key rotate": ("services", ["security", "key", "rotate", "anna"]),
    "security key revoke": ("services", ["security", "key", "revoke", "anna"]),
    "dataset build": ("bench", ["dataset", "build"]),
    "dataset check": ("bench", ["dataset", "check"]),
    "dataset show": ("bench", ["dataset", "show"]),
    "bench run": ("bench", ["bench", "run"]),
    "bench table": ("bench", ["bench", "table", "main"]),
    "bench explain": ("bench", ["bench", "explain", "run"]),
    "bench policies": ("bench", ["bench", "policies"]),
}
#: What commands load only once a gateway has answered.
LOADED_LATER = [
    "surveilnav.cli.cameras",
    "surveilnav.cli.following",
    "surveilnav.cli.map_drawing",
    "surveilnav.cli.mission_words",
    "surveilnav.cli.mistakes",
    "surveilnav.cli.watching.alerts",
    "surveilnav.cli.watching.feed",
    "surveilnav.cli.watching.lines",
    "surveilnav.cli.watching.screen",
    "surveilnav.client",
    "surveilnav.storage",
]

_RUN = """
import contextlib, importlib, io, json, sys

hidden, modules, typed = json.loads(sys.argv[1])


class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Hidden())
for module in modules:
    importlib.import_module(module)
from surveilnav.cli.main import main

told = []
for arguments in typed:
    sys.argv = ["surveilnav", *arguments]
    with contextlib.redirect_stderr(io.StringIO()) as err, contextlib.redirect_stdout(io.StringIO()):
        try:
            main()
        except SystemExit as ended:
            told.append([ended.code, err.getvalue()])
        except BaseException as error:
            told.append([repr(error), err.getvalue()])
print(json.dumps(told))
"""


def brought() -> set[str]:
    """Top-level names that a base installation has: those of its distributions, and of all that these need."""
    todo, names = [re.split(r"[<>=~! \[]", line)[0] for line in PROJECT["dependencies"]], {"surveilnav"}
    found: set[str] = set()
    while todo:
        name = re.sub(r"[-_.]+", "-", todo.pop()).lower()
        if name in found:
            continue
        found.add(name)
        needed = [line for line in metadata.requires(name) or [] if "extra ==" not in line]
        todo += [re.split(r"[<>=~!; (\[]", line)[0] for line in needed if _installed(line)]
    for top, distributions in metadata.packages_distributions().items():
        names |= {top} if {re.sub(r"[-_.]+", "-", d).lower() for d in distributions} & found else set()
    return names


def _installed(requirement: str) -> bool:
    """Those for other systems and Pythons aren't."""
    try:
        metadata.version(re.split(r"[<>=~!; (\[]", requirement)[0])
    except metadata.PackageNotFoundError:
        return False
    return True


def run(modules: list[str], typed: list[list[str]]) -> list[tuple[Any, str]]:
    """(exit status, stderr) of each command, one after the other, in a process without what extras bring."""
    argument = json.dumps([sorted(set(metadata.packages_distributions()) - brought()), modules, typed])
    ran = subprocess.run(
        [sys.executable, "-c", _RUN, argument], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert ran.returncode == 0, ran.stderr
    return [(code, said) for code, said in json.loads(ran.stdout.splitlines()[-1])]


def test_the_base_brings_no_array_and_no_server():
    assert "httpx" in brought()
    assert brought().isdisjoint({"numpy", "zenoh", "fastapi", "open3d", "onnxruntime", "matplotlib"})


def commands(command: Any, names: tuple[str, ...] = ()) -> set[str]:
    """Every command that can be run, groups that list something among them."""
    subcommands = getattr(command, "commands", {})
    found = {" ".join(names)} if names and (not subcommands or command.invoke_without_command) else set()
    return found.union(*(commands(sub, (*names, name)) for name, sub in subcommands.items()))


def test_each_command_is_sorted():
    assert commands(typer.main.get_command(app)) == set(ASKING) | set(ON_FILES) | set(NEEDING)


def test_commands_that_ask_a_running_system_need_no_extra():
    nowhere = ["--url", "http://127.0.0.1:9"]
    told = run(LOADED_LATER, [[*typed, *nowhere] for typed in ASKING.values()])
    wrong = {
        name: (code, said)
        for name, (code, said) in zip(ASKING, told, strict=True)
        if code != 1 or "no gateway answers" not in said
    }
    assert wrong == {}


def test_commands_on_files_need_no_extra():
    told = run(["surveilnav.cli.backup_archive", "surveilnav.cli.backup_stores"], list(ON_FILES.values()))
    assert all(code == 1 and "/nowhere" in said for code, said in told), told


def test_every_other_command_names_its_extra():
    told = run([], [typed for _, typed in NEEDING.values()])
    wrong = {
        name: (code, said)
        for (name, (extra, _)), (code, said) in zip(NEEDING.items(), told, strict=True)
        if code != 1 or f"pip install 'surveilnav[{extra}]'" not in said
    }
    assert wrong == {}


@pytest.mark.parametrize("extra", sorted({extra for extra, _ in NEEDING.values()}))
def test_the_extras_that_commands_name_exist(extra):
    assert extra in PROJECT["optional-dependencies"]
