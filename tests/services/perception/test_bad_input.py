"""Whatever is asked over Zenoh: an error reply by name, and the worker goes on."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import zenoh

from surveilnav.bus import BusSettings, Refused
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_TEXT, schema_of
from surveilnav.messages import InferRequest, PayloadPart
from surveilnav.perception.models import CATALOGUE
from surveilnav.words import MAX_WORDS


def jpeg(pixels: np.ndarray, *options: int) -> bytes:
    return cv2.imencode(".jpg", pixels, list(options))[1].tobytes()


def header_of(width_px: int, height_px: int, components: int = 3) -> bytes:
    """A JPEG that is a frame header of these dimensions, and nothing more."""
    sizes = height_px.to_bytes(2, "big") + width_px.to_bytes(2, "big")
    parts = b"".join(bytes([i + 1, 0x11, 0]) for i in range(components))
    length = (8 + 3 * components).to_bytes(2, "big")
    return b"\xff\xd8\xff\xc0" + length + b"\x08" + sizes + bytes([components]) + parts + b"\xff\xd9"


GOOD = jpeg(np.full((48, 64, 3), 90, np.uint8))
PICTURES = {
    "a JPEG cut in half": GOOD[: len(GOOD) // 2],
    "cut in half, with an end marker": GOOD[: len(GOOD) // 2] + b"\xff\xd9",
    "no bytes": b"",
    "no JPEG": b"\x89PNG" + bytes(400),
    "0x0 pixels": header_of(0, 0),
    "20,000x20,000 pixels": header_of(20_000, 20_000),
    "65,535x65,535 pixels": header_of(65_535, 65_535),
    "grey": jpeg(np.full((48, 64), 90, np.uint8)),
    "CMYK": header_of(64, 48, components=4),
    "progressive": jpeg(np.full((48, 64, 3), 90, np.uint8), cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "another size": jpeg(np.full((50, 64, 3), 90, np.uint8)),
}
REQUESTS = {
    "no prompt": ({"prompts": []}, "no_prompt"),
    "500 prompts": ({"prompts": [f"word {i}" for i in range(500)]}, "bad_prompt"),
    "one prompt too many": ({"prompts": [f"word {i}" for i in range(MAX_WORDS + 1)]}, "bad_prompt"),
    "10,000 characters": ({"prompts": ["x" * 10_000]}, "bad_prompt"),
    "a control character": ({"prompts": ["tv\x00"]}, "bad_prompt"),
    "a line": ({"prompts": ["a tv\x1b[2J"]}, "bad_prompt"),
    "a dot": ({"prompts": ["tv. bed"]}, "bad_prompt"),
    "an empty prompt": ({"prompts": ["tv", " "]}, "bad_prompt"),
    "a deadline now": ({"prompts": ["tv"], "deadline_ms": 0}, "too_late"),
    "a deadline in the past": ({"prompts": ["tv"], "deadline_ms": -5000}, "too_late"),
    "no camera": ({"prompts": ["tv"], "camera": None}, "bad_message"),
    "no picture": ({"prompts": ["tv"], "image": None}, "bad_message"),
    "a depth range that can't be": ({"prompts": ["tv"], "depth_range_m": (5.0, 0.5)}, "bad_message"),
    "parts that don't add up": ({"prompts": ["tv"], "image": PayloadPart("jpeg", 3)}, "bad_message"),
    "a part of less than nothing": ({"prompts": ["tv"], "image": PayloadPart("jpeg", -3)}, "bad_message"),
}
TEXTS = {
    "none": ([], "bad_message"),
    "10,000 characters": (["x" * 10_000], "bad_message"),
    "500 texts": (["tv"] * 500, "bad_message"),
    "a control character": (["tv\x07"], "bad_message"),
    "nothing to read": (["  "], "bad_message"),
    "an unknown word": (["flux capacitor"], "bad_target"),
}


@pytest.fixture
def worker(make_worker, scripted, request_of):
    """A worker with an open vocabulary; after the test it has to answer still, with nothing left over."""
    worker = make_worker(scripted(needs_prompts=True))
    yield worker
    assert worker.ask(request_of(77, prompts=["tv"])).view == 77
    assert worker.service.load().queued == 0


@pytest.mark.parametrize("name", PICTURES)
def test_pictures(name, worker, request_of):
    asked, payload = request_of(10, prompts=["tv"])
    image = PICTURES[name]
    bad = msgspec.structs.replace(asked, image=PayloadPart("jpeg", len(image)))
    with pytest.raises(Refused) as error:
        worker.ask((bad, image + payload[asked.image.n_bytes :]))
    assert error.value.name == "bad_message"


@pytest.mark.parametrize("name", REQUESTS)
def test_requests(name, worker, request_of):
    changes, expected = REQUESTS[name]
    with pytest.raises(Refused) as error:
        worker.ask(request_of(10, **changes))
    assert error.value.name == expected


def test_a_deadline_in_the_past_is_refused_even_where_the_answer_is_remembered(worker, request_of):
    worker.ask(request_of(10, prompts=["tv"]))
    with pytest.raises(Refused) as error:
        worker.ask(request_of(10, prompts=["tv"], deadline_ms=-1))
    assert error.value.name == "too_late"


@pytest.mark.parametrize("name", TEXTS)
def test_texts(name, worker):
    texts, expected = TEXTS[name]
    with pytest.raises(Refused) as error:
        worker.ask((InferRequest(stamp_ns=1, texts=texts), b""), PERCEPTION_TEXT)
    assert error.value.name == expected


@dataclass
class Size:
    """What a camera says of itself when nothing checks it."""

    width_px: int
    height_px: int
    fx_px: float = 50.0
    fy_px: float = 50.0
    cx_px: float = 1.0
    cy_px: float = 1.0


@pytest.mark.parametrize(("width_px", "height_px"), [(0, 0), (20_000, 20_000), (16_384, 16_384)])
def test_a_camera_of_such_a_size(width_px, height_px, worker, request_of, bus: BusSettings):
    """Sent by hand: no honest client can make such a message."""
    asked, payload = request_of(10, prompts=["tv"])
    fields = msgspec.to_builtins(asked) | {"camera": msgspec.to_builtins(Size(width_px, height_px))}
    key = PERCEPTION_INFER.key_for(building=bus.building, worker=worker.name)
    encoding = zenoh.Encoding("application/msgpack").with_schema(schema_of(InferRequest))
    with zenoh.open(zenoh.Config.from_json5(bus.client_config())) as session:
        worker.ask(request_of(11, prompts=["tv"]))  # it is heard
        replies = list(
            session.get(key, payload=payload, attachment=msgspec.msgpack.encode(fields), encoding=encoding, timeout=10)
        )
    (reply,) = replies
    assert reply.err is not None
    assert b"bad_message" in reply.err.payload.to_bytes()


def started(bus: BusSettings, **settings: str) -> subprocess.CompletedProcess[str]:
    env = {"SURVEILNAV_BUS__ROUTER": bus.router, "PATH": "/usr/bin:/bin", "HOME": "/tmp"}
    env |= {f"SURVEILNAV_PERCEPTION__{name.upper()}": value for name, value in settings.items() if name != "models"}
    env |= {"SURVEILNAV_MODELS_DIR": settings["models"]} if "models" in settings else {}
    return subprocess.run(
        [sys.executable, "-m", "surveilnav.services.perception"], env=env, capture_output=True, text=True, timeout=60
    )


def test_an_unknown_model_is_one_line_and_exit_1(bus: BusSettings) -> None:
    done = started(bus, backend="onnx-coco", detectors='["yolo-9000"]', download="false")
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "yolo-9000" in done.stderr
    assert "Traceback" not in done.stderr


def test_half_a_weights_file_is_one_line_and_exit_1(bus: BusSettings, tmp_path: Path) -> None:
    (tmp_path / CATALOGUE["yolox-nano"].path).write_bytes(bytes(range(256)) * 1000)
    names = {"detectors": '["yolox-nano"]', "large_detectors": '["yolox-nano"]'}
    done = started(bus, backend="onnx-coco", download="false", models=str(tmp_path), **names)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert "yolox" in done.stderr
    assert "Traceback" not in done.stderr
