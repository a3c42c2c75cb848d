"""Asks a person in a terminal. A wrong answer is asked again, with what was expected; Enter takes what stands in brackets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from surveilnav.cli.building_setup.answers import Answers, CameraAnswers, FloorAnswers, RobotAnswers, parsed
from surveilnav.cli.building_setup.plans import check_plan, has_scale
from surveilnav.cli.building_setup.texts import stream_of
from surveilnav.cli.options import console
from surveilnav.errors import ConfigError
from surveilnav.robot_frame.nav2_map import load_nav2_map

#: Raises ConfigError or ValueError if an answer doesn't fit the others.
Check = Callable[[Any], object]


def ask_all(folder: Path) -> Answers:
    """Asks for everything.

    Args:
        folder: the building's, where streams that are no addresses lie.

    Raises:
        typer.Abort: the person pressed Ctrl-C.
        ConfigError: the input ended.
    """
    try:
        building = _ask(Answers, "building")
        floors = _ask_floors()
        return Answers(
            building=building, floors=floors, cameras=_ask_cameras(floors, folder), robots=_ask_robots(floors)
        )
    except typer.Abort as aborted:
        if isinstance(aborted.__context__, EOFError):
            raise ConfigError("the input ended before all was asked. In a script, use --answers FILE") from None
        raise


def _heading(text: str) -> None:
    console.print(f"\n[bold]{text}[/]", soft_wrap=True)


def _ask(
    model: type[BaseModel], field: str, default: Any = None, check: Check | None = None, hidden: bool = False
) -> Any:
    """The answer to the question of a field."""
    info = model.model_fields[field]
    if default is None and not info.is_required():
        default = info.default
    return _prompt(info, default, check, hidden)


def _prompt(info: FieldInfo, default: Any, check: Check | None, hidden: bool) -> Any:
    def value_of(text: str) -> Any:
        if not text.strip() and default in (None, ""):
            return default
        try:
            value = parsed(info, text.strip())
            if check is not None and value is not None:
                check(value)
        except (ConfigError, ValueError) as error:
            raise typer.BadParameter(str(error)) from None
        return value

    shown = _shown(default)
    return typer.prompt(
        info.title or "",
        default=None if info.is_required() and default is None else shown,
        show_default=bool(shown) and not hidden,
        value_proc=value_of,
        hide_input=hidden,
        err=True,
    )


def _shown(default: Any) -> str:
    """A default as a person would type it."""
    if isinstance(default, bool):
        return "yes" if default else "no"
    return "" if default is None else f"{default:g}" if isinstance(default, float) else str(default)


def _new_name(title: str, expected: str, taken: list[str], default: str = "") -> str:
    """The name of one thing more; empty: there is none."""
    info = CameraAnswers.model_fields["name"]

    def name_of(text: str) -> str:
        if not text.strip():
            return ""
        try:
            name: str = parsed(info, text.strip())
        except ValueError:
            raise typer.BadParameter(f"expected {expected}") from None
        if name in taken:
            raise typer.BadParameter(f"{name} is taken: expected another name, or Enter")
        return name

    shown = bool(default)
    return str(typer.prompt(title, default=default, show_default=shown, value_proc=name_of, err=True))


def _ask_floors() -> dict[str, FloorAnswers]:
    _heading("Floors")
    console.print(
        "All places are in the building's frame: x and y in metres on the floor plan, z upwards.", soft_wrap=True
    )
    floors: dict[str, FloorAnswers] = {}
    expected = "letters, digits, '_', '.', '-', such as ground or 1"
    while name := _new_name(
        "Another floor's id (Enter: no more)" if floors else "Floor's id",
        expected,
        list(floors),
        "" if floors else "ground",
    ):
        floors[name] = _ask_floor()
    return floors


def _ask_floor() -> FloorAnswers:
    answers: dict[str, Any] = {"z_m": _ask(FloorAnswers, "z_m")}
    answers["plan"] = plan = _ask(FloorAnswers, "plan", check=check_plan)
    if plan and not has_scale(plan):
        answers["plan_width_m"] = _required(FloorAnswers, "plan_width_m")
    answers["nav2_map"] = nav2_map = _ask(FloorAnswers, "nav2_map", check=load_nav2_map)
    if nav2_map:
        same = plan is None or plan.resolve() == nav2_map.resolve()
        answers["plan"] = plan or nav2_map
        default = "0, 0, 0" if same else None
        answers["T_building_map"] = _ask(FloorAnswers, "T_building_map", default)
    return FloorAnswers(**answers)


def _required(model: type[BaseModel], field: str) -> Any:
    """The answer to a question that must be answered now, though others needn't."""
    info = model.model_fields[field]

    def value_of(text: str) -> Any:
        try:
            return parsed(info, text.strip())
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return typer.prompt(info.title or "", value_proc=value_of, err=True)


