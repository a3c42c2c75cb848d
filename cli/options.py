"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

AsJson = Annotated[
    bool,
    typer.Option("--json", help='One JSON object on stdout, {"error": ...} if it fails; everything else on stderr.'),
]
#: What a building may be, in the help of whatever takes one.
BUILDING_KINDS = (
    "a name of `surveilnav buildings` (an example home, office_7, flats_7, parametric_flat, ...), or the path of a .sh3d file, "
    "a Home.xml, a .glb, an .obj or a folder of HM3D"
)
