"""The gateway from Python.

    with Client("http://127.0.0.1:8080") as building:
        mission = building.submit("potted plant", queue=True)
        for told in building.events():
            ...

Every failure is a ``GatewayError``: its ``name`` ends the problem's type, its text says what to do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import quote

import httpx

from surveilnav.client import resources as r
from surveilnav.client.events import Told, follow
from surveilnav.client.npy import array_of, rows_of
from surveilnav.errors import GatewayError

if TYPE_CHECKING:  # only who asks for arrays needs numpy
    import numpy as np
    from numpy.typing import NDArray

_ROOT = "/api/v1"
#: Of a list at most so many are read; newest first where it has an order of time.
_MOST = 1000


class Client:
    """One gateway. Safe to use from several threads. ``transport`` stands in for the network in tests."""

    def __init__(self, url: str, timeout_s: float = 30.0, transport: httpx.BaseTransport | None = None) -> None:
        """Raises GatewayError: that is no address."""
        self.url = url.rstrip("/")
        try:
            self._http = httpx.Client(base_url=self.url, timeout=timeout_s, transport=transport)
        except httpx.InvalidURL as error:
            raise self._unreachable(error) from error

    def __enter__(self) -> Client:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Closes its connections."""
        self._http.close()

    # --- missions ---------------------------------------------------------------------------------------------------

    def submit(
        self,
        target: str,
        robot: str | None = None,
        max_steps: int = 500,
        *,
        queue: bool = False,
        idempotency_key: str | None = None,
    ) -> r.Mission:
        """Sends a robot (else any free one) to find something. ``queue``: waits for it if none is free. With the same
        ``idempotency_key`` it is the same mission, however often this is called."""
        goal = {"target": target, "robot": robot, "max_steps": max_steps, "queue": queue}
        headers = {"Idempotency-Key": idempotency_key} if idempotency_key else {}
        return cast("r.Mission", self._json("POST", "missions", json=goal, headers=headers))

    def missions(self) -> list[r.Mission]:
        """The newest 1,000, newest first."""
        return self._items("missions")

    def mission(self, id: str) -> r.Mission:
        """One mission."""
        return cast("r.Mission", self._json("GET", f"missions/{_id(id)}"))

    def mission_traffic(self, id: str) -> r.MissionTraffic:
        """What cameras and robots sent while it ran, and what that may come to."""
        return cast("r.MissionTraffic", self._json("GET", f"missions/{_id(id)}/traffic"))

    def plan(self, id: str) -> r.MissionPlan:
        """Its present plan: what was weighed, and why."""
        return cast("r.MissionPlan", self._json("GET", f"missions/{_id(id)}/plan"))

    def cancel(self, id: str, reason: str = "") -> r.Mission:
        """Ends a mission; its robot stops."""
        return cast("r.Mission", self._json("POST", f"missions/{_id(id)}/cancel", json={"reason": reason}))

    def pause(self, id: str, reason: str = "") -> r.Mission:
        """Has its robot stay where it is."""
        return cast("r.Mission", self._json("POST", f"missions/{_id(id)}/pause", json={"reason": reason}))

    def resume(self, id: str) -> r.Mission:
        """Has it go on."""
        return cast("r.Mission", self._json("POST", f"missions/{_id(id)}/resume"))

    # --- robots -----------------------------------------------------------------------------------------------------

    def robots(self) -> list[r.Robot]:
        """All robots."""
        return self._items("robots")

    def stop_robots(self, reason: str = "") -> list[r.RobotHalt]:
        """EMERGENCY STOP: all robots, at once."""
        return cast("list[r.RobotHalt]", self._json("POST", "robots/stop", json={"reason": reason})["items"])

    def release_robots(self) -> list[r.RobotHalt]:
        """Releases them; nothing moves by that."""
        return cast("list[r.RobotHalt]", self._json("POST", "robots/release")["items"])

    # --- cameras ----------------------------------------------------------------------------------------------------

    def cameras(self) -> list[r.Camera]:
        """All cameras."""
        return self._items("cameras")

    def camera(self, id: str) -> r.Camera:
        """One camera."""
        return cast("r.Camera", self._json("GET", f"cameras/{_id(id)}"))

    def picture(self, id: str, view: int) -> bytes:
        """A JPEG made for this call."""
        return self._asked("GET", f"{_ROOT}/cameras/{_id(id)}/views/{view}.jpg").content

    def latest_picture(self, id: str, view: int | None = None) -> bytes:
        """A JPEG at most a second old, shared by all viewers."""
        return self._asked("GET", f"{_ROOT}/cameras/{_id(id)}/latest.jpg", params=_given(view=view)).content

    def cones(self, id: str) -> list[r.CameraCone]:
        """What of its floor each view looks at."""
        return cast("list[r.CameraCone]", self._json("GET", f"cameras/{_id(id)}/cones")["items"])

    def looks(self, id: str) -> list[r.CameraLook]:
        """Who was shown its pictures, newest first."""
        return self._items(f"cameras/{_id(id)}/looks")

    def pause_camera(self, id: str) -> r.Camera:
        """Has it show nothing."""
        return cast("r.Camera", self._json("POST", f"cameras/{_id(id)}/pause"))

    def resume_camera(self, id: str) -> r.Camera:
        """Has it look again."""
        return cast("r.Camera", self._json("POST", f"cameras/{_id(id)}/resume"))

    def remove_camera(self, id: str) -> None:
        """Forgets one whose process has ended."""
        self._asked("DELETE", f"{_ROOT}/cameras/{_id(id)}")

    def forget_pictures(self) -> list[r.PictureKeeper]:
        """Has all services forget past pictures; what each says that it does."""
        return cast("list[r.PictureKeeper]", self._json("DELETE", "pictures")["items"])

    # --- maps and objects -------------------------------------------------------------------------------------------

    def buildings(self) -> list[r.Building]:
        """The building that the gateway stands for."""
        return self._items("buildings")

    def floors(self) -> list[r.Floor]:
        """Its floors."""
        return self._items("floors")

    def layer(self, floor: str, layer: str, target: str = "") -> r.Layer:
        """Where a map layer lies in the world."""
        return cast(
            "r.Layer", self._json("GET", f"floors/{_id(floor)}/layers/{_id(layer)}", params=_given(target=target))
        )

    def layer_picture(self, floor: str, layer: str, target: str = "") -> bytes:
        """A PNG of it, north up."""
        address = f"{_ROOT}/floors/{_id(floor)}/layers/{_id(layer)}.png"
        return self._asked("GET", address, params=_given(target=target)).content

    def layer_array(self, floor: str, layer: str, target: str = "") -> NDArray:
        """(rows, cols) of it, which needs numpy: uint8 0 or 1, or float32 with NaN where unknown; row 0 is the southernmost."""
        return array_of(self.layer_npy(floor, layer, target))

    def layer_rows(self, floor: str, layer: str, target: str = "") -> list[memoryview]:
        """The rows of it, as ``layer_array`` has them, for programs without numpy."""
        return rows_of(self.layer_npy(floor, layer, target))

    def layer_npy(self, floor: str, layer: str, target: str = "") -> bytes:
        """It as the bytes of a .npy file, which ``numpy.load`` reads."""
        address = f"{_ROOT}/floors/{_id(floor)}/layers/{_id(layer)}.npy"
        return self._asked("GET", address, params=_given(target=target)).content

    def objects(
        self, text: str = "", *, floor: str = "", label: str = "", status: str = "", min_confidence: float = 0.0
    ) -> list[r.Object]:
        """What the maps hold; with a text, what looks most like it first."""
        wanted = _given(text=text, floor=floor, label=label, status=status, min_confidence=min_confidence)
        return self._items("objects", **wanted)

    def cloud(self, floor: str, points: int = 50_000) -> NDArray[np.float32]:
        """(N, 6): x, y, z [m, world] and red, green, blue [0-1] of at most so many points of the joint cloud."""
        answer = self._asked("GET", f"{_ROOT}/floors/{_id(floor)}/cloud.npy", params={"points": points})
        return array_of(answer.content)

    def object(self, floor: str, id: int) -> r.Object:
        """One object with its whole history."""
        return cast("r.Object", self._json("GET", f"floors/{_id(floor)}/objects/{id}"))

    def object_picture(self, floor: str, id: int, number: int) -> bytes:
        """A JPEG of what an event of its history (by its place, from 0) saw; GatewayError once it isn't kept."""
        return self._asked("GET", f"{_ROOT}/floors/{_id(floor)}/objects/{id}/history/{number}.jpg").content

    # --- the whole --------------------------------------------------------------------------------------------------

    def perception(self) -> list[r.Worker]:
        """Perception workers."""
        return self._items("perception")

    def targets(self) -> list[r.Target]:
        """What can be searched for by name; workers that know any word have no names."""
        return self._items("targets")

    def services(self) -> list[r.Service]:
        """Processes that are kept running."""
        return self._items("services")

    def traffic(self) -> r.Traffic:
        """Bytes by node, camera and robot."""
        return cast("r.Traffic", self._json("GET", "traffic"))

    def metrics(self) -> str:
        """All that is counted, in Prometheus's text format."""
        return self._asked("GET", "/metrics").text

    def alive(self) -> bool:
        """Whether the gateway lives."""
        return bool(self._asked("GET", "/healthz").json()["status"] == "ok")

    def readiness(self) -> r.Readiness:
        """Whether a mission could run now. GatewayError "not_ready": what is missing."""
        return cast("r.Readiness", self._asked("GET", "/readyz").json())

    def events(self, last_id: str = "") -> Iterator[Told]:
        """What changes, as it changes, for ever: connects again by itself and misses nothing. The first event is ``reset``:
        read the state, then go by what follows. ``last_id``: the id of the last event that was heard before."""
        return follow(self._http, f"{_ROOT}/events", last_id, self._refusal, self._unreachable)

    def live(self, last_id: str = "") -> Iterator[Told]:
        """How each thing is, whenever that changes: all of it first. It goes on after a cut, as ``events`` does."""
        return follow(self._http, f"{_ROOT}/live", last_id, self._refusal, self._unreachable)

    def tiles(self, of: Sequence[str], last_id: str = "") -> Iterator[Told]:
        """Small pictures of these views ("c0-1/3", at most 32), as they change."""
        path = f"{_ROOT}/tiles?{'&'.join(f'of={_id(view)}' for view in of)}"
        return follow(self._http, path, last_id, self._refusal, self._unreachable)

    # --- recordings -------------------------------------------------------------------------------------------------

    def recorders(self) -> list[r.Recorder]:
        """Who records missions, and how much room there is."""
        return self._items("recorders")

    def recordings(self, mission: str = "") -> list[r.Recording]:
        """Recorded missions, the newest first; of one mission, if it is named."""
        return self._items("recordings", **_given(mission=mission))

    def recording(self, id: str) -> r.Recording:
        """One recording."""
        return cast("r.Recording", self._json("GET", f"recordings/{_id(id)}"))

    def download_recording(self, id: str, path: Path) -> None:
        """Writes its file to ``path``, piece by piece. Raises OSError as the disk does."""
        with self._http.stream("GET", f"{_ROOT}/recordings/{_id(id)}/file") as answer:
            if answer.is_error:
                answer.read()
                raise self._refusal(answer)
            with path.open("wb") as file:
                for piece in answer.iter_bytes():
                    file.write(piece)

    def remove_recording(self, id: str) -> None:
        """Deletes a recording and its file."""
        self._asked("DELETE", f"{_ROOT}/recordings/{_id(id)}")

    def replay(self) -> r.Replay:
        """Where the recording is that this gateway shows."""
        found: r.Replay = self._json("GET", "replay")
        return found

    def change_replay(
        self, *, at_s: float | None = None, speed: float | None = None, playing: bool | None = None
    ) -> r.Replay:
        """Has the recording that this gateway shows go to a moment, change its speed, play or stand still."""
        found: r.Replay = self._json("PATCH", "replay", json=_given(at_s=at_s, speed=speed, playing=playing))
        return found

    # --- asking -----------------------------------------------------------------------------------------------------

    def _items(self, path: str, **params: Any) -> list[Any]:
        return list(self._json("GET", path, params={"limit": _MOST, **params})["items"])

    def _json(self, method: str, path: str, **options: Any) -> Any:
        answer = self._asked(method, f"{_ROOT}/{path}", **options)
        try:
            return answer.json()
        except ValueError:
            what = f"{path} answered {answer.status_code} without JSON"
            raise GatewayError("no_gateway", f"{self.url} isn't a SurveilNav gateway: {what}") from None

    def _asked(self, method: str, path: str, **options: Any) -> httpx.Response:
        try:
            answer = self._http.request(method, path, **options)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise self._unreachable(error) from error
        if answer.is_error:
            raise self._refusal(answer)
        return answer

    def _unreachable(self, error: Exception) -> GatewayError:
        return GatewayError(
            "no_gateway",
            f"no gateway answers at {self.url} ({error}). Start one with `surveilnav up` or `docker compose up`, or name its "
            "address with --url or SURVEILNAV_URL.",
        )

    def _refusal(self, answer: httpx.Response) -> GatewayError:
        """What RFC 9457's members say; other servers' errors by their status."""
        try:
            problem = answer.json()
        except ValueError:
            what = f"{answer.url.path} answered {answer.status_code} without JSON"
            return GatewayError("no_gateway", f"{self.url} isn't a SurveilNav gateway: {what}")
        problem = problem if isinstance(problem, dict) else {}
        name = str(problem.get("type", "")).rpartition(":")[2] or str(answer.status_code)
        return GatewayError(name, str(problem.get("detail") or problem.get("title") or answer.reason_phrase))


def _id(id: str) -> str:
    """An id as part of an address."""
    return quote(id, safe="")


def _given(**params: Any) -> dict[str, Any]:
    """The parameters that say something."""
    return {name: value for name, value in params.items() if value not in ("", None)}
