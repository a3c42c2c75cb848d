"""From answers to the texts of a building's files. Nothing is written here."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import yaml

from surveilnav.building_file import load_building
from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.passwords import FILE_NAME, without_secrets
from surveilnav.cameras_file.uncalibrated import placeholder
from surveilnav.cli.building_setup.answers import Answers, CameraAnswers, RobotAnswers
from surveilnav.cli.building_setup.plans import FloorFiles
from surveilnav.cli.building_setup.writing import NewFile
from surveilnav.errors import ConfigError
from surveilnav.robot_file import FrameEntry, load_robot

#: What is written where nobody knows better: `cameras calibrate --fit-hfov` finds the angle, and the doctor the size.
DEFAULT_PX, DEFAULT_HFOV_DEG, DEFAULT_FISHEYE_HFOV_DEG = (1920, 1080), 90.0, 180.0
BUILDING, CAMERAS, OVERRIDE = "building.yaml", "cameras.yaml", "compose.override.yaml"


def texts_of(
    answers: Answers, floors: Mapping[str, FloorFiles], sizes_px: Mapping[str, tuple[int, int]], folder: Path
) -> dict[str, NewFile]:
    """All files by their paths in the building's folder.

    Args:
        floors: the files of the floors.
        sizes_px: of the pictures of cameras whose answers don't say it.

    Raises:
        ConfigError: the answers contradict each other. The message has nothing of a password.
    """
    _check_floors(answers)
    secrets: dict[str, str] = {}
    texts = {
        BUILDING: _building(answers, floors),
        CAMERAS: _cameras(answers, sizes_px, secrets),
        **{f"robots/{name}.yaml": _robot(answers, name, robot, floors) for name, robot in answers.robots.items()},
        OVERRIDE: _override(answers, folder),
    }
    _check(texts, folder)
    files = {name: NewFile(text.encode()) for name, text in texts.items()}
    lines = "".join(f"{name}={value}\n" for name, value in secrets.items())
    files[FILE_NAME] = NewFile(f"# Passwords of the streams in {CAMERAS}: NAME=value\n{lines}".encode(), private=True)
    for floor in floors.values():
        files |= {name: NewFile(content) for name, content in floor.written.items()}
    return files


def _check_floors(answers: Answers) -> None:
    named = [*((f"camera {c.name}", c.floor) for c in answers.cameras)]
    named += [(f"robot {name}", robot.floor) for name, robot in answers.robots.items()]
    for what, floor in named:
        if floor not in answers.floors:
            raise ConfigError(f"{what}: there is no floor {floor!r}; there are {', '.join(answers.floors)}")


def _check(texts: Mapping[str, str], folder: Path) -> None:
    """Reads the texts as the services will."""
    load_building(folder / BUILDING, texts[BUILDING])
    problems = [str(problem) for problem in load_cameras(folder / CAMERAS, texts[CAMERAS]).problems]
    if problems:
        raise ConfigError("\n".join(problem.partition(": ")[2] for problem in problems))
    for name, text in texts.items():
        if name.startswith("robots/"):
            load_robot(folder / name, text)


def _scalar(text: str) -> str:
    """A text as YAML, in quotes if it needs them."""
    written: str = yaml.safe_dump(text, allow_unicode=True, width=10_000)
    return written.removesuffix("\n").removesuffix("...").removesuffix("\n")


def _number(value: float) -> str:
    """A length or an angle to a tenth of a millimetre or of a thousandth degree."""
    return f"{round(value, 4):.12g}"


def _frame(frame: FrameEntry) -> str:
    return f"{{x_m: {_number(frame.x_m)}, y_m: {_number(frame.y_m)}, yaw_deg: {_number(frame.yaw_deg)}}}"


def _building(answers: Answers, floors: Mapping[str, FloorFiles]) -> str:
    lines = [
        "# The building: which files describe it, and what is known of its floors.",
        f"building: {_scalar(answers.building)}",
        f"cameras: {CAMERAS}",
    ]
    if answers.robots:
        lines += ["robots:", *(f"  {_scalar(name)}: {_scalar(f'robots/{name}.yaml')}" for name in answers.robots)]
    known = {name: files for name, files in floors.items() if files.plan or files.nav2_map}
    lines += ["floors:"] * bool(known)
    for name, files in known.items():
        lines.append(f"  {_scalar(name)}:" + ("" if files.plan or files.T_building_map else " {}"))
        lines += [f"    plan: {_scalar(files.plan)}"] * bool(files.plan)
        if files.nav2_map and files.T_building_map:
            lines += [f"    nav2_map: {_scalar(files.nav2_map)}", f"    T_building_map: {_frame(files.T_building_map)}"]
        elif files.nav2_map:
            lines += [
                "    # Once `surveilnav robots frame` has found where the map lies:",
                f"    # nav2_map: {_scalar(files.nav2_map)}",
                "    # T_building_map: {x_m: ..., y_m: ..., yaw_deg: ...}",
            ]
    return "\n".join(lines) + "\n"


def _cameras(answers: Answers, sizes_px: Mapping[str, tuple[int, int]], secrets: dict[str, str]) -> str:
    lines = [f"# Its cameras. Passwords stand in {FILE_NAME}.", f"building: {_scalar(answers.building)}", "floors:"]
    lines += [f"  {_scalar(name)}: {{z_m: {_number(floor.z_m)}}}" for name, floor in answers.floors.items()]
    lines.append("cameras:" if answers.cameras else "cameras: []")
    for camera in answers.cameras:
        size_px = camera.picture_px or sizes_px.get(camera.name, DEFAULT_PX)
        lines += _camera(camera, answers.floors[camera.floor].z_m, size_px, secrets)
    return "\n".join(lines) + "\n"


def _camera(camera: CameraAnswers, floor_z_m: float, size_px: tuple[int, int], secrets: dict[str, str]) -> list[str]:
    stream, own = stream_of(camera)
    for name, value in own.items():
        unique, n = name, 2
        while secrets.get(unique, value) != value:  # cameras a-b and a.b
            unique, n = f"{name}_{n}", n + 1
        stream, secrets[unique] = stream.replace(f"${{{name}}}", f"${{{unique}}}"), value
    if camera.position_m is None:
        place = placeholder(floor_z_m)
        how = "   # position and direction: by `surveilnav cameras calibrate`"
    else:
        x, y, z = camera.position_m
        place = {"position_m": f"[{_number(x)}, {_number(y)}, {_number(z)}]"}
        place |= {"yaw_deg": f"{_number(camera.yaw_deg)}", "pitch_deg": f"{_number(camera.pitch_deg)}"}
        how = ""
    default_deg = DEFAULT_FISHEYE_HFOV_DEG if camera.fisheye else DEFAULT_HFOV_DEG
    lens = f"width_px: {size_px[0]}, height_px: {size_px[1]}, hfov_deg: {_number(camera.hfov_deg or default_deg)}"
    return [
        f"  - name: {_scalar(camera.name)}",
        *([f"    label: {_scalar(camera.label)}"] if camera.label else []),
        f"    floor: {_scalar(camera.floor)}",
        f"    stream: {_scalar(stream)}",
        f"    position_m: {place['position_m']}{how}",
        f"    yaw_deg: {place['yaw_deg']}",
        f"    pitch_deg: {place['pitch_deg']}",
        f"    lens: {{{'model: fisheye, ' if camera.fisheye else ''}{lens}}}"
        + ("" if camera.hfov_deg else "   # hfov_deg: by the data sheet, or by `calibrate --fit-hfov`"),
        *(["    views: around"] if camera.fisheye and place["pitch_deg"] == "-90" else []),
    ]


def stream_of(camera: CameraAnswers) -> tuple[str, dict[str, str]]:
    """A camera's stream for the file, and the values of its variables. ConfigError: nothing can read such an address."""
    scheme = camera.stream.split("://", 1)[0].lower() if "://" in camera.stream else ""
    try:
        if scheme not in ("", "rtsp", "rtsps", "http", "https"):
            raise ValueError(f"expected {CameraAnswers.model_fields['stream'].description}")
        return without_secrets(camera.stream, camera.name, camera.user, camera.password)
    except ValueError as error:
        raise ConfigError(f"camera {camera.name}, stream: {error}") from None


