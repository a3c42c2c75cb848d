"""``surveilnav map``: a layer of a floor's map, into a file or drawn with characters."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surveilnav.cli.options import DEFAULT_URL, AsJson, Url, console, gateway, print_json, results

if TYPE_CHECKING:
    from surveilnav.cli.map_drawing import Drawing
    from surveilnav.client import Client
    from surveilnav.rest import Layer

#: What a file may be.
_ENDINGS = (".png", ".npy")
_LAYERS = "occupancy, explored, frontier or value"


def map_(
    layer: Annotated[str, typer.Argument(metavar="LAYER", help=f"{_LAYERS.capitalize()}.")] = "occupancy",
    floor: Annotated[str, typer.Option(metavar="ID", help="The floor; by default the lowest that is mapped.")] = "",
    target: Annotated[
        str, typer.Option(metavar="WORDS", help="Target of the layer value; by default that of the newest mission.")
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the layer to a file: .png with north up, or .npy, an array for numpy."
        ),
    ] = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Draw a floor's map in the terminal, or write one of its layers to a file.

    The drawing shows obstacles, explored floor and frontiers together; with `value` how promising each place is.
    """
    _expect_ending(out)
    with gateway(url) as asked:
        floor = floor or _first_mapped(asked)
        place = asked.layer(floor, layer, target)
        if out is not None:
            _write(out, asked, place)
        if as_json:
            print_json(place)
        elif out is not None:
            console.print(f"{out}: {place.layer} of floor {floor}, revision {place.revision}", markup=False)
        else:
            show_map(drawn(asked, place), place)


def _expect_ending(out: Path | None) -> None:
    from surveilnav.errors import ConfigError

    if out is not None and out.suffix not in _ENDINGS:
        raise ConfigError(f"--out is a file that ends with {' or '.join(_ENDINGS)}, got {str(out)!r}")


def _first_mapped(asked: Client) -> str:
    from surveilnav.errors import GatewayError

    for floor in asked.floors():
        if floor.revision is not None:
            return floor.id
    raise GatewayError("unknown_floor", "no floor is mapped yet: `surveilnav find TARGET` sends a robot, which maps it")


def _write(out: Path, asked: Client, place: Layer) -> None:
    from surveilnav.storage import atomic_write

    read = asked.layer_picture if out.suffix == ".png" else asked.layer_npy
    data = read(place.floor, place.layer, place.target)
    with atomic_write(out) as written:
        written.write(data)


def drawn(asked: Client, place: Layer, width: int | None = None) -> Drawing:
    """The map as characters, as wide as the terminal."""
    from surveilnav.cli.map_drawing import draw

    floor = place.floor
    layers = {name: asked.layer_rows(floor, name) for name in ("occupancy", "explored", "frontier")}
    if place.layer == "value":
        layers["value"] = asked.layer_rows(floor, "value", place.target)
    robots = [r for r in asked.robots() if r.floor == floor]
    cameras = [c for c in asked.cameras() if c.floor == floor]
    things = [o for o in asked.objects(floor=floor, status="confirmed") if None not in o.center_m]
    return draw(layers, place, robots, cameras, things, width or results.width, asked.areas(floor))


def show_map(drawing: Drawing, place: Layer) -> None:
    """Prints it with its legend."""
    for line in drawing.lines:
        results.print(line)
    results.print(
        f"floor {place.floor}, revision {place.revision}; north is up; a character is {drawing.column_m:.2g} m wide and "
        f"{drawing.line_m:.2g} m high",
        markup=False,
    )
    results.print(drawing.legend)
