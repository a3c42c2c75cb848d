"""``surveilnav robots check`` and ``robots frame``: whether a real robot says what is needed, and where its map lies."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, print_json, results

if TYPE_CHECKING:
    from surveilnav.robot_frame import FoundFrame

File = Annotated[Path, typer.Argument(metavar="FILE", help="The robot file, such as robot.yaml.")]


@needs("services")
def check(
    file: File,
    seconds: Annotated[float, typer.Option(min=1, max=120, help="How long to listen.")] = 5.0,
    as_json: AsJson = False,
) -> None:
    """Check a robot by its file: its router, topics and rates, transforms, place, and Nav2. Exit 1 if something is missing."""
    from surveilnav.cli.robot_check import check_robot
    from surveilnav.robot_file import load_robot

    checks = check_robot(load_robot(file), seconds)
    if as_json:
        print_json({"checks": [{"part": c.part, "ok": c.ok, "message": c.message} for c in checks]})
    for c in [] if as_json else checks:
        mark = "ok     " if c.ok else "problem"
        results.print(f"{mark}  {c.part}: {c.message}", soft_wrap=True, highlight=False, markup=False)
    sys.exit(0 if all(c.ok for c in checks) else 1)


@needs("services")
def frame(
    file: File,
    pair: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y=X,Y",
            help="A place in the building and the same place in the robot's map, in metres, such as 3.2,1.0=0.4,-2.1. At least "
            "two; with four or more, one that is wrong is found.",
        ),
    ] = None,
    sightings: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Sightings of the robot's tag, as `surveilnav cameras calibrate-tag` keeps them."
        ),
    ] = None,
    cameras: Annotated[
        Path, typer.Option(metavar="FILE", help="With --sightings: the cameras that saw the tag, and their poses.")
    ] = Path("cameras.yaml"),
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="The robot's map (map.yaml), which is matched with the joint map of its floor.",
        ),
    ] = None,
    building: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="With --map: match it with the map that this building file names, instead."),
    ] = None,
    url: Url = DEFAULT_URL,
    write: Annotated[bool, typer.Option("--write", help="Write T_building_map into the file.")] = False,
    as_json: AsJson = False,
) -> None:
    """Find where a robot's map lies in the building: from places known in both, from its tag in cameras, or from its map."""
    from surveilnav.cli.finding_frame import by_map, by_pairs, by_tag
    from surveilnav.robot_file import load_robot, write_frame

    if sum(map(bool, (pair, sightings, map_file))) != 1:
        raise typer.BadParameter("give exactly one of --pair (several times), --sightings and --map")
    robot = load_robot(file)
    if pair:
        found = by_pairs(pair)
    elif sightings:
        found = by_tag(robot, sightings, cameras)
    else:
        assert map_file is not None
        found = by_map(robot, map_file, building, url)
    if write:
        write_frame(file, found.T_building_map)
    _print_frame(found, file, as_json, written=write)


def _print_frame(found: FoundFrame, file: Path, as_json: bool, *, written: bool) -> None:
    import math

    T = found.T_building_map
    entry = {"x_m": round(T.x_m, 4), "y_m": round(T.y_m, 4), "yaw_deg": round(math.degrees(T.yaw_rad), 3)}
    if as_json:
        print_json(
            {
                "T_building_map": entry,
                "residual_m": found.residual_m,
                "left_out": list(found.left_out),
                "written": written,
            }
        )
        return
    results.print(found.sentence, soft_wrap=True, highlight=False, markup=False)
    text = ", ".join(f"{name}: {value:g}" for name, value in entry.items())
    say = f"written to {file}" if written else "not written (--write does)"
    results.print(f"T_building_map: {{{text}}}   {say}", soft_wrap=True, highlight=False, markup=False)
