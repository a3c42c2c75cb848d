"""The file itself: views, events and snapshots, whole or not there."""

from __future__ import annotations

import pytest

from surveilnav.messages.maps import ObjectEvent
from surveilnav.services.fusion.map_log.store import Entry, Store, StoredEvent, StoreError


def test_a_history_holds_those_of_the_objects_that_were_found_to_be_the_same(tmp_path):
    store = Store(tmp_path / "s.sqlite")

    def happened(number, object_id, absorbed=0, floor="0"):
        event = ObjectEvent(number, "robot/r", 0, number, "chair", 0.5, "merged" if absorbed else "matched")
        return StoredEvent(number, 0, floor, object_id, absorbed, event)

    events = [happened(1, 3), happened(2, 2), happened(3, 1), happened(4, 2, 3), happened(5, 7), happened(6, 1, 2)]
    store.add_events([*events, happened(7, 1, 9, floor="1"), happened(8, 9)])
    assert [e.seq for e in store.history("0", 1)] == [1, 2, 3, 4, 6]  # 2 took in 3, then 1 took in 2
    assert [e.seq for e in store.history("0", 7)] == [5]
    assert store.history("0", 8) == []
    store.close()


def test_a_write_is_whole_or_nothing(tmp_path):
    store = Store(tmp_path / "s.sqlite")
    entry = Entry("robot/r", 0, b"h", b"p")
    assert store.append([entry, entry]) == [1, 2]
    store.close()
    store._max_pages = 20
    with pytest.raises(StoreError, match="full") as refused:
        store.append([entry, Entry("robot/r", 0, b"h", bytes(200_000))])
    assert refused.value.name == "unwritable"
    assert [n for n, _ in store.log(0)] == [1, 2]
    store.close()


def test_no_older_log_lies_beside_a_file_set_aside(tmp_path):
    store = Store(tmp_path / "s.sqlite")
    store.append([Entry("robot/r", 0, b"h")])
    stale = tmp_path / "s.sqlite.corrupt-wal"
    stale.write_bytes(b"of an older file")
    assert store.set_aside("corrupt").exists()
    assert not stale.exists()
    store.close()
