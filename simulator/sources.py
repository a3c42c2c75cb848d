"""Where buildings come from: one function opens them all."""

from __future__ import annotations

import re
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

from surveilnav.config import cache_dir as default_cache_dir
from surveilnav.errors import AssetError, BuildingError
from surveilnav.simulator.archive import MAX_MEMBER_BYTES, Archive
from surveilnav.simulator.furniture.assets import ensure_assets
from surveilnav.simulator.furniture.catalog import Furniture
from surveilnav.simulator.meshes import is_mesh, open_scan
from surveilnav.simulator.plans.homes import build_home
from surveilnav.simulator.plans.parametric_homes import parametric_flat, parametric_house
from surveilnav.simulator.plans.placing import MODELS, Models
from surveilnav.simulator.plans.sweethome import Home, read_home
from surveilnav.simulator.procedural.buildings import KINDS, generated_home, is_generated
from surveilnav.simulator.world.scene import Scene

_EXAMPLES = "com/eteks/sweethome3d/io/resources/examples"

#: Our name -> (the plan's file in the jar, what it is).
_HOMES: dict[str, tuple[str, str]] = {
    "studio": ("Studio", "one room with a kitchenette, bathroom, balcony"),
    "1_bedroom": ("1BedroomApartmentWithRoundWall", "flat, three rooms, a round wall"),
    "2_bedroom": ("2BedroomApartment", "flat, seven rooms"),
    "2_bedroom_bow_window": ("2BedroomApartmentWithBowWindow", "flat, seven rooms, a bow window"),
    "2_bedroom_basement": ("2BedroomHouseWithBasement", "house with a basement"),
    "3_bedroom": ("3BedroomApartment", "flat, eight rooms, balcony"),
    "3_bedroom_attic": ("3BedroomHouseWithAttic", "house, two floors and an attic"),
    "3_bedroom_mezzanine": ("3BedroomHouseWithMezzanine", "large house, two floors, mezzanine"),
    "4_bedroom": ("4BedroomHouse", "house, one floor"),
}

EXAMPLE_HOMES: tuple[str, ...] = tuple(_HOMES)
#: Those on which thresholds, room statistics and error models may be made; the others are for tests.
TRAIN_HOMES: tuple[str, ...] = (
    "2_bedroom",
    "2_bedroom_bow_window",
    "2_bedroom_basement",
    "3_bedroom",
    "3_bedroom_mezzanine",
    "4_bedroom",
)
#: Patterns of names: n is any number from 0, and the plan's seed.
GENERATED: tuple[str, ...] = tuple(f"{kind}_<n>" for kind in KINDS)

_PARAMETRIC = {
    "parametric_flat": (parametric_flat, "flat of 80 m², six rooms, made in code: needs no assets"),
    "parametric_house": (parametric_house, "house with two floors and a stair, made in code: needs no assets"),
}
#: Buildings made in code, which need no assets.
PARAMETRIC: tuple[str, ...] = tuple(_PARAMETRIC)


@dataclass(frozen=True, slots=True)
class BuildingInfo:
    name: str
    about: str


def list_buildings() -> tuple[BuildingInfo, ...]:
    """All buildings that can be named; any .sh3d file or Home.xml can be opened besides."""
    named = tuple(BuildingInfo(name, about) for name, (_, about) in _HOMES.items())
    generated = (BuildingInfo(f"{kind}_<n>", about) for kind, (_, about) in KINDS.items())
    return (*named, *generated, *(BuildingInfo(name, about) for name, (_, about) in _PARAMETRIC.items()))


def open_building(name_or_path: str, *, seed: int = 0, models: Models = "all", cache_dir: Path | None = None) -> Scene:
    """The building of that name, or in that file.

    The same name and seed give the same scene, to the byte. Notes for people are in ``Scene.notes``.

    Args:
        name_or_path: one of ``EXAMPLE_HOMES``, "parametric_flat", "parametric_house", or the path of a .sh3d file, a
            Home.xml, a .glb or .obj mesh, or a folder of HM3D.
        seed: chooses furniture models and floor coverings.
        models: "train" or "val" furnishes with that half of every kind's models alone (``data/furniture_kinds.json``),
            "all" with both. Buildings made of simple shapes have none, they are the same for all three.
        cache_dir: where assets and parsed models are kept; default is ``config.cache_dir()``.

    Raises:
        BuildingError: no such building, or a file that can't be read; the message says what was expected.
        AssetError: an example home, and the packages can't be had.
    """
    if models not in MODELS:
        raise BuildingError(f"models are {', '.join(MODELS)} (which half of the furniture); got {models!r}")
    name = name_or_path.strip().lower().replace("-", "_")
    if name in _PARAMETRIC:
        return _PARAMETRIC[name][0](seed)
    cache = cache_dir if cache_dir is not None else default_cache_dir()
    if is_generated(name):
        return _open_plan(generated_home(name), name, seed, cache, models)
    if name in _HOMES:
        return _open_example(name, seed, cache, models)
    scene = _open_path(name_or_path, seed, cache, models)
    if scene is not None:
        return scene
    valid = (*EXAMPLE_HOMES, *_PARAMETRIC, *GENERATED)
    near = get_close_matches(name, valid, n=1)
    raise BuildingError(
        f"there is no building {name_or_path!r}{f'; did you mean {near[0]!r}?' if near else ''} "
        f"Expected one of {', '.join(valid)}, or the path of a .sh3d file, a Home.xml, a .glb, an .obj or a folder of HM3D."
    )


