"""The dashboard and the alerts name metrics that exist."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from prometheus_client import generate_latest

from surveilnav.rest import Traffic
from surveilnav.services.gateway.core.metrics import BuildingMetrics

ROOT = Path(__file__).parents[4]
DASHBOARD = json.loads((ROOT / "docs/operate/grafana/surveilnav.json").read_text(encoding="utf-8"))
EXPRESSIONS = [(p["title"], t["expr"], t["legendFormat"]) for p in DASHBOARD["panels"] for t in p["targets"]]
ALERTS = re.findall(r"\| `(.*surveilnav_.*)` \|", (ROOT / "docs/operate/prometheus.md").read_text(encoding="utf-8"))


NOTHING = BuildingMetrics(
    cameras=[],
    floors=[],
    robots=[],
    missions=[],
    processes=[],
    workers={},
    recorders=[],
    ready=False,
    event_streams=0,
    events=0,
    traffic=Traffic(offered_bytes=0, delivered_bytes=0, wire_sent_bytes=None, nodes=[], cameras=[], robots=[]),
)
#: Type by name; a building without anything tells of all families.
KNOWN = dict(re.findall(r"^# TYPE (\S+) (\w+)$", generate_latest(NOTHING).decode(), re.MULTILINE))


def names(expression: str) -> set[str]:
    return {n.removesuffix("_bucket") for n in re.findall(r"surveilnav_[a-z_]+", expression)}


def test_there_are_metrics_to_compare_with():
    assert len(KNOWN) > 30
    assert {
        "surveilnav_camera_offered_bytes_total",
        "surveilnav_ready",
        "surveilnav_node_wire_sent_bytes_total",
    } <= set(KNOWN)
    assert len(EXPRESSIONS) > 25
    assert len(ALERTS) == 7


@pytest.mark.parametrize(
    "expression", [e for _, e, _ in EXPRESSIONS] + ALERTS, ids=[t for t, _, _ in EXPRESSIONS] + ALERTS
)
def test_every_metric_that_is_named_exists(expression):
    assert names(expression)
    assert names(expression) <= set(KNOWN)
    counted = {n for n in names(expression) if KNOWN[n] in ("counter", "histogram")}
    assert all(re.search(rf"(rate|increase)\({n}(_bucket)?\[", expression) for n in counted), (
        "a counter is shown by its rate"
    )


def test_prometheus_is_given_the_alerts_of_the_documentation():
    rules = yaml.safe_load((ROOT / "docs/operate/prometheus/alerts.yml").read_text(encoding="utf-8"))
    assert [rule["expr"] for rule in rules["groups"][0]["rules"]] == ALERTS


def test_with_keys_prometheus_is_given_one_and_nothing_else_is_different():
    plain, secure = (
        yaml.safe_load((ROOT / f"docs/operate/prometheus/{name}.yml").read_text(encoding="utf-8"))
        for name in ("prometheus", "prometheus.secure")
    )
    assert secure["scrape_configs"][0].pop("authorization") == {"credentials_file": "/run/secrets/metrics.key"}
    assert secure == plain


def test_grafana_finds_prometheus_and_the_dashboard():
    services = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
    folder = ROOT / "docs/operate/grafana/provisioning"
    sources = yaml.safe_load((folder / "datasources/prometheus.yml").read_text(encoding="utf-8"))["datasources"]
    assert [(s["type"], s["url"], s["isDefault"]) for s in sources] == [("prometheus", "http://prometheus:9090", True)]
    assert DASHBOARD["templating"]["list"][0]["query"] == "prometheus"
    providers = yaml.safe_load((folder / "dashboards/surveilnav.yml").read_text(encoding="utf-8"))["providers"]
    mounts = [volume.split(":")[:2] for volume in services["grafana"]["volumes"]]
    assert ["./docs/operate/grafana/surveilnav.json", f"{providers[0]['options']['path']}/surveilnav.json"] in mounts
    assert ["./docs/operate/grafana/provisioning", "/etc/grafana/provisioning"] in mounts
