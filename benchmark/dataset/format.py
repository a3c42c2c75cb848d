"""The files of a dataset: episodes as Habitat's ObjectNav reads them, what Habitat doesn't know beside them.

    <root>/dataset.json                     what this is: version, rules, counts, hashes of the files
    <root>/<split>/<split>.json.gz          Habitat: categories; its episodes lie in content/
    <root>/<split>/content/<scene>.json.gz  Habitat: episodes and goals of a scene
    <root>/<split>/scenes/<scene>.json      ours: how to open a scene, its floors
    <root>/<split>/cameras/<scene>.json.gz  ours: the surveillance cameras, by density

Habitat makes its objects of the JSON's fields by keyword, so a field that it doesn't know is an error there
(habitat-lab ``ObjectNavDatasetV1.from_json``): what is ours must stay in files of its own. Positions in Habitat's files
are in its frame (``axes``); in ours they are in the world frame, metres, z up.
"""

from __future__ import annotations

import gzip
import hashlib
import zlib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from surveilnav.camera_plan import PlannedCamera
from surveilnav.errors import ConfigError
from surveilnav.geometry import Pinhole
from surveilnav.storage import atomic_write

#: Grows when a file's meaning changes: the runner reads no other.
VERSION = 2

#: HM3D's names of the six categories, in its order (they are the task's ids).
CATEGORIES: dict[str, str] = {
    "chair": "chair",
    "bed": "bed",
    "plant": "potted plant",
    "toilet": "toilet",
    "tv_monitor": "tv",
    "sofa": "couch",
}
HABITAT_NAME = {ours: theirs for theirs, ours in CATEGORIES.items()}

_T = TypeVar("_T")


# --- Habitat's ----------------------------------------------------------------------------------------------------


class EpisodeInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    geodesic_distance: float
    euclidean_distance: float
    closest_goal_object_id: str


class HabitatEpisode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``ObjectGoalNavEpisode``."""

    episode_id: str
    scene_id: str
    scene_dataset_config: str = "default"
    additional_obj_config_paths: list[str] = []
    start_position: list[float]
    start_rotation: list[float]
    info: EpisodeInfo
    goals: list[Any] = []
    start_room: str | None = None
    shortest_paths: list[Any] | None = None
    object_category: str


class AgentState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    position: list[float]
    rotation: list[float]


class ViewPoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``ObjectViewLocation``; ``iou`` isn't measured."""

    agent_state: AgentState
    iou: float | None = None


class HabitatGoal(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``ObjectGoal``. ``object_id`` is the instance's number in our scene."""

    position: list[float]
    radius: float | None = None
    object_id: str
    object_name: str
    object_name_id: int | None = None
    object_category: str
    room_id: str | None = None
    room_name: str | None = None
    view_points: list[ViewPoint]


class HabitatFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``<split>.json.gz`` (without episodes) and the files in ``content/``."""

    episodes: list[HabitatEpisode] = []
    goals_by_category: dict[str, list[HabitatGoal]] = {}
    category_to_task_category_id: dict[str, int]
    category_to_scene_annotation_category_id: dict[str, int]


def goals_key(scene: str, category: str) -> str:
    """Under which Habitat looks for an episode's goals: base name of ``scene_id``, category."""
    return f"{scene}.glb_{category}"


def category_of(key: str) -> str:
    """The category in a ``goals_key``."""
    return key.rpartition(".glb_")[2]


# --- ours ---------------------------------------------------------------------------------------------------------


class SceneFloor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``cameras``: how many by density in m2 a camera ("100", "200")."""

    id: str
    z_m: float
    area_m2: float
    cameras: dict[str, int]


class SceneRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How to open a scene: ``open_building(building, seed=seed, models=models)``; the hash tells if it came out the same.

    ``target_models``: by our label, the furniture models that the goals are made of.
    """

    scene: str
    building: str
    seed: int
    models: str
    content_hash: str
    floors: list[SceneFloor]
    target_models: dict[str, list[str]]
    notes: list[str] = []


class SceneCameras(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The cameras of a scene by density; ``views`` are T_world_camera, ``half`` the views of the paper's half range.

    ``view_bytes``: by density and camera, what each view takes on the bus (JPEG of quality 85, packed depth), in flat
    light.
    """

    scene: str
    mounting_offset_m: float
    intrinsics: Pinhole
    cameras: dict[str, list[PlannedCamera]]
    view_bytes: dict[str, dict[str, list[int]]]


class SplitCounts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    scenes: int
    floors: int
    cameras: int
    episodes: int


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``sha256``: of every other file, uncompressed, by its path within the dataset."""

    version: int
    made_by: str
    rules: dict[str, str]
    splits: dict[str, SplitCounts]
    sha256: dict[str, str]


# --- reading and writing ------------------------------------------------------------------------------------------


def write(path: Path, value: Any) -> str:
    """Writes JSON (gzip if the name says so), the same bytes for the same value; returns its SHA-256 uncompressed."""
    data = msgspec.json.format(
        msgspec.json.encode(value, order="deterministic"), indent=0 if path.suffix == ".gz" else 2
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as file:
        file.write(gzip.compress(data, mtime=0) if path.suffix == ".gz" else data)
    return hashlib.sha256(data).hexdigest()


def raw(path: Path) -> bytes:
    """A file's JSON.

    Raises:
        ConfigError: not there, or damaged.
    """
    try:
        data = path.read_bytes()
        return gzip.decompress(data) if path.suffix == ".gz" else data
    except FileNotFoundError:
        raise ConfigError(f"{path} is missing; build the dataset with `surveilnav dataset build`") from None
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise ConfigError(f"{path} can't be read ({error}); build the dataset anew") from error


def sha256_of(path: Path) -> str:
    """The hash of a file's JSON, uncompressed. ConfigError: as ``raw``."""
    return hashlib.sha256(raw(path)).hexdigest()


def read(path: Path, kind: type[_T]) -> _T:
    """A file of a dataset.

    Raises:
        ConfigError: not there, damaged, or not of this format; the message names the file and the field.
    """
    try:
        return msgspec.json.decode(raw(path), type=kind)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: {error}; it isn't of this version's format: build the dataset anew") from error


def manifest_of(root: Path) -> Manifest:
    """ConfigError: no dataset there, or one of another version."""
    path = root / "dataset.json"
    try:
        version = msgspec.json.decode(raw(path)).get("version")
    except (msgspec.DecodeError, AttributeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is damaged ({error}); build the dataset anew") from error
    if version != VERSION:
        raise ConfigError(f"{path} is of version {version!r}, this program reads {VERSION}: build the dataset anew")
    return read(path, Manifest)
