"""Targets that read files: damaged ones, and ones whose values are at the boundaries of what they may be."""

from __future__ import annotations

import gzip
import io
import json
import re
import shutil
import sqlite3
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from random import Random
from typing import Any

import cv2
import msgspec
import numpy as np

import surveilnav.perception
from surveilnav import contract
from surveilnav import messages as m
from surveilnav.benchmark.dataset import format as dataset
from surveilnav.bus import clock_ns
from surveilnav.bus.router import _secured
from surveilnav.bus.tls import TlsFiles
from surveilnav.camera_pose import load_clicks, load_floor_plan
from surveilnav.camera_pose.tag.sightings import load_sightings
from surveilnav.cameras_file import load_cameras
from surveilnav.cameras_file.views import views_of
from surveilnav.client.npy import array_of, rows_of
from surveilnav.perception.models.card import NAME as CARD_NAME
from surveilnav.perception.models.card import card_of
from surveilnav.perception.models.hashes import LOCK_NAME, read_lock
from surveilnav.security.api_keys import ApiKeysFile
from surveilnav.security.certificates import make_authority, read_certificate, read_key
from surveilnav.security.folder import ACCESS, CA, CERTIFICATE, KEY, SecurityFolder
from surveilnav.security.identities import identity_from_name
from surveilnav.security.roles import Role
from surveilnav.services.camera_node.zones import read_zones
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.core import snapshot as snapshots
from surveilnav.services.fusion.map_log.store import Entry, StoreError
from surveilnav.services.fusion.map_log.store import Store as MapStore
from surveilnav.services.planner.store import Store as MissionStore
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.foxglove import FoxgloveConverter
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.reading import cameras_of_complete, target_of
from surveilnav.services.recorder.recorded import read_recording
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from surveilnav.simulator.archive import Archive
from surveilnav.simulator.furniture.catalog import read_catalog
from surveilnav.simulator.furniture.objfile import read_mtl, read_obj
from surveilnav.simulator.meshes.gltf import read_glb
from surveilnav.simulator.plans.sweethome import read_home
from surveilnav.storage import read_parts, write_parts
from tests.fuzz.maps import Fusion, fill, plain, reply_to, view_message
from tests.fuzz.node import FedNode, received_of
from tests.fuzz.target import Target
from tests.fuzz.values import Values

CAMERAS = b"""building: hq
floors:
  ground: {z_m: 0.0, rooms: {hall: [[0, 0], [4, 0], [4, 3]]}}
cameras:
  - name: lobby
    floor: ground
    stream: rtsp://viewer:${LOBBY_PASSWORD}@10.0.0.5/stream1
    position_m: [2.0, 1.5, 2.6]
    yaw_deg: 90
    pitch_deg: -30
    lens: {width_px: 192, height_px: 108, hfov_deg: 96, distortion: [-0.2, 0.05, 0, 0]}
    zones:
      - [[0, 0], [0.2, 0], [0.2, 0.3]]
  - name: corridor
    floor: ground
    stream: http://10.0.0.6/snapshot.jpg
    position_m: [0, 0, 2.9]
    yaw_deg: 0
    pitch_deg: -90
    views: around
    lens: {model: fisheye, width_px: 204, height_px: 204, hfov_deg: 180}
"""
PLAN = (
    b"image: map.png\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
)
CLICKS = b"camera: lobby\nplan: map.yaml\npoints:\n  - {px: [100, 200], plan_px: [9, 30]}\n  - px: [3.5, 4]\n    xy_m: [2, 3]\n"
SIGHTINGS = b"""tag: {id: 3, size_m: 0.16, height_m: 0.5}
stops:
  - {robot: r1, xy_m: [1.0, 2.0], yaw_deg: 30, floor: ground, seen: {lobby: [[1, 2], [3, 2], [3, 4], [1, 4]]}}
"""
ZONES = b"cameras:\n  lobby:\n    0:\n      - [[0.2, 0.2], [0.6, 0.2], [0.6, 0.6]]\n    all:\n      - [[0, 0], [1, 0], [1, 1]]\n"
OBJ = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\ng wood\nusemtl w\nf 1/1 2/2 3/1 4\nf 1 2 3\n"
MTL = b"newmtl w\nKd 0.2 0.3 0.4\nd 0.5\nmap_Kd a.png\n"
CATALOG = b"id#1=sofa\nname#1=Sofa\nmodel#1=/sofa.obj\nwidth#1=180\ndepth#1=90\nheight#1=80\nmodelRotation#1=1 0 0 0 1 0 0 0 1\n"
HOME = b"""<?xml version='1.0'?>
<home version='5300' name='h' wallHeight='250'>
  <level id='l0' name='0' elevation='0' floorThickness='12' height='250' elevationIndex='0'/>
  <wall id='w0' level='l0' xStart='0' yStart='0' xEnd='400' yEnd='0' height='250' thickness='10'/>
  <room id='r0' level='l0' name='hall'><point x='0' y='0'/><point x='400' y='0'/><point x='400' y='300'/></room>
  <pieceOfFurniture id='p' level='l0' catalogId='a#b' name='sofa' model='m/s.obj' x='100' y='100' width='180' depth='90'
   height='80' angle='0.5' modelRotation='1 0 0 0 1 0 0 0 1'/>
</home>
"""
_LOCK = b'{"yolox": {"source": "hub", "revision": "1", "sha256": {"a.onnx": "00ff"}}}'
#: Larger texts aren't varied further: YAML in Python reads a megabyte a minute.
_MAX_TEXT_BYTES = 6_000
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_ODD_TOKENS = (
    b"nan",
    b"NaN",
    b"inf",
    b"-1",
    b"0",
    b"1e308",
    b"9" * 30,
    b"9" * 5000,
    b"-9223372036854775808",
    b"true",
    b"null",
    b"~",
    b"[]",
    b"{}",
    b"''",
    b"\xff\xfe",
    b"[" * 1100,
    b"!!python/object:os.system x",
    b"&a [*a]",
    b"2026-02-30",
    b"\xef\xbf\xbf",
    b"0x7f",
    b"1_000",
    b"12:30:45",
)


