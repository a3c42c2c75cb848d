"""What several commands share: options, the two outputs, the gateway. It imports nothing that takes time to load."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surveilnav.cli.terminal import Terminal
from surveilnav.perception.names import BackendName

if TYPE_CHECKING:
    from collections.abc import Callable

    from surveilnav.client import Client

#: Progress and mistakes go to standard error, results to standard output.
console = Terminal(stderr=True, highlight=False)
results = Terminal(highlight=False)


class OnOff(StrEnum):
    on = "on"
    off = "off"


AsJson = Annotated[
    bool,
    typer.Option(
        "--json", help='Print one JSON object on stdout ({"error": ...} if it fails), and everything else on stderr.'
    ),
]
#: What a building may be, in the help of whatever takes one.
BUILDING_KINDS = (
    "a name of `surveilnav buildings` (an example home, office_7, flats_7, parametric_flat, ...), or the path of a .sh3d file, "
    "a Home.xml, a .glb, an .obj or a folder of HM3D"
)
Building = Annotated[str, typer.Option(metavar="NAME", help=f"Which building: {BUILDING_KINDS}.")]
Seed = Annotated[
    int, typer.Option(min=0, metavar="N", help="Chooses furniture models, textures, start and sensor noise.")
]
Cameras = Annotated[
    int | None,
    typer.Option(min=0, max=10_000, metavar="N", help="Number of cameras in the building (4 if no area is given)."),
]
Area = Annotated[
    float | None, typer.Option(min=1.0, metavar="M2", help="Place one camera for this many square metres of floor.")
]
Everywhere = Annotated[
    bool, typer.Option("--cameras-everywhere", help="Place cameras also on floors that robots can't reach.")
]
Perception = Annotated[
    BackendName,
    typer.Option(
        metavar="NAME",
        help=f"Perception backend: {', '.join(BackendName)}; auto takes the best that can run here.",
    ),
]
Record = Annotated[OnOff, typer.Option(help="Whether each mission is recorded to a file, for `replay`.")]
Surveillance = Annotated[OnOff, typer.Option(help="Whether cameras take part.")]
MaxSteps = Annotated[int, typer.Option(min=1, max=5000, metavar="N", help="Give up after this many actions.")]
DEFAULT_CAMERAS = 4

DEFAULT_URL = "http://127.0.0.1:8080"
Url = Annotated[str, typer.Option(envvar="SURVEILNAV_URL", metavar="URL", help="Address of the gateway.")]


def density(cameras: int | None, area_per_camera_m2: float | None, everywhere: bool) -> dict[str, Any]:
    """The camera plan's settings: a number, else an area, else four cameras."""
    if cameras is None and area_per_camera_m2 is None:
        cameras = DEFAULT_CAMERAS
    return {"cameras": cameras, "area_per_camera_m2": area_per_camera_m2 or 100.0, "cameras_everywhere": everywhere}


def gateway(url: str) -> Client:
    """The client; imported where it is needed, as all that takes its time."""
    from surveilnav.client import Client

    return Client(url)


def print_json(value: Any) -> None:
    """What a program reads: one line on standard output. Resources of the gateway are printed as the gateway sends them."""
    print(json.dumps(value, default=lambda resource: resource.model_dump(mode="json")))


def print_result(value: Any, as_json: bool, show: Callable[[], object]) -> None:
    """Prints a result: as JSON for programs, else as ``show`` does for people."""
    if as_json:
        print_json(value)
    else:
        show()


def items(rows: list[Any]) -> dict[str, Any]:
    """A list as every command and the gateway have it."""
    return {"items": rows, "total": len(rows)}


def only_before_nothing(ctx: typer.Context) -> None:
    """A group's own options are for its list: before a command they would be lost, so they are refused."""
    for name in ctx.params:
        source = ctx.get_parameter_source(name)
        if ctx.invoked_subcommand and source is not None and source.name == "COMMANDLINE":
            option = "--json" if name == "as_json" else f"--{name}"
            raise typer.BadParameter(f"{option} goes behind `{ctx.info_name} {ctx.invoked_subcommand}`")
