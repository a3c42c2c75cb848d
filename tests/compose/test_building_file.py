"""compose.building.yaml, and what `surveilnav init` lays over it; Compose itself reads them, without an engine."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from surveilnav.cli.main import app
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.robot_node.config import RobotSettings

ROOT = Path(__file__).parents[2]
PLAIN = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]


def answers(n_cameras: int, robots: tuple[str, ...]) -> dict[str, Any]:
    return {
        "building": "Headquarters: Nord",
        "floors": {"0": {}},
        "cameras": [
            {"name": f"c{i}", "floor": "0", "stream": f"rtsp://u:p$x%24@10.0.0.{i}/1", "picture_px": "640x480"}
            for i in range(n_cameras)
        ],
        "robots": {name: {"router": "10.0.0.7", "floor": "0"} for name in robots},
    }


def written(folder: Path, n_cameras: int, robots: tuple[str, ...] = ()) -> Path:
    """The folder of such a building."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    file = folder.parent / "answers.yaml"
    file.write_text(yaml.safe_dump(answers(n_cameras, robots), sort_keys=False))
    done = CliRunner().invoke(app, ["init", str(folder), "--answers", str(file)])
    assert done.exit_code == 0, done.output
    return folder


def composed(*files: str | Path, **environment: str) -> dict[str, Any]:
    """The services as Compose reads them."""
    if (
        shutil.which("docker") is None
        or subprocess.run(["docker", "compose", "version"], capture_output=True).returncode
    ):
        pytest.skip("no Docker Compose here")
    words = [word for file in files for word in ("--file", str(file))]
    done = subprocess.run(
        ["docker", "compose", *words, "config"], cwd=ROOT, capture_output=True, text=True, env=os.environ | environment
    )
    assert done.returncode == 0, done.stderr
    read: dict[str, Any] = yaml.safe_load(done.stdout)
    return read


def mounted(service: dict[str, Any]) -> str:
    """Which folder of this machine a service sees as /etc/surveilnav, read only."""
    (mount,) = [v for v in service["volumes"] if v["target"] == "/etc/surveilnav"]
    assert mount["read_only"] is True
    return str(mount["source"]).replace("$$", "$")  # as `config` prints a dollar


@pytest.mark.parametrize("name", ["hq", "head quarters: nord", '50 $HOME & "more"'])
def test_compose_starts_the_cameras_and_robots_of_the_answers(tmp_path: Path, name: str) -> None:
    folder = written(tmp_path / name, 3, ("r1", "r-2"))
    read = composed("compose.building.yaml", folder / "compose.override.yaml")
    assert read["name"] == "surveilnav-headquarters-nord"
    services = read["services"]
    assert set(services) == set(PLAIN) - {"prepare", "perception-gpu", "prometheus", "grafana"} | {"robot-2"}
    assert services["camera"]["deploy"]["replicas"] == 3
    for service in ("camera", "robot", "robot-2", "fusion", "planner", "gateway"):
        assert mounted(services[service]) == str(folder)
    given = {name: services[name]["environment"] for name in ("robot", "robot-2")}
    files = [env["SURVEILNAV_ROBOT__FILE"] for env in given.values()]
    assert files == ["/etc/surveilnav/robots/r1.yaml", "/etc/surveilnav/robots/r-2.yaml"]
    assert all((folder / file.removeprefix("/etc/surveilnav/")).is_file() for file in files)
    assert [env["SURVEILNAV_ROBOT__ID"] for env in given.values()] == ["r1", "r-2"]
    assert len({env["SURVEILNAV_ROBOT__STORE"] for env in given.values()}) == 2


def test_passwords_reach_the_cameras_as_they_are_written(tmp_path: Path) -> None:
    folder = written(tmp_path / "hq", 2)
    camera = composed("compose.building.yaml", folder / "compose.override.yaml")["services"]["camera"]
    assert camera["environment"]["C0_PASSWORD"] == "p%24x%24"
    assert camera["environment"]["SURVEILNAV_CAMERA__FILE"] == "/etc/surveilnav/cameras.yaml"


def test_a_building_without_robots_starts_none(tmp_path: Path) -> None:
    folder = written(tmp_path / "hq", 1)
    services = composed("compose.building.yaml", folder / "compose.override.yaml")["services"]
    assert not any(name.startswith("robot") for name in services)


def test_the_folder_may_be_another_one(tmp_path: Path) -> None:
    folder = written(tmp_path / "hq", 1, ("r1",))
    override = folder / "compose.override.yaml"
    services = composed("compose.building.yaml", override, SURVEILNAV_BUILDING_DIR=str(tmp_path))["services"]
    assert mounted(services["robot"]) == mounted(services["camera"]) == str(tmp_path)


def test_security_can_be_laid_between(tmp_path: Path) -> None:
    folder = written(tmp_path / "hq", 1, ("r1",))
    over = "compose.building.yaml", "compose.secure.yaml", folder / "compose.override.yaml"
    services = composed(*over)["services"]
    routers = {s["environment"]["SURVEILNAV_BUS__ROUTER"] for s in services.values()}
    assert routers == {"tls/router:7447"}


def test_nothing_simulated_is_started() -> None:
    services = composed("compose.building.yaml")["services"]
    assert {s["image"] for s in services.values()} == {"surveilnav"}
    assert services["perception"]["environment"]["SURVEILNAV_PERCEPTION__SIMULATED"] == "false"
    assert "prepare" not in services
    for name, settings, file in (
        ("camera", CameraSettings, "cameras.yaml"),
        ("robot", RobotSettings, "robots/r1.yaml"),
    ):
        assert "file" in settings.model_fields
        assert services[name]["environment"][f"SURVEILNAV_{name.upper()}__FILE"] == f"/etc/surveilnav/{file}"


def test_every_service_is_as_confined_and_watched_as_in_compose_yaml() -> None:
    services = composed("compose.building.yaml")["services"]
    for name, service in services.items():
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["mem_limit"], name
        assert service["healthcheck"]["test"], name
        assert name == "router" or service["depends_on"]["router"]["condition"] == "service_healthy", name
        assert all(port["host_ip"] == "127.0.0.1" for port in service.get("ports", [])), name


@pytest.mark.parametrize("name", ["fusion", "planner", "robot"])
def test_what_must_outlive_a_container_lies_in_the_volume_of_its_building(name: str) -> None:
    service = composed("compose.building.yaml")["services"][name]
    store = service["environment"][f"SURVEILNAV_{name.upper()}__STORE"]
    assert store.startswith("/var/lib/surveilnav/building/")
    assert any(v["type"] == "volume" and v["target"] == "/var/lib/surveilnav" for v in service["volumes"])


@pytest.mark.parametrize("name", ["fusion", "planner"])
def test_what_is_known_of_the_floors_is_told_to_those_who_plan_on_them(name: str) -> None:
    environment = composed("compose.building.yaml")["services"][name]["environment"]
    assert environment[f"SURVEILNAV_{name.upper()}__BUILDING_FILE"] == "/etc/surveilnav/building.yaml"
