"""Each rule of import-linter is proven by violations planted in a copy of the program: that rule breaks, no other."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from importlinter.api import read_configuration

ROOT = Path(__file__).parents[2]
PACKAGES = ("shared", "services", "simulator", "benchmark", "cli", "training")
CONTRACTS = read_configuration(str(ROOT / "pyproject.toml"))["contracts_options"]

#: By contract: packages that get one more module, and what it imports against the rule.
PLANTS = {
    "services never import each other": {
        "services/gateway": "surveilnav.services.planner.config",
        "services/robot_node": "surveilnav.services.camera_node.core",
    },
    "each layer imports only what stands below it": {
        "shared/surveilnav/bus": "surveilnav.services",
        "shared/surveilnav/sensing": "surveilnav.simulator.world.scene",
        "simulator/world": "surveilnav.services.fusion.core.maps.voxels",
        "services/planner": "surveilnav.benchmark",
        "benchmark": "surveilnav.cli.main",
    },
    "only tests import av, whose wheel holds GPL code": {
        "services/camera_node/sources": "av",
        "cli": "aio_rtsp_toolkit",
    },
    "nothing imports training": {"benchmark": "training.detector", "shared/surveilnav/perception": "training"},
    "training needs no command line": {"training/detector": "surveilnav.cli"},
    "only composition roots and files named simulated.py know the simulator": {
        "services/camera_node": "surveilnav.simulator.simulation",
        "services/camera_node/sources": "surveilnav.simulator.simulation",
        "services/robot_node/bodies": "surveilnav.simulator.world.goals",
        "services/planner": "surveilnav.simulator.world.navigation",
    },
    "the contract, the camera plan and the simulator know no bus and no web": {
        "simulator": "fastapi",
        "simulator/world": "surveilnav.bus",
        "simulator/render": "surveilnav.ros2.session",
        "simulator/hardware": "surveilnav.bus.node",
    },
    "simulated hardware is met on its wire alone": {
        "benchmark": "surveilnav.simulator.hardware.ros2_robot",
        "simulator/world": "surveilnav.simulator.hardware.faults",
        "cli": "surveilnav.simulator.hardware.ros2_robot",
    },
    "only the bus and ROS 2's wire know Zenoh": {"services/camera_node": "zenoh", "cli": "zenoh"},
    "cores are pure: no bus, web, clock, environment, log or chance": {
        "services/fusion/core": "time",
        "services/planner/core": "random",
        "services/gateway/core": "surveilnav.bus",
        "shared/surveilnav/geometry": "logging",
        "shared/surveilnav/messages": "os",
        "shared/surveilnav/perception": "structlog",
        "shared/surveilnav/sensing": "surveilnav.config",
    },
    "plans, world and pictures don't read the environment": {
        "simulator/plans": "surveilnav.config",
        "simulator/world": "surveilnav.config",
        "simulator/render": "surveilnav.config",
    },
}


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program's source."""
    copy = tmp_path_factory.mktemp("program")
    for package in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__", "*.json", ".*")
        shutil.copytree(ROOT / package, copy / package, symlinks=True, ignore=ignore)
    shutil.copy(ROOT / "pyproject.toml", copy)
    return copy


def broken(program: Path) -> tuple[set[str], str]:
    """The contracts that the copy breaks, and everything that the linter says."""
    run = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()", "--no-cache"],
        cwd=program,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": f"{program / 'shared'}:{program}", "COLUMNS": "300"},
    )
    assert "Contracts: " in run.stdout, run.stdout + run.stderr
    found = set(re.findall(r"^(.+?) BROKEN\b", run.stdout, re.MULTILINE))
    assert (run.returncode == 0) == (not found), run.stdout
    return found, run.stdout


def test_the_program_keeps_its_boundaries(program):
    found, said = broken(program)
    assert not found, said
    assert f"{len(CONTRACTS)} kept" in said


def test_every_boundary_is_proven():
    assert {c["name"] for c in CONTRACTS} == set(PLANTS)


@pytest.mark.parametrize("contract", PLANTS)
def test_a_planted_violation_breaks_just_its_boundary(program, contract):
    planted = {program / folder / "planted.py": target for folder, target in PLANTS[contract].items()}
    try:
        for path, target in planted.items():
            assert path.parent.is_dir(), f"{path.parent} is no place of the program any more"
            path.write_text(f"import {target}\n")
        found, said = broken(program)
    finally:
        for path in planted:
            path.unlink(missing_ok=True)
    assert found == {contract}, said
    for path, target in planted.items():
        module = _module(path.relative_to(program))
        assert re.search(rf"{re.escape(module)} -> {re.escape(target)}\b", said), f"{module} went unseen: {said}"


def _module(path: Path) -> str:
    """What a file of the program is imported as."""
    name = ".".join(path.with_suffix("").parts)
    return name.removeprefix("shared.") if name.startswith(("shared.", "training.")) else f"surveilnav.{name}"


# --- what import-linter can't see -------------------------------------------------------------------------------


def readers_of_the_environment(root: Path) -> Iterator[str]:
    """Files below plans, world and render that name ``environ`` or ``getenv``."""
    for package in ("plans", "world", "render"):
        for path in sorted((root / "simulator" / package).rglob("*.py")):
            if _names(path) & {"environ", "environb", "getenv"}:
                yield str(path.relative_to(root))


def imports_by_name(root: Path) -> Iterator[str]:
    """Files that import modules named in strings, past the linter."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            if _names(path) & {"import_module", "__import__", "runpy"}:
                yield str(path.relative_to(root))


def _names(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.alias(name=name):
                names.add(name)
    return names


def test_plans_world_and_pictures_do_not_look_into_the_environment(program):
    assert list(readers_of_the_environment(program)) == []
    planted = program / "simulator/render/planted.py"
    planted.write_text("import os\nprint(os.environ['HOME'])\n")
    assert list(readers_of_the_environment(program)) == ["simulator/render/planted.py"]
    planted.unlink()


def test_nothing_is_imported_past_the_linter(program):
    """The doctor tries other people's packages by name."""
    assert list(imports_by_name(program)) == ["cli/doctor.py"]
    tried = re.search(r"for name in \((.*?)\)", (program / "cli/doctor.py").read_text(), re.DOTALL)
    assert tried
    assert not re.search(r"surveilnav|simulator|services|benchmark|cli", tried.group(1))
    planted = program / "services/fusion/planted.py"
    planted.write_text("from importlib import import_module\nimport_module('surveilnav.services.planner.core')\n")
    assert sorted(imports_by_name(program)) == ["cli/doctor.py", "services/fusion/planted.py"]
    planted.unlink()
