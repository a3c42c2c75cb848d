"""Words in no list: a home in which somebody keeps a samovar is searched for it, over Zenoh and by REST."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from surveilnav.bus.router import free_port
from surveilnav.contract import MAP_REVISION, ROBOT_STATUS
from surveilnav.messages import FINISHED_STATES
from surveilnav.simulator.meshes.export import export_glb
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.goals import find_goals
from tests.waiting import until


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flat, as a file, whose refrigerator somebody calls a samovar, and the bathtub a wardrobe."""
    flat, renamed = open_building("parametric_flat"), {"Refrigerator": "Samovar", "Bathtub": "Old wardrobe"}
    pieces = tuple(replace(i, name=renamed[i.name], label="") if i.name in renamed else i for i in flat.instances)
    path = tmp_path_factory.mktemp("home") / "samovar.glb"
    export_glb(replace(flat, instances=pieces), path)
    return path


class Rest:
    """The gateway, as somebody with curl sees it."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/api/v1"

    def get(self, path: str, **query: str) -> Any:
        return httpx.get(self._url + path, params=query, timeout=30).raise_for_status().json()

    def find(self, target: str) -> dict[str, Any]:
        """The mission when it is over; submitted as soon as the planner has met the robot."""
        answer = until(lambda: a if (a := self._post(target)).is_success else None, timeout_s=30.0)
        return until(lambda: self._ended(answer.json()["id"]), timeout_s=200.0)

    def _post(self, target: str) -> httpx.Response:
        return httpx.post(f"{self._url}/missions", json={"target": target, "max_steps": 300}, timeout=30)

    def _ended(self, id: str) -> dict[str, Any] | None:
        mission = self.get(f"/missions/{id}")
        return mission if mission["state"] in FINISHED_STATES else None


def camera_bytes(s: Any) -> dict[str, int]:
    """Of pictures, by the key of each view that was sent."""
    rows = [row for c in s.building.plan.cameras for row in s.traffic("camera", c.name).rows]
    return {row.key: row.n_bytes for row in rows if "/frame/" in row.key and row.direction == "offered"}


@pytest.mark.slow
def test_a_samovar_is_found_and_then_what_else_the_pictures_show(home: Path, system: Callable[..., Any]) -> None:
    s = system(str(home), cameras=2, gateway_port=(port := free_port()))
    rest = Rest(port)
    samovar = rest.find("Samovar")
    assert (samovar["state"], samovar["found"], samovar["target"]) == ("done", True, "samovar"), samovar
    robot = s.node.ask(ROBOT_STATUS, robot="r1").message
    goals = find_goals(s.building.scene, s.building.navigation, "samovar", caster=s.building.caster)
    assert goals.field.at(robot.T_world_base.translation_m, robot.floor) < 0.3, "it stopped before it"
    # objects by text, over kept embeddings
    first, *others = rest.get("/objects", text="samovar")["items"]
    assert first["label"] == "samovar"
    assert first["relevance"] > 0.9
    assert all(o["relevance"] < 0.6 for o in others if o["label"] != "samovar")
    # words that nobody looked for before: the cameras' pictures are looked at again, and none is sent again
    until(lambda: s.node.ask(MAP_REVISION, floor=robot.floor).message.pending_views == 0, timeout_s=60.0)
    sent = camera_bytes(s)  # a camera that is invoked for the first time later sends its own
    assert sent
    for word in ("wardrobe", "bookcase"):
        assert not rest.get("/objects", label=word)["items"]
        mission = rest.find(word)
        assert (mission["state"], mission["found"]) == ("done", True), mission
        sources = {source for seen in rest.get("/objects", label=word)["items"] for source in seen["sources"]}
        assert any(source.startswith("camera/") for source in sources), f"only the robot saw a {word}"
    assert {key: n for key, n in camera_bytes(s).items() if key in sent} == sent
