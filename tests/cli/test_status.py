"""What `surveilnav status` says of nodes of another release."""

from __future__ import annotations

from rich.console import Console

from surveilnav.cli.status import everything, show_status
from surveilnav.rest import NodeTraffic, Traffic


class _Client:
    """Stands in for the client of a gateway that serves nothing but its nodes."""

    def __init__(self, *nodes: NodeTraffic) -> None:
        self._nodes = list(nodes)

    def __getattr__(self, name: str):
        return list

    def traffic(self) -> Traffic:
        return Traffic(
            offered_bytes=0, delivered_bytes=0, wire_sent_bytes=None, nodes=self._nodes, cameras=[], robots=[]
        )


def _node(id: str, **facts: object) -> NodeTraffic:
    return NodeTraffic(
        id=id,
        kind="camera",
        offered_bytes=0,
        delivered_bytes=0,
        offered_messages=0,
        delivered_messages=0,
        wire_sent_bytes=None,
        wire_received_bytes=None,
        simulation_bytes=0,
        rejected={},
        last_seen=None,
        **{"stale": False} | facts,  # type: ignore[arg-type]
    )


def test_nodes_of_another_release_are_named():
    found = everything(
        _Client(  # type: ignore[arg-type]
            _node("new", release="0.2.0"),
            _node("left-running", release="0.1.0", other_release=True),
            _node("older", other_release=True),
            _node("gone", release="0.1.0", other_release=True, stale=True),
        )
    )
    assert [n.id for n in found["other_releases"]] == ["left-running", "older"]
    console = Console(width=80, record=True)
    show_status(found, console)
    said = console.export_text()
    assert "other releases (2)" in said
    assert [line.split() for line in said.splitlines() if "camera/" in line] == [
        ["camera/left-running", "0.1.0"],
        ["camera/older", "unknown"],
    ]


def test_nothing_is_said_when_all_run_one_release():
    found = everything(_Client(_node("new", release="0.2.0")))  # type: ignore[arg-type]
    assert "other_releases" not in found
