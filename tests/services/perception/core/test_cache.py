from __future__ import annotations

import gc
import math
import tracemalloc

import msgspec
import pytest

from surveilnav.geometry import Pinhole
from surveilnav.messages import Detection, InferReply, InferRequest, ModelIds, PayloadPart
from surveilnav.services.perception.core.cache import ByteCache, content_key, text_key
from surveilnav.services.perception.core.reply import CachedReply

ASKED = InferRequest(
    stamp_ns=1,
    source="robot/r",
    view=0,
    seq=1,
    camera=Pinhole.from_hfov(64, 48, 1.2),
    image=PayloadPart("jpeg", 3),
    depth=PayloadPart("depth-invq-zstd", 2),
    depth_range_m=(0.5, 5.0),
    prompts=["tv"],
)
MODELS = ModelIds("d", "s", "e")


def test_the_bytes_stay_bounded_and_what_was_used_last_stays() -> None:
    cache: ByteCache[int] = ByteCache(4 * 1256)
    for i in range(4):
        cache.put(bytes([i]), i, 1000)
    assert cache.get(bytes([0])) == 0
    cache.put(bytes([4]), 4, 1000)
    assert [cache.get(bytes([i])) for i in range(5)] == [0, None, 2, 3, 4]
    for i in range(1000):
        cache.put(i.to_bytes(4, "big"), i, 700)
        assert sum(cache.get(k.to_bytes(4, "big")) is not None for k in range(i + 1)) <= 4 * 1256 // (700 + 256)


def test_a_value_put_again_counts_once_and_a_large_one_is_not_kept() -> None:
    cache: ByteCache[str] = ByteCache(2000)
    cache.put(b"older", "v", 100)
    for _ in range(50):
        cache.put(b"k", "v", 100)
    assert cache.get(b"older") == "v", "what is counted twice would have pushed it out"
    cache.put(b"large", "v", 5000)
    assert cache.get(b"large") is None
    assert cache.get(b"k") == "v"


def reply_with_masks(n: int) -> CachedReply:
    """Five things whose masks have 2000 runs each; no two of ``n`` are the same."""
    runs = [300 + (n + i) % 5000 for i in range(2000)]
    things = [Detection("chair", 0.9, (0.0, 0.0, 9.0, 9.0), bytes(1024), [*runs]) for _ in range(5)]
    reply = InferReply(
        stamp_ns=1, worker="w", backend="b", source="s", view=0, seq=n, detections=things, image_embedding=bytes(1024)
    )
    return CachedReply(reply, bytes(2048))


def test_what_answers_take_in_memory_is_what_may_be_kept_of_them() -> None:
    max_bytes = 1 << 20
    cache: ByteCache[bytes] = ByteCache(max_bytes)
    tracemalloc.start()
    try:
        for n in range(60):
            data = reply_with_masks(n).to_bytes()
            cache.put(bytes([n]), data, len(data))
        gc.collect()
        taken = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert max_bytes / 2 < taken < 1.05 * max_bytes
    last = cache.get(bytes([59]))
    assert last is not None
    assert CachedReply.from_bytes(last) == reply_with_masks(59)
    assert cache.get(bytes([0])) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"prompts": ["tv", "bed"]},
        {"detects": False},
        {"depth_range_m": (0.5, 6.0)},
        {"camera": Pinhole.from_hfov(64, 48, math.radians(80))},
        {"image": PayloadPart("jpeg", 2), "depth": PayloadPart("depth-invq-zstd", 3)},
    ],
)
def test_all_that_an_answer_depends_on_is_in_its_key(changes: dict[str, object]) -> None:
    other = msgspec.structs.replace(ASKED, **changes)
    assert content_key(other, b"abcde", MODELS) != content_key(ASKED, b"abcde", MODELS)


def test_pictures_and_models_are_in_the_key_and_who_asks_is_not() -> None:
    key = content_key(ASKED, b"abcde", MODELS)
    assert content_key(ASKED, b"abcdf", MODELS) != key
    assert content_key(ASKED, b"abcde", ModelIds("d", "s", "f")) != key
    again = msgspec.structs.replace(ASKED, source="camera/c", view=3, seq=9, stamp_ns=5, asker="x", deadline_ms=1)
    assert content_key(again, b"abcde", MODELS) == key
    assert text_key("tv") != text_key("tv ")