def _floor_of(model: type[BaseModel], floors: dict[str, FloorAnswers]) -> str:
    """Asked only if there are several."""
    if len(floors) == 1:
        return next(iter(floors))

    def known(floor: str) -> None:
        if floor not in floors:
            raise ValueError(f"expected one of {', '.join(floors)}")

    return str(_ask(model, "floor", next(iter(floors)), known))


def _ask_cameras(floors: dict[str, FloorAnswers], folder: Path) -> list[CameraAnswers]:
    _heading("Cameras")
    cameras: list[CameraAnswers] = []
    field = CameraAnswers.model_fields["name"]
    while name := _new_name(field.title or "", field.description or "", [camera.name for camera in cameras]):
        cameras.append(_ask_camera(name, floors, folder))
    return cameras


def _ask_camera(name: str, floors: dict[str, FloorAnswers], folder: Path) -> CameraAnswers:
    floor = _floor_of(CameraAnswers, floors)

    def check_stream(stream: str) -> None:
        stream_of(CameraAnswers(name=name, floor=floor, stream=stream))
        if "://" not in stream and not stream.startswith(("usb:", "/dev/video")) and not (folder / stream).exists():
            raise ValueError(
                f"there is no {folder / stream}; expected {CameraAnswers.model_fields['stream'].description}"
            )

    answers: dict[str, Any] = {"stream": _ask(CameraAnswers, "stream", check=check_stream)}
    if "://" in answers["stream"] and "@" not in answers["stream"] and (user := _ask(CameraAnswers, "user")):
        answers |= {"user": user, "password": _ask(CameraAnswers, "password", hidden=True)}
    answers["picture_px"] = _ask(CameraAnswers, "picture_px")
    answers["fisheye"] = fisheye = _ask(CameraAnswers, "fisheye")
    answers["hfov_deg"] = _ask(CameraAnswers, "hfov_deg", check=lambda hfov_deg: _check_hfov(hfov_deg, fisheye))
    z_m = floors[floor].z_m
    answers["position_m"] = _ask(CameraAnswers, "position_m", check=lambda place: _check_height(place[2] - z_m))
    if answers["position_m"]:
        answers["yaw_deg"] = _ask(CameraAnswers, "yaw_deg")
        answers["pitch_deg"] = _ask(CameraAnswers, "pitch_deg", -90.0 if fisheye else None)
    return CameraAnswers(name=name, floor=floor, **answers)


def _check_hfov(hfov_deg: float, fisheye: bool) -> None:
    if not fisheye and hfov_deg >= 170:
        raise ValueError("expected less than 170 degrees; a lens that sees more is a fisheye")


def _check_height(height_m: float) -> None:
    if not 0.2 <= height_m <= 30.0:
        raise ValueError(f"expected z 0.2 to 30 m above the floor's altitude, not {height_m:g} m")


def _ask_robots(floors: dict[str, FloorAnswers]) -> dict[str, RobotAnswers]:
    _heading("Robots")
    robots: dict[str, RobotAnswers] = {}
    expected = "letters, digits, '_', '.', '-', such as r1"
    while name := _new_name("Robot's name (Enter: no more)", expected, list(robots)):
        answers = {field: _ask(RobotAnswers, field) for field in ("router", "domain", "namespace", "nav2")}
        answers["floor"] = floor = _floor_of(RobotAnswers, floors)
        if floors[floor].T_building_map is not None:
            answers["on_nav2_map"] = _ask(RobotAnswers, "on_nav2_map", True)
        robots[name] = RobotAnswers(**answers)
    return robots
