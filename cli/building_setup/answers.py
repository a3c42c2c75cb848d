"""What ``surveilnav init`` asks. ``title`` of a field is its question; ``description`` says what is expected.

A file of answers (``--answers``) has the same fields as keys.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from surveilnav.contract import ID_PATTERN
from surveilnav.file_entry import Entry, Finite
from surveilnav.robot_file import FrameEntry
from surveilnav.yaml_file import read_table


def _numbers(value: Any) -> Any:
    """The numbers that a person typed, such as `2, 1.5, 2.6` or `1920x1080`."""
    return re.split(r"[,;\sx×]+", value.strip().strip("[]()").strip()) if isinstance(value, str) else value


def _frame(value: Any) -> Any:
    """`12.4, 3.1, 91.5` as a table."""
    numbers = _numbers(value)
    if isinstance(numbers, list):
        return dict(zip(("x_m", "y_m", "yaw_deg"), numbers, strict=False)) if len(numbers) == 3 else numbers
    return numbers


def _endpoint(value: str) -> str:
    """`10.0.0.7` or `10.0.0.7:7447` as the endpoint that Zenoh expects."""
    value = value if "/" in value else f"tcp/{value}"
    value = value if re.search(r":\d+$", value) else f"{value}:7447"
    if not re.fullmatch(r"(tcp|tls|udp|quic|ws)/(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):\d{1,5}", value):
        raise ValueError("no such endpoint")
    return value


def _label(value: str) -> str:
    if not value.isprintable():
        raise ValueError("it has characters that can't be shown")
    return value


Id = Annotated[str, Field(pattern=ID_PATTERN)]
Place = Annotated[tuple[Finite, Finite, Finite], BeforeValidator(_numbers)]
SizePx = Annotated[
    tuple[Annotated[int, Field(ge=64, le=16384)], Annotated[int, Field(ge=64, le=16384)]], BeforeValidator(_numbers)
]
Frame = Annotated[FrameEntry, BeforeValidator(_frame)]


class _Answers(Entry):
    model_config = ConfigDict(coerce_numbers_to_str=True)


class FloorAnswers(_Answers):
    """One floor."""

    z_m: Finite = Field(
        0.0, title="Altitude of its surface [m]", description="a number; one floor of the building has 0"
    )
    plan: Path | None = Field(
        None,
        title="Floor plan (Enter: none)",
        description="a picture (PNG, JPEG), or a map.yaml as Nav2's, that is there. Cameras are calibrated on it",
    )
    plan_width_m: Annotated[Finite, Field(gt=0, le=5000)] | None = Field(
        None,
        title="How wide is what that picture shows, from its left to its right edge [m]",
        description="a number of metres, measured in the building",
    )
    nav2_map: Path | None = Field(
        None, title="Nav2's map of the floor (Enter: none)", description="a map.yaml that is there, with its picture"
    )
    T_building_map: Frame | None = Field(
        None,
        title="Where that map's origin lies on the floor plan: x, y [m], yaw [degrees] (Enter: not known yet)",
        description="three numbers, such as 12.4, 3.1, 91.5",
    )


class CameraAnswers(_Answers):
    """One camera."""

    name: Id = Field(
        title="Camera's name (Enter: no more)",
        description="letters, digits, '_', '.', '-', at most 64, such as lobby; another camera mustn't have it",
    )
    label: Annotated[str, Field(max_length=100), AfterValidator(_label)] = Field(
        "", title="Its name for people", description="at most 100 characters, in any writing"
    )
    floor: Id = Field(title="Its floor", description="one of the floors above")
    stream: Annotated[str, Field(min_length=1, max_length=1000)] = Field(
        title="Its stream",
        description="rtsp://10.0.0.5/stream1, http://10.0.0.6/snapshot.jpg, usb:0, or a video file or folder of pictures",
    )
    user: str = Field("", title="User (Enter: none)", description="the camera's user for the stream")
    password: str = Field("", title="Password (isn't shown)", description="that user's password", repr=False)
    picture_px: SizePx | None = Field(
        None,
        title="Size of its pictures (Enter: as they come from the stream)",
        description="width and height in pixels, such as 1920x1080",
    )
    fisheye: bool = Field(False, title="Is its lens a fisheye", description="yes or no")
    hfov_deg: Annotated[Finite, Field(gt=1, lt=360)] | None = Field(
        None,
        title="Horizontal field of view by its data sheet [degrees] (Enter: not known)",
        description="a number of degrees, such as 96; more than 170 only for a fisheye",
    )
    position_m: Place | None = Field(
        None,
        title="Where its lens is: x, y, z [m] in the building (Enter: not known, it will be calibrated)",
        description="three numbers, such as 2.0, 1.5, 2.6; z as the floor's altitude, so 0.2 to 30 m above it",
    )
    yaw_deg: Finite = Field(
        0.0, title="Its direction, anticlockwise from +x [degrees]", description="a number of degrees"
    )
    pitch_deg: Annotated[Finite, Field(ge=-90, le=90)] = Field(
        -30.0, title="How far it looks up [degrees]; down is negative", description="a number from -90 to 90"
    )


class RobotAnswers(_Answers):
    """One robot with ROS 2."""

    router: Annotated[str, AfterValidator(_endpoint)] = Field(
        title="Address of its Zenoh router (rmw_zenohd)", description="such as 10.0.0.7, or tcp/10.0.0.7:7447"
    )
    domain: Annotated[int, Field(ge=0, le=232)] = Field(0, title="Its ROS_DOMAIN_ID", description="0 to 232")
    namespace: Annotated[str, Field(max_length=200, pattern=r"^[A-Za-z0-9_/]*$")] = Field(
        "", title="Namespace of its nodes (Enter: none)", description="such as /robot1"
    )
    nav2: bool = Field(True, title="Does it drive by Nav2", description="yes; or no, if it only follows velocities")
    floor: Id = Field(title="Its floor", description="one of the floors above")
    on_nav2_map: bool = Field(False, title="Does it localise itself on this floor's Nav2 map", description="yes or no")


class Answers(_Answers):
    """All answers."""

    building: Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_label)] = Field(
        title="Name of the building", description="1 to 100 characters, in any writing"
    )
    floors: Annotated[dict[Id, FloorAnswers], Field(min_length=1, max_length=200)]
    cameras: list[CameraAnswers] = []
    robots: dict[Id, RobotAnswers] = {}


def parsed(field: FieldInfo, value: Any) -> Any:
    """The answer to one question, as its model has it.

    Raises:
        ValueError: it isn't what is expected; the message says what is, and has nothing of the value.
    """
    annotation: Any = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
    try:
        return TypeAdapter(annotation, config=ConfigDict(coerce_numbers_to_str=True)).validate_python(value)
    except ValidationError:
        raise ValueError(f"expected {field.description}") from None


def load_answers(path: Path) -> Answers:
    """Reads a file of answers.

    Raises:
        ConfigError: it can't be read or used; the message names the line, and has nothing of a password.
    """
    expected = "a table that begins with `building:`; the file is empty or something else"
    # as text: passwords such as 0123 stay as they are
    return read_table(path, "file of answers", Answers, expected, as_text=True, fault=_fault)[0]


def _fault(error: ErrorDetails) -> str:
    told = _expected(error["loc"]) or error["msg"].removeprefix("Value error, ")
    told = "it is missing" if error["type"] == "missing" else told
    return f"{'.'.join(map(str, error['loc']))}: {told}"


def _expected(where: tuple[int | str, ...]) -> str:
    """What the question at a place in the file expects; empty: there is no such question."""
    models: dict[str, type[_Answers]] = {"floors": FloorAnswers, "cameras": CameraAnswers, "robots": RobotAnswers}
    model = models.get(str(where[0])) if len(where) > 2 else Answers if len(where) == 1 else None
    field = model.model_fields.get(str(where[2 if len(where) > 2 else 0])) if model else None
    return f"expected {field.description}" if field and field.description else ""
