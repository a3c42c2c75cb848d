"""The gateway from Python.

    with Client("http://127.0.0.1:8080") as building:
        mission = building.submit("potted plant", queue=True)
        for event in building.events():
            if event.data.id == mission.id:
                print(event.data.what)

Calls return the resources of ``surveilnav.rest``. Every failure is a ``GatewayError``: its ``name`` ends the problem's type,
and its text says what to do. Only the calls that return arrays need numpy.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import httpx

from surveilnav import rest
from surveilnav.client.connection import GatewayConnection
from surveilnav.client.events import ServerEvent
from surveilnav.client.npy import array_of, rows_of

if TYPE_CHECKING:
    from datetime import datetime

    import numpy as np
    from numpy.typing import NDArray


class Client:
    """One gateway. Thread-safe.

    Args:
        url: the gateway's address.
        timeout_s: for connecting, and between two parts of an answer.
        transport: stands in for the network in tests.
        api_key: the key to send; None: the one in ``SURVEILNAV_API_KEY``, if there is one.

    Raises:
        GatewayError: ``url`` is no address.
    """

    def __init__(
        self,
        url: str,
        timeout_s: float = 30.0,
        transport: httpx.BaseTransport | None = None,
        api_key: str | None = None,
    ) -> None:
        key = os.environ.get("SURVEILNAV_API_KEY", "").strip() if api_key is None else api_key
        self._gateway = GatewayConnection(url.rstrip("/"), timeout_s, transport, key)
        self.url = self._gateway.url

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Closes its connections."""
        self._gateway.close()

    # --- missions ---------------------------------------------------------------------------------------------------

    def submit(
        self,
        target: str,
        robot: str | None = None,
        max_steps: int = 500,
        *,
        queue: bool = False,
        idempotency_key: str | None = None,
    ) -> rest.Mission:
        """Sends a robot to find something.

        Args:
            target: what to find.
            robot: which robot; None: any free one.
            max_steps: give up after so many actions.
            queue: wait for a robot if none is free.
            idempotency_key: calls with the same key are the same mission, however often they are repeated.
        """
        goal = {"target": target, "robot": robot, "max_steps": max_steps, "queue": queue}
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        return self._gateway.one(rest.Mission, "POST", "missions", json=goal, headers=headers)

    def missions(self) -> list[rest.Mission]:
        """The newest 1,000, newest first."""
        return self._gateway.items(rest.Mission, "GET", "missions")

    def mission(self, id: str) -> rest.Mission:
        """One mission."""
        return self._gateway.one(rest.Mission, "GET", f"missions/{_id(id)}")

    def mission_traffic(self, id: str) -> rest.MissionTraffic:
        """What cameras and robots sent while a mission ran, and a forecast."""
        return self._gateway.one(rest.MissionTraffic, "GET", f"missions/{_id(id)}/traffic")

    def plan(self, id: str) -> rest.MissionPlan:
        """A mission's present plan: what was weighed, and why."""
        return self._gateway.one(rest.MissionPlan, "GET", f"missions/{_id(id)}/plan")

    def cancel(self, id: str, reason: str = "") -> rest.Mission:
        """Ends a mission; its robot stops."""
        return self._gateway.one(rest.Mission, "POST", f"missions/{_id(id)}/cancel", json={"reason": reason})

    def pause(self, id: str, reason: str = "") -> rest.Mission:
        """Has a mission's robot stay where it is."""
        return self._gateway.one(rest.Mission, "POST", f"missions/{_id(id)}/pause", json={"reason": reason})

    def resume(self, id: str) -> rest.Mission:
        """Resumes a paused mission."""
        return self._gateway.one(rest.Mission, "POST", f"missions/{_id(id)}/resume")

    # --- robots -----------------------------------------------------------------------------------------------------

    def robots(self) -> list[rest.Robot]:
        """All robots."""
        return self._gateway.items(rest.Robot, "GET", "robots")

    def stop_robots(self, reason: str = "") -> list[rest.RobotHalt]:
        """EMERGENCY STOP: all robots, at once."""
        return self._gateway.items(rest.RobotHalt, "POST", "robots/stop", json={"reason": reason})

    def release_robots(self) -> list[rest.RobotHalt]:
        """Releases all robots; nothing moves by that."""
        return self._gateway.items(rest.RobotHalt, "POST", "robots/release")

    # --- cameras ----------------------------------------------------------------------------------------------------

    def cameras(self) -> list[rest.Camera]:
        """All cameras."""
        return self._gateway.items(rest.Camera, "GET", "cameras")

    def camera(self, id: str) -> rest.Camera:
        """One camera."""
        return self._gateway.one(rest.Camera, "GET", f"cameras/{_id(id)}")

    def picture(self, id: str, view: int) -> bytes:
        """A JPEG that the camera makes for this call."""
        return self._gateway.content(f"cameras/{_id(id)}/views/{view}.jpg")

    def latest_picture(self, id: str, view: int | None = None) -> bytes:
        """A JPEG that is at most a second old, shared by all viewers; of the first view if none is named."""
        return self._gateway.content(f"cameras/{_id(id)}/latest.jpg", **_given(view=view))

    def cones(self, id: str) -> list[rest.CameraCone]:
        """The area of floor that each view shows."""
        return self._gateway.items(rest.CameraCone, "GET", f"cameras/{_id(id)}/cones")

    def access_records(self, id: str) -> list[rest.AccessRecord]:
        """Who was shown a camera's pictures, newest first."""
        return self._gateway.items(rest.AccessRecord, "GET", f"cameras/{_id(id)}/looks")

    def pause_camera(self, id: str) -> rest.Camera:
        """Has a camera show nothing."""
        return self._gateway.one(rest.Camera, "POST", f"cameras/{_id(id)}/pause")

    def resume_camera(self, id: str) -> rest.Camera:
        """Has a paused camera look again."""
        return self._gateway.one(rest.Camera, "POST", f"cameras/{_id(id)}/resume")

    def remove_camera(self, id: str) -> None:
        """Removes a camera whose process has ended from the list."""
        self._gateway.request("DELETE", f"{rest.ROOT}/cameras/{_id(id)}")

    def forget_pictures(self) -> list[rest.PictureKeeper]:
        """Has all services forget past pictures, and returns what each answered."""
        return self._gateway.items(rest.PictureKeeper, "DELETE", "pictures")

    # --- taking a source out of the maps ----------------------------------------------------------------------------

    def remove_from_maps(
        self, source: str, *, since: datetime | None = None, until: datetime | None = None
    ) -> rest.Removal:
        """Has what "camera/ID" or "robot/ID" has contributed taken out of the maps, of always or of a time span."""
        wanted = rest.NewRemoval(source=source, since=since, until=until)
        return self._gateway.one(rest.Removal, "POST", "removals", json=wanted.model_dump(mode="json"))

    def removals(self) -> list[rest.Removal]:
        """What was taken out of the maps, the newest first."""
        return self._gateway.items(rest.Removal, "GET", "removals")

    def removal(self, id: str) -> rest.Removal:
        """One of them."""
        return self._gateway.one(rest.Removal, "GET", f"removals/{_id(id)}")

    # --- maps and objects -------------------------------------------------------------------------------------------

    def buildings(self) -> list[rest.Building]:
        """The building that the gateway serves."""
        return self._gateway.items(rest.Building, "GET", "buildings")

    def floors(self) -> list[rest.Floor]:
        """Its floors."""
        return self._gateway.items(rest.Floor, "GET", "floors")

    def layer(self, floor: str, layer: str, target: str = "") -> rest.Layer:
        """Where a map layer lies in the world."""
        address = f"floors/{_id(floor)}/layers/{_id(layer)}"
        return self._gateway.one(rest.Layer, "GET", address, params=_given(target=target))

    def layer_picture(self, floor: str, layer: str, target: str = "") -> bytes:
        """A PNG of a map layer, north up."""
        return self._gateway.content(f"floors/{_id(floor)}/layers/{_id(layer)}.png", **_given(target=target))

    def layer_array(self, floor: str, layer: str, target: str = "") -> NDArray:
        """(rows, cols) of a map layer: uint8 0 or 1, or float32 with NaN where unknown; row 0 is the southernmost.

        Needs numpy; ``layer_rows`` doesn't.
        """
        return array_of(self.layer_npy(floor, layer, target))

    def layer_rows(self, floor: str, layer: str, target: str = "") -> list[memoryview]:
        """The rows of a map layer, with the values of ``layer_array``, for programs without numpy."""
        return rows_of(self.layer_npy(floor, layer, target))

    def layer_npy(self, floor: str, layer: str, target: str = "") -> bytes:
        """A map layer as a .npy file, which ``numpy.load`` reads."""
        return self._gateway.content(f"floors/{_id(floor)}/layers/{_id(layer)}.npy", **_given(target=target))

    def cloud(self, floor: str, points: int = 50_000) -> NDArray[np.float32]:
        """(N, 6): x, y, z [m, world] and red, green, blue [0-1] of at most so many points of the joint cloud."""
        return array_of(self._gateway.content(f"floors/{_id(floor)}/cloud.npy", points=points))

    def areas(self, floor: str = "") -> list[rest.Area]:
        """Keepout zones, doors and lifts, and which passages are open; with a ``floor``, those on it."""
        return self._gateway.items(rest.Area, "GET", "areas", params=_given(floor=floor))

    def objects(
        self, text: str = "", *, floor: str = "", label: str = "", status: str = "", min_confidence: float = 0.0
    ) -> list[rest.Object]:
        """The objects that the maps hold; with a ``text``, those that look most like it first."""
        params = _given(text=text, floor=floor, label=label, status=status, min_confidence=min_confidence)
        return self._gateway.items(rest.Object, "GET", "objects", params=params)

    def where(self, target: str, *, floor: str = "", max_s: float = 10.0) -> rest.Sightings:
        """Where the cameras see something, without a robot. Takes until every view was looked at, at most ``max_s``."""
        wanted = {"target": target, "max_s": max_s, **_given(floor=floor)}
        return self._gateway.one(rest.Sightings, "POST", "sightings", json=wanted, timeout=max_s + 20.0)

    def object(self, floor: str, id: int) -> rest.Object:
        """One object with its whole history."""
        return self._gateway.one(rest.Object, "GET", f"floors/{_id(floor)}/objects/{id}")

    def object_picture(self, floor: str, id: int, number: int) -> bytes:
        """A JPEG of what an event of an object's history (by its place, from 0) saw; GatewayError once it isn't kept."""
        return self._gateway.content(f"floors/{_id(floor)}/objects/{id}/history/{number}.jpg")

    # --- the system -------------------------------------------------------------------------------------------------

    def perception(self) -> list[rest.Worker]:
        """Perception workers."""
        return self._gateway.items(rest.Worker, "GET", "perception")

    def targets(self) -> list[rest.Target]:
        """What can be searched for by name. Workers that understand any word have no names."""
        return self._gateway.items(rest.Target, "GET", "targets")

    def services(self) -> list[rest.Service]:
        """Processes that are kept running."""
        return self._gateway.items(rest.Service, "GET", "services")

    def traffic(self) -> rest.Traffic:
        """Bytes by node, camera and robot."""
        return self._gateway.one(rest.Traffic, "GET", "traffic")

    def traffic_series(self, step: rest.TrafficStep = "minute", *, last_s: float = 3600.0) -> rest.TrafficOverTime:
        """Bytes by kind of link over time: each second of the last hour, or each minute of the last thirty days."""
        return self._gateway.one(rest.TrafficOverTime, "GET", "traffic/series", params={"step": step, "last_s": last_s})

    def traffic_table(self, step: rest.TrafficStep = "minute", *, last_s: float = 3600.0) -> str:
        """The same as comma-separated values."""
        params = {"step": step, "last_s": last_s}
        return self._gateway.request("GET", f"{rest.ROOT}/traffic/series.csv", params=params).text

    def metrics(self) -> str:
        """All that is counted, in Prometheus's text format."""
        return self._gateway.request("GET", "/metrics").text

    def alive(self) -> bool:
        """Whether the gateway lives."""
        return bool(self._gateway.json("GET", "/healthz")["status"] == "ok")

    def readiness(self) -> rest.Readiness:
        """Whether a mission could run now. GatewayError "not_ready": its text says what is missing."""
        return self._gateway.parsed(rest.Readiness, "/readyz", self._gateway.json("GET", "/readyz"))

    # --- streams ----------------------------------------------------------------------------------------------------

    def events(self, last_id: str = "") -> Iterator[ServerEvent[rest.Event]]:
        """Yields what changes, as it changes, without end. If the connection breaks, it connects again and goes on.

        A `reset` comes first: read the state (missions, cameras, robots, objects), then go by what follows. It comes again if
        events were lost, because the gateway was restarted or keeps only newer ones: read the state again.

        Args:
            last_id: the id of the last event that was received before; with it, the stream goes on after that event.
        """
        return self._gateway.follow("events", last_id, lambda kind, data: rest.Event.model_validate(data))

    def live(self, last_id: str = "") -> Iterator[ServerEvent[rest.LiveState]]:
        """Yields the state of everything, then of each thing whenever it changes. It connects again as ``events`` does.

        After a `reset`, forget all that was received before: the state of everything follows.
        """
        return self._gateway.follow("live", last_id, rest.LiveState.of_kind)

    def tiles(self, of: Sequence[str], last_id: str = "") -> Iterator[ServerEvent[rest.TileState]]:
        """Small pictures of these views ("c0-1/3", at most 32), as they change."""
        address = f"tiles?{'&'.join(f'of={_id(view)}' for view in of)}"
        return self._gateway.follow(address, last_id, lambda kind, data: rest.TileState.model_validate(data))

    # --- recordings -------------------------------------------------------------------------------------------------

    def recorders(self) -> list[rest.Recorder]:
        """The recorders, and how much room they have."""
        return self._gateway.items(rest.Recorder, "GET", "recorders")

    def recordings(self, mission: str = "") -> list[rest.Recording]:
        """Recorded missions, the newest first; only of one mission, if it is named."""
        return self._gateway.items(rest.Recording, "GET", "recordings", params=_given(mission=mission))

    def recording(self, id: str) -> rest.Recording:
        """One recording."""
        return self._gateway.one(rest.Recording, "GET", f"recordings/{_id(id)}")

    def download_recording(self, id: str, path: Path) -> None:
        """Writes a recording's file to ``path``, piece by piece. Raises OSError as the disk does."""
        self._gateway.download(f"recordings/{_id(id)}/file", path)

    def remove_recording(self, id: str) -> None:
        """Deletes a recording and its file."""
        self._gateway.request("DELETE", f"{rest.ROOT}/recordings/{_id(id)}")

    def replay(self) -> rest.Replay:
        """The state of the recording that this gateway shows."""
        return self._gateway.one(rest.Replay, "GET", "replay")

    def change_replay(
        self, *, at_s: float | None = None, speed: float | None = None, playing: bool | None = None
    ) -> rest.Replay:
        """Has the recording that this gateway shows go to a moment, change its speed, play or stand still."""
        return self._gateway.one(rest.Replay, "PATCH", "replay", json=_given(at_s=at_s, speed=speed, playing=playing))


def _id(id: str) -> str:
    """An id as part of an address."""
    return quote(id, safe="")


def _given(**params: Any) -> dict[str, Any]:
    """The parameters that have a value."""
    return {name: value for name, value in params.items() if value not in ("", None)}