def _open_example(name: str, seed: int, cache: Path, models: Models) -> Scene:
    with Furniture(ensure_assets(cache=cache), cache) as furniture:
        source = f"Sweet Home 3D example home {_HOMES[name][0]}"
        return build_home(read_example(name, furniture), name, seed, furniture, None, source, models)


def _open_path(text: str, seed: int, cache: Path, models: Models) -> Scene | None:
    """The building in a file or folder; None where the text is no path of one."""
    try:
        path = Path(text).expanduser()
        if is_mesh(path):
            return open_scan(path)
        if path.suffix.lower() in (".sh3d", ".xml") or path.exists():
            return _open_file(path, seed, cache, models)
    except (OSError, RuntimeError, ValueError) as error:  # too long, no home directory, a zero byte, no permission
        raise BuildingError(f"{text[:80]!r} can't be opened: {error}") from error
    return None


def _open_plan(home: Home, name: str, seed: int, cache: Path, models: Models) -> Scene:
    """A generated plan, with whatever furniture can be had."""
    source = f"{name}: generated, furnished by statistics of example homes"
    try:
        root = ensure_assets(cache=cache)
    except AssetError as error:
        return _with_simple_shapes(home, name, seed, None, source, models, error)
    with Furniture(root, cache) as furniture:
        return build_home(home, name, seed, furniture, None, source, models)


def _with_simple_shapes(
    home: Home, name: str, seed: int, archive: Archive | None, source: str, models: Models, error: AssetError
) -> Scene:
    note = f"furniture libraries can't be had, simple shapes stand in: {error}"
    scene = build_home(home, name, seed, None, archive, source, models)
    return replace(scene, notes=(note, *scene.notes))


def read_example(name: str, furniture: Furniture) -> Home:
    plan = f"{_EXAMPLES}/{_HOMES[name][0]}.xml"
    data = furniture.jar.read(plan)
    if data is None:
        raise AssetError(f"{furniture.jar.path} has no {plan}: a version of Sweet Home 3D that we don't know")
    return read_home(data, name)


def _open_file(path: Path, seed: int, cache: Path, models: Models) -> Scene:
    """A user's own plan, with whatever furniture can be had."""
    if not path.is_file():
        raise BuildingError(
            f"there is no file {path}; expected a .sh3d file, a Home.xml, a .glb, an .obj, a folder of HM3D, or one of "
            f"{', '.join(EXAMPLE_HOMES)}"
        )
    name = re.sub(r"[^A-Za-z0-9_.]+", "_", path.stem)[:40].strip("_.") or "home"
    source = f"Sweet Home 3D file {path.name}"
    with nullcontext() if _is_xml(path) else closing(Archive(path)) as archive:
        home = read_home(_read_limited(path) if archive is None else _plan_in(archive, path), path.name)
        try:
            furniture = Furniture(ensure_assets(cache=cache), cache)
        except AssetError as error:
            return _with_simple_shapes(home, name, seed, archive, source, models, error)
        with furniture:
            return build_home(home, name, seed, furniture, archive, source, models)


def _plan_in(archive: Archive, path: Path) -> bytes:
    """The plan of a .sh3d file: its Home.xml, or the serialized Home that versions before 5.3 wrote alone."""
    plan = archive.read("Home.xml") or archive.read("Home")
    if plan is None:
        raise BuildingError(
            f"{path} has neither a Home.xml nor a Home (before version 5.3) inside: is it a Sweet Home 3D file?"
        )
    return plan


def _is_xml(path: Path) -> bool:
    with path.open("rb") as file:
        start = file.read(64).lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n")
    return start.startswith(b"<")


def _read_limited(path: Path) -> bytes:
    if path.stat().st_size > MAX_MEMBER_BYTES:
        raise BuildingError(f"{path} is larger than {MAX_MEMBER_BYTES >> 20} MiB: refused")
    return path.read_bytes()
