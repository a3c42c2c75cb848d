"""Today's services open the stores that an earlier release's own code has written; see tests/releases/README.md."""

from __future__ import annotations

import json
import sqlite3
import tarfile
from pathlib import Path

import numpy as np
import pytest
import structlog

from surveilnav.robot_state import RobotState
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.planner.store import SavedMission, Store
from surveilnav.services.robot_node.bodies.state_file import StateFile
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from tests.fusion_run import FakeNode

RELEASES = sorted((Path(__file__).parents[1] / "releases").glob("*.tar.xz"))


@pytest.fixture(params=RELEASES, ids=lambda path: path.name.removesuffix(".tar.xz"))
def stores(request, tmp_path) -> Path:
    """A folder with the stores of a release."""
    assert request.param.stat().st_size < 200_000
    with tarfile.open(request.param) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


class Fusion:
    """Fusion's maps on its store, started as often as wanted."""

    def __init__(self, path: Path) -> None:
        self.node, config = FakeNode(), FusionSettings(store=str(path))
        self.maps = BuildingMaps(config.core())
        self.log = MapLog(self.node, config, self.maps)

    def known(self) -> dict:
        joint = self.maps.joint
        cells = {name: int(np.count_nonzero(joint.layer("0", name)[1])) for name in ("occupancy", "explored")}
        objects = [[o.label, o.n_detections, list(o.center_m)] for o in joint.objects("0")]
        return {"revision": joint.revision, "objects": objects, **cells}


def test_fusion_has_the_maps_and_objects_of_an_earlier_release(stores):
    path, known = stores / "fusion.sqlite", json.loads((stores / "known.json").read_text())
    fusion = Fusion(path)
    now = fusion.known()
    assert now["revision"] == known["revision"]
    # Rules of later releases may weigh what was seen otherwise; what was seen is the same.
    assert now["explored"] == pytest.approx(known["explored"], rel=0.02)
    assert now["occupancy"] == pytest.approx(known["occupancy"], rel=0.1)
    assert [(label, n) for label, n, _ in now["objects"]] == [(label, n) for label, n, _ in known["objects"]]
    for (_, _, here_m), (_, _, there_m) in zip(now["objects"], known["objects"], strict=True):
        assert here_m == pytest.approx(there_m, abs=0.1)
    (record,) = fusion.maps.joint.objects("0")
    assert len(fusion.log.object_history("0", record.id)) == known["objects"][0][1]
    assert {said.partition(" ")[0] for said in fusion.node.said} <= {"snapshot_other_version", "restored"}
    assert not list(stores.glob("fusion.sqlite.*")), "nothing was set aside"
    fusion.log.integrate([])  # writes the snapshot that is due
    fusion.log.close()
    again = Fusion(path)
    assert again.known() == now
    assert again.node.said == ["restored"], "from then on it is a store of this release"
    again.log.close()


def test_maps_of_which_the_log_has_only_the_end_are_what_the_log_has_and_a_copy_is_kept(stores):
    path = stores / "fusion.sqlite"
    db = sqlite3.connect(path)
    db.execute("DELETE FROM view WHERE number <= 4")
    db.commit()
    db.close()
    fusion = Fusion(path)
    if "snapshot_other_version" not in fusion.node.said:
        pytest.skip("the snapshot itself can be read")
    assert fusion.maps.joint.revision == 6
    assert "snapshots_lost" in fusion.node.said
    assert path.with_name("fusion.sqlite.snapshots_lost").exists()
    fusion.log.integrate([])
    fusion.log.close()
    again = Fusion(path)
    assert again.maps.joint.revision == 6
    assert again.node.said == ["restored"]
    again.log.close()


def test_the_planner_has_the_missions_of_an_earlier_release(stores):
    def load() -> dict[str, SavedMission]:
        node = FakeNode()
        node.log = structlog.get_logger()
        store = Store(str(stores / "planner.sqlite"), node)
        try:
            return {saved.status.mission: saved for saved in store.load()}
        finally:
            store.close()

    for missions in (load(), load()):
        assert list(missions) == ["done", "open", "queued"]
        done, under_way, queued = missions.values()
        assert (done.status.state, done.status.found, done.status.object_id, done.status.step) == ("done", True, 3, 41)
        assert (under_way.status.state, under_way.status.step, under_way.robot_path_m) == ("active", 7, 1.25)
        assert under_way.pending is not None
        assert (under_way.pending.seq, under_way.pending.action) == (12, "move_forward")
        assert (queued.status.state, queued.wanted_robot) == ("queued", "r1")
    assert not list(stores.glob("planner.sqlite.*"))


def test_the_robot_stands_where_it_stood_and_is_still_halted(stores):
    state = StateFile(stores / "robot.state", "a building").load()
    assert state == RobotState(
        1.5, 2.5, 0.0, "0", 0.25, seq=12, steps=7, path_m=1.25, last_action="move_forward", mission="open"
    )
    halt = HaltSwitch(str(stores / "robot.state")).state
    assert (halt.halted, halt.reason) == (True, "somebody pressed stop")