def varied_text(values: Values, data: bytes) -> bytes:
    """A text some of whose numbers, words and lines are others."""
    random = values.random
    for _ in range(random.choice((0, 1, 1, 2, 4))):
        if len(data) > _MAX_TEXT_BYTES:
            break
        kind = random.randrange(5)
        if kind <= 1 and (numbers := list(_NUMBER.finditer(data))):
            found = random.choice(numbers)
            data = data[: found.start()] + random.choice(_ODD_TOKENS) + data[found.end() :]
        elif kind == 2:
            lines = data.splitlines(keepends=True)
            at = random.randrange(len(lines)) if lines else 0
            lines[at : at + 1] = random.choice(([], lines[at : at + 1] * 2, lines[at : at + 1] * 8, [b"\n"]))
            data = b"".join(lines)
        elif kind == 3 and (words := list(re.finditer(rb"[A-Za-z_]+", data))):
            found = random.choice(words)
            data = data[: found.start()] + random.choice(_ODD_TOKENS) + data[found.end() :]
        else:
            data = values.bytes_like(data)
    return data


def varied_json(values: Values, value: Any) -> Any:
    """A JSON value some of whose parts are others."""
    if values.random.random() < 0.04:
        odd = (None, True, -1, 0, 2**63, 1e308, float("nan"), "", "x" * 500, [], {}, [[]], -1e-9, "../../x", 10**30)
        return values.random.choice(odd)
    if isinstance(value, dict):
        return {k: varied_json(values, v) for k, v in value.items() if values.random.random() > 0.01}
    if isinstance(value, list):
        return [varied_json(values, v) for v in value] * (300 if values.random.random() < 0.002 else 1)
    return value


class FileTarget(Target):
    """Reads a damaged copy of a good file. ``read`` gets the path of the copy."""

    def __init__(
        self,
        name: str,
        data: bytes,
        read: Callable[[Path], Any],
        *,
        file: str = "file",
        vary: Callable[[Values, bytes], bytes] = varied_text,
        documented: tuple[type[Exception], ...] = (),
        folder: Path | None = None,
        share: int = 3,
    ) -> None:
        self.name, self.documented, self.share = f"file: {name}", documented, share  # type: ignore[misc]
        self._data, self._read, self._vary = data, read, vary
        self._path = (folder or new_folder()) / file
        self._path.parent.mkdir(parents=True, exist_ok=True)
        read(self._written(data))  # the good one can be read

    def _written(self, data: bytes) -> Path:
        self._path.write_bytes(data)
        self._path.chmod(0o600)
        return self._path

    def input(self, values: Values) -> bytes:
        return self._vary(values, self._data)

    def process(self, data: Any, values: Values) -> None:
        self._read(self._written(data))


