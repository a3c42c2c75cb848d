"""The client against a gateway, and the commands that use it."""

from __future__ import annotations

import base64
import re
import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest

from surveilnav import rest
from surveilnav.bus import clock_ns
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from tests.waiting import until

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def gateway(client):
    with Client(str(client.base_url)) as gateway:
        yield gateway


def test_missions_by_the_client(gateway, building):
    mission = gateway.submit("tv", "r1", 7, queue=True, idempotency_key="by-client")
    assert gateway.submit("tv", "r1", 7, queue=True, idempotency_key="by-client").id == mission.id
    assert (building.goals[-1].queue, building.goals[-1].max_steps) == (True, 7)
    until(lambda: gateway.missions()[0].id == mission.id)
    assert gateway.plan(mission.id).why
    assert gateway.pause(mission.id, "lunch").state == "paused"
    assert gateway.resume(mission.id).state == "active"
    assert gateway.cancel(mission.id).state == "cancelled"
    with pytest.raises(GatewayError) as refused:
        gateway.submit("unicorn")
    assert refused.value.name == "bad_target"


def test_maps_and_pictures_by_the_client(gateway):
    assert gateway.layer_array("0", "value", "a & b").shape == (12, 16)
    assert gateway.layer_picture("0", "explored").startswith(b"\x89PNG")
    assert np.shape(gateway.layer("0", "explored").T_world_cell) == (3, 3)
    assert gateway.latest_picture("c1", 0).startswith(b"\xff\xd8")
    assert gateway.picture("c1", 0).startswith(b"\xff\xd8")
    assert [o.label for o in gateway.objects(label="TV", min_confidence=0.5)] == ["tv"]
    assert gateway.object("0", 1).label == "tv"
    assert 0 < len(gateway.cloud("0", 100)) <= 100
    assert gateway.object_picture("0", 1, 0).startswith(b"\xff\xd8")


def test_events_by_the_client(gateway):
    stream = gateway.events()
    assert next(stream).kind == "reset"
    mission = gateway.submit("tv")
    event = next(e for e in stream if e.kind == "mission" and e.data.id == mission.id)
    assert (event.data.what, event.data.target) == ("queued", "tv")


def test_live_states_and_tiles_by_the_client(gateway):
    stream = gateway.live()
    assert next(stream).data.why
    kinds = {}
    for event in stream:
        kinds[event.kind] = event.data.state
        if {"camera", "robot", "floor", "traffic", "object"} <= kinds.keys():
            break
    assert {type(state) for kind, state in kinds.items() if kind == "camera"} == {rest.Camera}
    assert kinds["object"].history
    tiles = gateway.tiles(["c1/3"])
    tile = next(event for event in tiles if event.kind == "tile")
    assert (tile.data.id, tile.data.state.view) == ("c1/3", 3)
    assert base64.b64decode(tile.data.state.jpeg).startswith(b"\xff\xd8")


def test_the_pages_example_runs(gateway, building, capsys):
    page = (ROOT / "docs/use/rest.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    submitted = len(building.goals)
    running = threading.Thread(target=lambda: exec(code.replace("http://127.0.0.1:8080", gateway.url), {}), daemon=True)
    running.start()
    until(lambda: len(building.goals) > submitted)

    def ends() -> bool:
        status = building.missions[building.goals[-1].mission]
        state = "active" if status.state == "done" else "done"  # again and again: when its stream begins isn't known
        building.put_status(msgspec.structs.replace(status, stamp_ns=clock_ns(), state=state, message="at the target"))
        running.join(0.1)
        return not running.is_alive()

    until(ends, "the example never ends")
    assert "done at the target" in capsys.readouterr().out
