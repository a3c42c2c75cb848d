"""Taking what a camera or a robot has contributed out of the maps again; the routes ``/removals``."""

from __future__ import annotations

from datetime import UTC, datetime

from fastapi import APIRouter

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.errors import SurveilNavError
from surveilnav.messages import MapRemoval, RemoveFromMaps
from surveilnav.rest import ROOT, Items, NewRemoval, Removal
from surveilnav.services.gateway.bus_requests import request_each
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import resource_from, utc
from surveilnav.services.gateway.maps import Maps
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.responses import Id, Limit, Offset, page_of
from surveilnav.services.gateway.state import BuildingState

_MAX_STAMP_NS = 2**62
_EPOCH = datetime.fromtimestamp(0, UTC)


class Removals:
    """Has fusion remove contributions, and follows how far that is."""

    def __init__(self, state: BuildingState, maps: Maps, objects: Objects) -> None:
        self._state, self._node = state, state.node
        self._maps, self._objects = maps, objects
        self._ended: set[tuple[str, str]] = set()
        #: By fusion service, the newest that was begun here, which that service may not have published yet.
        self._begun: dict[str, MapRemoval] = {}

    def all(self) -> list[Removal]:
        """The newest removals, the newest first."""
        return [removal_from_message(id, removal) for id, removal in self.messages().items()]

    def messages(self) -> dict[str, MapRemoval]:
        """As fusion tells them, by id, the newest first. Each fusion service counts its own."""
        found = {
            _id_of(row.ids["fusion"], removal): removal
            for row in self._state.removals.rows()
            for removal in row.message.removals
        }
        for fusion, begun in list(self._begun.items()):
            found.setdefault(_id_of(fusion, begun), begun)
        return dict(sorted(found.items(), key=lambda item: (-item[1].stamp_ns, -item[1].id)))

    def one(self, id: str) -> Removal:
        """One removal; 404 if fusion doesn't know it (any more)."""
        for removal in self.all():
            if removal.id == id:
                return removal
        raise Problem(404, "unknown_removal", f"no removal {id!r}; {ROOT}/removals lists the newest")

    def begin(self, wanted: NewRemoval) -> Removal:
        """Has fusion begin a removal. Returns once it is certain to happen, also if fusion is killed meanwhile.

        Of several fusion services, each that has views of the source begins one, and the first is returned.
        """
        message = RemoveFromMaps(
            stamp_ns=clock_ns(),
            source=wanted.source,
            since_ns=_stamp_ns(wanted.since),
            until_ns=_stamp_ns(wanted.until),
        )
        begun = request_each(self._node, "fusion", contract.REMOVE_FROM_MAPS, message, not_mine="unknown_source")
        self._begun |= begun
        fusion, removal = next(iter(begun.items()))
        return removal_from_message(_id_of(fusion, removal), removal)

    def forget_outdated(self) -> None:
        """Once a removal has ended, forgets answers about the maps of before, and floors that fusion has no maps of any more."""
        ended: set[tuple[str, str]] = {
            (removal.id, removal.state) for removal in self.all() if removal.state != "running"
        }
        new, self._ended = ended - self._ended, ended
        if not new:
            return
        self._maps.clear()
        self._objects.clear()
        try:
            answers = self._node.ask_all(contract.MAP_REVISION, timeout_s=1.0)
        except SurveilNavError:
            return
        kept = {row.ids["floor"] for row in answers}
        for floor in set(self._state.revisions.newest("floor")) - kept if kept else ():
            self._state.revisions.forget("floor", floor)


def _id_of(fusion: str, removal: MapRemoval) -> str:
    return f"{fusion}-{removal.id}"


def removal_from_message(id: str, message: MapRemoval) -> Removal:
    return resource_from(
        Removal,
        message,
        id=id,
        since=utc(message.since_ns),
        until=utc(message.until_ns),
        requested=utc(message.stamp_ns),
        finished=utc(message.finished_ns),
    )


def _stamp_ns(time: datetime | None) -> int | None:
    """Nanoseconds since the epoch, to the microsecond; at most what stamps can be."""
    if time is None:
        return None
    age = time - _EPOCH
    stamp_ns = ((age.days * 86_400 + age.seconds) * 1_000_000 + age.microseconds) * 1000
    return max(-_MAX_STAMP_NS, min(stamp_ns, _MAX_STAMP_NS))


def router(removals: Removals) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/removals", name="removals")
    def list_removals(limit: Limit = 100, offset: Offset = 0) -> Items[Removal]:
        """The newest removals from the maps, the newest first."""
        return page_of(removals.all(), limit, offset)

    @router.get("/removals/{id}")
    def removal(id: Id) -> Removal:
        return removals.one(id)

    @router.post("/removals", status_code=202)
    def begin(wanted: NewRemoval) -> Removal:
        """Takes what a camera or a robot has contributed, always or within a time span, out of the maps: they become what they
        would be had it never been there. That happens in the background; the answer says in which way. What the source sees
        from now on enters the maps again, so pause a camera first that is wrong. Any later view of a camera is looked at anew."""
        return removals.begin(wanted)

    return router