def new_folder() -> Path:
    """A folder in memory, where there is room."""
    shared = Path("/dev/shm")
    return Path(tempfile.mkdtemp(prefix="surveilnav-fuzz-", dir=shared if shared.is_dir() else None))


def flipped(values: Values, data: bytes) -> bytes:
    """The bytes, damaged in any case."""
    values.odd = 1.0
    return values.bytes_like(data)


def json_of(values: Values, data: bytes) -> bytes:
    if values.random.random() < 0.2:
        return varied_text(values, data)
    return json.dumps(varied_json(values, json.loads(data))).encode()


def repacked(inner: Callable[[Values, bytes], bytes]) -> Callable[[Values, bytes], bytes]:
    """Damages what is inside a gzip file, so that its checksum is right."""

    def vary(values: Values, data: bytes) -> bytes:
        if values.random.random() < 0.2:
            return flipped(values, data)
        return gzip.compress(inner(values, gzip.decompress(data)), 1)

    return vary


def file_targets() -> list[Target]:
    """A new instance of each."""
    return [*_settings_files(), *_stored_files(), *_building_files(), *_security_files(), Recordings(), Snapshots()]


def _settings_files() -> list[Target]:
    plans = new_folder()
    cv2.imwrite(str(plans / "map.png"), np.full((40, 60), 254, np.uint8))
    (plans / "map.yaml").write_bytes(PLAN)

    def cameras(path: Path) -> None:
        for entry in load_cameras(path).cameras.values():
            with suppress(ValueError):  # a lens that sees nothing, says its documentation
                views_of(entry)

    return [
        FileTarget("cameras.yaml", CAMERAS, cameras, share=1),
        FileTarget("floor plan", PLAN, load_floor_plan, folder=plans, file="plan.yaml", share=1),
        FileTarget("clicks", CLICKS, load_clicks, folder=plans, file="clicks.yaml", share=1),
        FileTarget("sightings of the tag", SIGHTINGS, load_sightings, share=1),
        FileTarget("mask zones", ZONES, lambda path: read_zones(path, "lobby", 1), share=1),
    ]


def _stored_files() -> list[Target]:
    def parts(path: Path) -> Any:
        return read_parts(path, b"fuzz")

    example = new_folder() / "parts"
    write_parts(example, b"fuzz", [b"one", b"two" * 100])
    halted = new_folder()
    HaltSwitch(str(halted / "robot.state")).set(True, "stop")
    halt = (halted / "robot.state.halted").read_bytes()
    weights = next(Path(surveilnav.perception.__file__).parent.glob("data/compact/*.onnx"))
    card = weights.with_name(CARD_NAME).read_bytes()
    npy = io.BytesIO()
    np.save(npy, np.arange(12, dtype=np.float32).reshape(3, 4))
    return [
        FileTarget("stored parts", example.read_bytes(), parts, vary=flipped),
        FileTarget(
            "halt of a robot", halt, lambda p: HaltSwitch(str(p)[: -len(".halted")]), file="r.halted", vary=flipped
        ),
        FileTarget(
            "card of a model", card, lambda path: card_of(path.with_suffix(".onnx")), file=CARD_NAME, vary=json_of
        ),
        FileTarget("lock of models", _LOCK, lambda path: read_lock(path.parent), file=LOCK_NAME, vary=json_of),
        FileTarget("array of the client", npy.getvalue(), _read_npy, documented=(ValueError,)),
        MissionStores(),
        MapStores(),
        *_dataset_files(),
    ]


def _read_npy(path: Path) -> None:
    data = path.read_bytes()
    array_of(data)
    rows_of(data)


def _dataset_files() -> list[Target]:
    kinds = {"scene": dataset.SceneRecord, "content": dataset.HabitatFile, "cameras": dataset.SceneCameras}
    targets: list[Target] = []
    for name, kind in kinds.items():
        values = Values(Random(3))
        values.odd = 0.0
        data = gzip.compress(json.dumps(values.of(kind)).encode())
        read = lambda path, kind=kind: dataset.read(path, kind)  # noqa: E731
        targets.append(FileTarget(f"dataset, {name}", data, read, file="a.json.gz", vary=repacked(json_of)))
    manifest = json.dumps({"version": 1}).encode()

    def read_manifest(path: Path) -> None:
        try:
            dataset.manifest_of(path.parent)
        except dataset.ConfigError:
            return

    return [*targets, FileTarget("dataset, manifest", manifest, read_manifest, file="dataset.json", vary=json_of)]


