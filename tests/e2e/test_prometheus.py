"""A real Prometheus collects a running system's numbers, and every query of the dashboard and of the alerts is put to it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
import zenoh

from surveilnav.bus import BusSettings, Node, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import ROBOT_STATUS
from surveilnav.geometry import Pose
from surveilnav.messages import RobotStatus
from tests.e2e.kills import Up, up
from tests.waiting import until

OPERATE = Path(__file__).parents[2] / "docs/operate"
#: What a query shows only while something is wrong ends with a comparison; without it, it must have data.
_COMPARISON = re.compile(r"\s*(==|>|<)\s*[\d.e+]+$")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="no prometheus here: Debian's package has it"),
]


def dashboard_queries() -> list[str]:
    dashboard = json.loads((OPERATE / "grafana/surveilnav.json").read_text(encoding="utf-8"))
    return [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def names_of_alerts() -> set[str]:
    groups = yaml.safe_load((OPERATE / "prometheus/alerts.yml").read_text(encoding="utf-8"))["groups"]
    return {rule["alert"] for group in groups for rule in group["rules"]}


def configure(folder: Path, gateway: str) -> Path:
    """The configuration that compose.yaml mounts, for a gateway and a folder of this test."""
    text = (OPERATE / "prometheus/prometheus.yml").read_text(encoding="utf-8")
    for old, new in (
        ("gateway:8080", gateway),
        ("/etc/prometheus", str(folder)),
        ("interval: 5s", "interval: 1s"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "prometheus.yml").write_text(text, encoding="utf-8")
    shutil.copy(OPERATE / "prometheus/alerts.yml", folder)
    return folder / "prometheus.yml"


@contextmanager
def prometheus(folder: Path, gateway: str) -> Iterator[httpx.Client]:
    """Prometheus' own API."""
    address = f"127.0.0.1:{free_port()}"
    config = configure(folder, gateway)
    checked = subprocess.run(["promtool", "check", "config", config], capture_output=True, text=True, timeout=60)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    arguments = [f"--config.file={config}", f"--storage.tsdb.path={folder / 'data'}", f"--web.listen-address={address}"]
    log = folder / "log.txt"
    with log.open("wb") as out:
        process = subprocess.Popen(["prometheus", *arguments], stdout=out, stderr=out)
    try:
        with httpx.Client(base_url=f"http://{address}", timeout=30) as client:
            until(lambda: _answers(client), log.read_text, 30)
            yield client
    finally:
        process.terminate()
        process.wait(30)


def _answers(client: httpx.Client) -> bool:
    try:
        return client.get("/-/ready").status_code == 200
    except httpx.HTTPError:
        return False


def ask(client: httpx.Client, query: str) -> list[dict[str, Any]]:
    """The series of an answer."""
    answer = client.get("/api/v1/query", params={"query": query})
    assert answer.status_code == 200, f"{query}: {answer.text}"
    return list(answer.json()["data"]["result"])


def rules(client: httpx.Client) -> list[dict[str, Any]]:
    """The alerts as Prometheus has read them."""
    return [rule for group in client.get("/api/v1/rules").json()["data"]["groups"] for rule in group["rules"]]


@contextmanager
def what_a_simulated_building_lacks(system: Up) -> Iterator[Callable[[], None]]:
    """Has the gateway drop a message that it can't read, and know a robot with a battery, whenever what it yields is called."""
    pid = system.pid("gateway")
    variables = dict(line.split("=", 1) for line in Path(f"/proc/{pid}/environ").read_text().split("\0") if "=" in line)
    settings = BusSettings(router=variables["SURVEILNAV_BUS__ROUTER"], building=variables["SURVEILNAV_BUS__BUILDING"])
    with zenoh.open(zenoh.Config.from_json5(settings.client_config())) as session:
        session.put(ROBOT_STATUS.key_for(building=settings.building, robot="nobody"), b"nonsense")
    name, here = "powered", Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with Node("robot", name, settings) as node:
        status = RobotStatus(
            stamp_ns=clock_ns(), robot=name, floor="0", seq=1, state="stopped", T_world_base=here, battery=0.1
        )
        statuses = node.publisher(ROBOT_STATUS, robot=name)
        yield lambda: statuses.put(status)


def test_every_query_of_the_dashboard_and_the_alerts_has_an_answer(tmp_path, home_cache, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    folder = tmp_path / "prometheus"
    folder.mkdir()
    with up(tmp_path / "up") as system, prometheus(folder, system.gateway.base_url.netloc.decode()) as client:
        assert system.end(system.search("tv"))["found"] is True
        with what_a_simulated_building_lacks(system) as publish:
            system.kill("recorder")
            until(lambda: len(rules(client)) > 0, "Prometheus has read no alerts", 15)
            assert {rule["name"] for rule in rules(client)} == names_of_alerts()
            asked = [*dashboard_queries(), *(rule["query"] for rule in rules(client))]
            queries = [_COMPARISON.sub("", query) for query in asked]
            assert len(queries) > 30

            def lacking() -> list[str]:
                publish()
                return [query for query in queries if not ask(client, query)]

            # A node sends its counts every second, and a rate needs two of them.
            until(lambda: not lacking(), lambda: f"no data for {lacking()}", 30)
            assert ask(client, "surveilnav_missions_found")[0]["value"][1] == "1"
            assert [s["value"][1] for s in ask(client, 'up{job="surveilnav"}')] == ["1"]
            until(lambda: {rule["health"] for rule in rules(client)} == {"ok"}, lambda: str(rules(client)), 15)