def _robot(answers: Answers, name: str, robot: RobotAnswers, floors: Mapping[str, FloorFiles]) -> str:
    frame = floors[robot.floor].T_building_map if robot.on_nav2_map else None
    lines = [
        f"# Robot {name}; names of topics that differ are written here as well (docs/use/robot.md).",
        f"router: {robot.router}",
        f"domain: {robot.domain}",
        *([f"namespace: {_scalar(robot.namespace)}"] if robot.namespace else []),
        f"drive: {'waypoints' if robot.nav2 else 'actions'}",
        f"floor: {_scalar(robot.floor)}",
        f"floor_z_m: {_number(answers.floors[robot.floor].z_m)}",
        f"T_building_map: {_frame(frame)}" if frame else "# where its map lies: `surveilnav robots frame ... --write`",
    ]
    return "\n".join(lines) + "\n"


def _override(answers: Answers, folder: Path) -> str:
    """Compose's file: so many cameras, and a service for each robot. The folder may be named anew, as on another machine."""
    project = re.sub(r"[^a-z0-9]+", "-", answers.building.lower()).strip("-") or "building"
    where = "${SURVEILNAV_BUILDING_DIR:-" + str(folder.resolve()).replace("$", "$$") + "}"
    # in quotes whatever the folder's name is: JSON is YAML
    mount = yaml.safe_dump(where, default_style='"', width=10_000, allow_unicode=True).strip()
    env_file = yaml.safe_dump(f"{where}/{FILE_NAME}", default_style='"', width=10_000, allow_unicode=True).strip()
    lines = [
        "# Laid over compose.building.yaml, which is in SurveilNav's repository:",
        f"#   docker compose -f compose.building.yaml -f {OVERRIDE} up --wait",
        f"name: surveilnav-{project}",
        "x-building: &building",
        f"  volumes: [{{type: bind, source: {mount}, target: /etc/surveilnav, read_only: true}}]",
        "services:",
        "  camera:",
        "    <<: *building",
        f"    env_file: !override [{{path: {env_file}, required: false}}]",
        f"    deploy: {{replicas: {len(answers.cameras)}}}",
        *(f"  {service}: *building" for service in ("fusion", "planner", "gateway")),
    ]
    for service, name in zip(robot_services(answers), answers.robots, strict=True):
        extends = ["    extends: {file: compose.building.yaml, service: robot}"] if service != "robot" else []
        lines += [
            f"  {service}:",
            "    <<: *building",
            *extends,
            "    environment:",
            f"      SURVEILNAV_ROBOT__ID: {_scalar(name)}",
            f"      SURVEILNAV_ROBOT__FILE: {_scalar(f'/etc/surveilnav/robots/{name}.yaml')}",
            f"      SURVEILNAV_ROBOT__STORE: {_scalar(f'/var/lib/surveilnav/building/{name}.state')}",
        ]
    lines += [] if answers.robots else ["  robot: !reset null"]
    return "\n".join(lines) + "\n"


def robot_services(answers: Answers) -> list[str]:
    """Compose's services of the robots: `robot`, then one named after each further one."""
    return ["robot" if i == 0 else f"robot-{i + 1}" for i in range(len(answers.robots))]
