"""``python -m surveilnav.simulator.meshes BUILDING OUT``: writes a building as OUT.glb, or as an HM3D folder OUT."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from surveilnav.errors import SurveilNavError
from surveilnav.simulator.meshes import export_glb, export_hm3d
from surveilnav.simulator.meshes.buildings import open_mesh
from surveilnav.simulator.sources import open_building


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m surveilnav.simulator.meshes", description=__doc__)
    parser.add_argument("building", help="a building's name, or a file that open_building takes")
    parser.add_argument("out", type=Path, help="NAME.glb, or a folder like 00800-NAME for HM3D's layout")
    parser.add_argument("--up", choices=("y", "z"), default="y", help="the axis that points up in a GLB or OBJ")
    parser.add_argument(
        "--scale", type=float, default=1.0, help="metres per unit of a GLB or OBJ: 0.001 for millimetres"
    )
    parser.add_argument("--seed", type=int, default=0, help="of a named building")
    args = parser.parse_args()
    try:
        if (args.up, args.scale) != ("y", 1.0):
            scene = open_mesh(Path(args.building), up=args.up, scale=args.scale)
        else:
            scene = open_building(args.building, seed=args.seed)
        (export_glb if args.out.suffix.lower() == ".glb" else export_hm3d)(scene, args.out)
    except SurveilNavError as error:
        print(error, file=sys.stderr)
        return 1
    for line in (*(f"floor {f.id} at {f.z_m:.2f} m" for f in scene.floors), *scene.notes):
        print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