def _building_files() -> list[Target]:
    return [
        FileTarget("plan of a home", HOME, lambda path: read_home(path.read_bytes(), "h")),
        FileTarget("model", OBJ, lambda path: read_obj(path.read_bytes())),
        FileTarget("materials", MTL, lambda path: read_mtl(path.read_bytes())),
        FileTarget("catalogue of furniture", CATALOG, lambda path: read_catalog(path.read_bytes(), "l")),
        FileTarget("mesh", _glb(), read_glb, file="a.glb", vary=_varied_glb),
        FileTarget("home", _zipped(HOME), _open_home, file="a.sh3d", vary=_varied_zip),
    ]


def _open_home(path: Path) -> None:
    archive = Archive(path)
    try:
        data = archive.read("Home.xml")
        if data is not None:
            read_home(data, "h")
    finally:
        archive.close()


def _zipped(xml: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Home.xml", xml)
    return out.getvalue()


def _varied_zip(values: Values, data: bytes) -> bytes:
    return flipped(values, data) if values.random.random() < 0.5 else _zipped(varied_text(values, HOME))


def _glb_of(header: Any, blob: bytes) -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(blob).to_bytes(4, "little") + b"BIN\0" + blob
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks


_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], np.float32).tobytes()
_FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16).tobytes()
_MESH: dict[str, Any] = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0, "name": "hall", "translation": [0, 0, 0], "scale": [1, 1, 1]}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
    ],
    "bufferViews": [
        {"buffer": 0, "byteOffset": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 12},
    ],
    "buffers": [{"byteLength": 60}],
}


def _glb() -> bytes:
    return _glb_of(_MESH, _CORNERS + _FACES)


def _varied_glb(values: Values, data: bytes) -> bytes:
    if values.random.random() < 0.2:
        return flipped(values, data)
    return _glb_of(varied_json(values, _MESH), values.bytes_like(_CORNERS + _FACES))


def _security_files() -> list[Target]:
    folder = new_folder() / "security"
    keys = ApiKeysFile(folder.parent / "keys.json")
    keys.add("me", Role.viewer)
    names = [identity_from_name(name) for name in ("router", "fusion", "camera-c1")]
    SecurityFolder.create(folder, "b", names, ("127.0.0.1",), simulation=True)
    pair = make_authority("b", datetime.now(UTC), timedelta(days=3))
    files = {p.name: p for p in sorted(folder.rglob("*")) if p.is_file() and "router" not in p.parts}
    targets: list[Target] = [
        FileTarget("API keys", keys.path.read_bytes(), lambda path: ApiKeysFile(path).read(), vary=json_of),
        FileTarget("certificate", pair.certificate_pem, read_certificate),
        FileTarget("key", pair.key_pem, read_key),
    ]
    for name, path in files.items():
        if path.suffix in (".json", ".json5", ".yaml"):
            vary = json_of if path.suffix == ".json" else varied_text

            def faults(_: Path) -> None:
                SecurityFolder(folder).faults()

            targets.append(
                FileTarget(
                    f"security folder, {name}", path.read_bytes(), faults, folder=path.parent, file=name, vary=vary
                )
            )
    router = SecurityFolder(folder).identity_folder("router")
    identity = TlsFiles(router / CA, router / CERTIFICATE, router / KEY)

    def rules(path: Path) -> None:
        _secured("tls/127.0.0.1:7447", identity, path)

    access = (folder / ACCESS).read_bytes()
    return [*targets, FileTarget("access rules of the router", access, rules, vary=json_of)]


