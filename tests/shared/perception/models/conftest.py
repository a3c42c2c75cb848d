"""A bare machine, a server of files with the faults that servers have, and models small enough to make up."""

from __future__ import annotations

import hashlib
import json
import re
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from onnx import TensorProto, helper

from surveilnav.perception import models
from surveilnav.perception.models.catalogue import File


@dataclass
class Served:
    """A server's files by path, and how it serves them. ``asked``: path and headers of every request."""

    address: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    ranges: bool = True
    etag: str = '"one"'
    cut_at: list[int] = field(default_factory=list)  # the next answers end after so many bytes
    says_length: bool = True
    headers: dict[str, str] = field(default_factory=dict)
    status: int = 0
    asked: list[tuple[str, dict[str, str]]] = field(default_factory=list)

    @property
    def ranges_asked(self) -> list[str | None]:
        return [headers.get("range") for _, headers in self.asked]


class Handler(BaseHTTPRequestHandler):
    served: Served

    def do_GET(self) -> None:
        served = self.served
        headers = {name.lower(): value for name, value in self.headers.items()}
        served.asked.append((self.path, headers))
        data = served.files.get(self.path)
        if data is None or served.status:
            self.send_response(served.status or 404)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        begin = self._begin(headers)
        self._head(data, begin)
        rest = data[begin:]
        self.wfile.write(rest[: served.cut_at.pop(0)] if served.cut_at else rest)

    def _begin(self, headers: dict[str, str]) -> int:
        """Where the answer begins: what a range asks for, if the file is the one it was begun of."""
        match = re.match(r"bytes=(\d+)-", headers.get("range", ""))
        same = headers.get("if-range", self.served.etag) == self.served.etag
        return int(match[1]) if match and same and self.served.ranges else 0

    def _head(self, data: bytes, begin: int) -> None:
        if begin >= len(data):
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{len(data)}")
        elif begin:
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {begin}-{len(data) - 1}/{len(data)}")
        else:
            self.send_response(200)
        if self.served.says_length:
            self.send_header("Content-Length", str(len(data) - begin))
        if self.served.etag:
            self.send_header("ETag", self.served.etag)
        for name, value in self.served.headers.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def served() -> Iterator[Served]:
    """A server on a free port of this machine."""
    what = Served()
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Of", (Handler,), {"served": what}))
    what.address = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield what
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A machine without models; its cache."""
    for name in (
        "SURVEILNAV_MODELS_DIR",
        "SURVEILNAV_OFFLINE",
        "HF_HUB_OFFLINE",
        "HF_ENDPOINT",
        "SURVEILNAV_YOLO_WORLD",
    ):
        monkeypatch.delenv(name, raising=False)
    cache = tmp_path / "cache"
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(cache))
    return cache / "models"


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def safetensors(n: int = 1000) -> bytes:
    """A safetensors file of one tensor of ``n`` bytes."""
    table = json.dumps({"w": {"dtype": "U8", "shape": [n], "data_offsets": [0, n]}}).encode()
    return struct.pack("<Q", len(table)) + table + bytes(i % 251 for i in range(n))


DATA = bytes(range(256)) * 20
FOLDER = {
    "config.json": b'{"model_type": "clip"}',
    "preprocessor_config.json": b"{}",
    "vocab.txt": b"a\nb\n",
    "model.safetensors": safetensors(),
}


@pytest.fixture
def one_file(machine: Path, served: Served, monkeypatch: pytest.MonkeyPatch) -> Served:
    """The model ``fake``: one file whose size and hash are known."""
    add(
        monkeypatch,
        name="fake",
        kind="detector",
        family="yolox",
        licence="none",
        url=f"{served.address}/fake.onnx",
        files=(File("fake.onnx", len(DATA), sha256(DATA)),),
    )
    served.files["/fake.onnx"] = DATA
    return served


@pytest.fixture
def of_the_hub(machine: Path, served: Served, monkeypatch: pytest.MonkeyPatch) -> Served:
    """The model ``hubbed``: a folder of which nobody knows hashes. The hub says the commit ``c0ffee``."""
    monkeypatch.setenv("HF_ENDPOINT", served.address + "/")
    add(
        monkeypatch,
        name="hubbed",
        kind="embedder",
        family="clip",
        licence="none",
        repo="some/one",
        revision="main",
        files=(*map(File, FOLDER), File("merges.txt", optional=True)),
    )
    for revision in ("main", "c0ffee"):
        served.files |= {f"/some/one/resolve/{revision}/{name}": data for name, data in FOLDER.items()}
    served.headers["X-Repo-Commit"] = "c0ffee"
    return served


def add(monkeypatch: pytest.MonkeyPatch, **fields: object) -> None:
    model = models.Model(**fields)  # type: ignore[arg-type]
    monkeypatch.setitem(models.CATALOGUE, model.name, model)


@pytest.fixture(scope="session")
def network() -> bytes:
    """An ONNX file: it says again what it is told."""
    told = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 4]) for name in ("x", "y")]
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "again", told[:1], told[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)])
    model.ir_version = 8
    return bytes(model.SerializeToString())


@pytest.fixture
def folder_at() -> Callable[..., Path]:
    """``folder_at(path, **files)``: a whole model's folder there, but for the files given; None: left out."""

    def make(path: Path, **other: bytes | None) -> Path:
        path.mkdir(parents=True)
        for name, data in (FOLDER | {name.replace("__", "."): data for name, data in other.items()}).items():
            if data is not None:
                (path / name).write_bytes(data)
        return path

    return make
