from __future__ import annotations

import os
from pathlib import Path

import pytest

from surveilnav.storage import FolderCache

KIND = b"surveilnav test 1"


def cache_in(folder, max_bytes=10_000):
    return FolderCache(folder, KIND, ".kept", max_bytes)


def keys(n):
    return [f"{i:02x}{i:062x}" for i in range(n)]


def test_what_is_put_comes_back_from_any_cache_of_the_folder(tmp_path):
    (one, other) = keys(2)
    cache_in(tmp_path).put(one, [b"a", b"", b"bc"])
    assert cache_in(tmp_path).get(one) == [b"a", b"", b"bc"]
    assert cache_in(tmp_path).get(other) is None
    cache_in(tmp_path).drop(one)
    assert cache_in(tmp_path).get(one) is None
    cache_in(tmp_path).drop(one)  # again: it is gone


def test_what_is_damaged_or_of_another_kind_is_not_there(tmp_path):
    one, other = keys(2)
    cache = cache_in(tmp_path)
    cache.put(one, [b"abc"])
    cache.path_for(one).write_bytes(cache.path_for(one).read_bytes()[:-1] + b"x")
    assert cache.get(one) is None
    FolderCache(tmp_path, b"surveilnav test 2", ".kept", 1000).put(other, [b"abc"])
    assert cache.get(other) is None


def test_the_least_recently_used_goes_first(tmp_path):
    names = keys(4)
    cache_in(tmp_path).put(names[0], [bytes(100)])
    size = cache_in(tmp_path).path_for(names[0]).stat().st_size
    small = cache_in(tmp_path, int(3.7 * size))
    for age, name in enumerate(names[:3]):
        small.put(name, [bytes(100)])
        os.utime(small.path_for(name), (1000 + age, 1000 + age))
    assert small.get(names[0])  # used just now
    small.put(names[3], [bytes(100)])
    assert [small.path_for(name).exists() for name in names] == [True, False, True, True]


def test_a_full_disk_keeps_nothing_and_fails_nothing(tmp_path, monkeypatch):
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("surveilnav.storage.write_parts", full)
    cache_in(tmp_path).put(keys(1)[0], [b"abc"])
    assert cache_in(tmp_path).get(keys(1)[0]) is None


def test_a_cache_without_room_is_refused(tmp_path):
    with pytest.raises(ValueError, match="needs room"):
        cache_in(tmp_path, 0)


def test_a_folder_that_lets_nothing_go_fails_nothing(tmp_path, monkeypatch):
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    small = cache_in(tmp_path, 300)
    for name in keys(3):
        small.put(name, [bytes(100)])
    monkeypatch.setattr(Path, "unlink", refused)
    small.put(keys(4)[3], [bytes(100)])
    small.drop(keys(1)[0])


def test_what_a_killed_writer_left_goes_and_what_is_being_written_stays(tmp_path):
    small = cache_in(tmp_path, 1000)
    small.put(keys(1)[0], [b"a"])
    folder = small.path_for(keys(1)[0]).parent
    old, new = folder / ".old.part", folder / ".new.part"
    for file in (old, new):
        file.write_bytes(b"half")
    os.utime(old, (1000, 1000))
    small.put(keys(2)[1], [bytes(100)])
    assert (old.exists(), new.exists()) == (False, True)