class Recordings(FileTarget):
    """Recordings of missions, with views, statuses and a snapshot of maps."""

    def __init__(self) -> None:
        path = new_folder() / "a.mcap"
        recording, converter = RecordingFile(path), FoxgloveConverter()
        recording.add_metadata("mission", {"mission": "m1", "target": "tv"})
        recording.add_attachment("maps-0", "application/zstd", bytes(500), 1)
        values = Values(Random(1))
        values.odd = 0.0
        for number in range(1, 9):
            header, payload = view_message(values.random, "robot/r1", number)
            reply = msgspec.msgpack.encode(reply_to(header))
            view = m.LoggedView(
                stamp_ns=clock_ns(),
                number=number,
                newest=9,
                source="robot/r1",
                header=msgspec.msgpack.encode(header),
                reply=reply,
            )
            got = received_of(contract.VIEW_LOG, plain(view), payload)
            for message in converter.convert(BusMessage(contract.VIEW_LOG, got.key, got.message, payload, clock_ns())):
                recording.write(message)
            if number % 3 == 0:
                recording.flush()
        recording.add_metadata("end", {"number": "8"})
        recording.finish()
        super().__init__("recording", path.read_bytes(), self._read_all, file="b.mcap", vary=flipped)

    @staticmethod
    def _read_all(path: Path) -> None:
        target_of(path)
        cameras_of_complete(path)
        for _ in read_recording(path):
            pass


class Snapshots(FileTarget):
    """Snapshots of the maps: damaged ones, and ones whose checksum is right and whose contents are others."""

    def __init__(self) -> None:
        fusion = Fusion()
        fill(fusion)
        self._config: FusionConfig = fusion.maps.joint.config
        data = snapshots.dump(fusion.maps.joint)
        super().__init__(
            "snapshot of the maps", data, self._load, vary=self._varied, documented=(snapshots.SnapshotError,)
        )

    def _load(self, path: Path) -> None:
        snapshots.load(path.read_bytes(), self._config)

    def _varied(self, values: Values, data: bytes) -> bytes:
        if values.random.random() < 0.5:
            return flipped(values, data)
        return snapshots.pack(_varied_state(values, snapshots.unpack(data)))


def _varied_state(values: Values, value: Any) -> Any:
    if values.random.random() < 0.003:
        return values.random.choice((None, -1, "x", [], {}, 2**40))
    if isinstance(value, dict):
        return {k: _varied_state(values, v) for k, v in value.items() if values.random.random() > 0.001}
    if isinstance(value, list):
        return [_varied_state(values, v) for v in value]
    return value


class MapStores(FileTarget):
    """Fusion's store: its log of views, its events and its snapshots, damaged anywhere."""

    def __init__(self) -> None:
        path = new_folder() / "good.sqlite"
        store, values = MapStore(path, max_events=100), Values(Random(2))
        for number in range(1, 6):
            header, payload = view_message(values.random, "robot/r1", number)
            reply = msgspec.msgpack.encode(reply_to(header))
            store.append([Entry("robot/r1", 0, msgspec.msgpack.encode(header), payload, reply, b"digest")])
        store.close()
        read, documented = self._read_all, (StoreError,)
        super().__init__("store of maps", path.read_bytes(), read, file="a.sqlite", vary=flipped, documented=documented)

    @staticmethod
    def _read_all(path: Path) -> None:
        for left in path.parent.glob(f"{path.name}-*"):
            left.unlink()
        store = MapStore(path, max_events=100)
        try:
            list(store.log(0))
            store.removals()
            store.history("0", 1)
            for _, _, read in store.snapshots():
                read()
        finally:
            store.close()


class MissionStores(Target):
    """The planner's store of missions: a damaged file, and rows of other contents."""

    name, share = "file: store of missions", 1

    def __init__(self) -> None:
        self._folder = new_folder()
        self._node = FedNode()
        store = MissionStore(str(self._folder / "good.sqlite"), self._node)  # type: ignore[arg-type]
        store.load()
        store.close()
        self._good = (self._folder / "good.sqlite").read_bytes()

    def input(self, values: Values) -> Any:
        return flipped(values, self._good), values.of(m.MissionStatus), values.random.random() < 0.5

    def process(self, data: Any, values: Values) -> None:
        damaged, status, with_row = data
        path = self._folder / "file.sqlite"
        for left in self._folder.glob("file.sqlite*"):
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        path.write_bytes(self._good if with_row else damaged)
        if with_row:
            record = json.dumps({"status": status, "wanted_robot": "r1"})
            with sqlite3.connect(path) as rows:
                columns = [row[1] for row in rows.execute("PRAGMA table_info(missions)")]
                known = {"id": "m1", "finished": 0, "record": record, "memory": "{}"}
                named = [c for c in columns if c in known]
                marks = ",".join("?" * len(named))
                rows.execute(f"INSERT INTO missions ({','.join(named)}) VALUES ({marks})", [known[c] for c in named])
        store = MissionStore(str(path), self._node)  # type: ignore[arg-type]
        try:
            store.load()
        finally:
            store.close()
