"""Pictures that are kept anywhere: forgotten when somebody says so, and here when they are no longer new."""

from __future__ import annotations

import threading

from surveilnav import contract
from surveilnav.bus import Node, clock_ns
from surveilnav.messages import ForgetPictures
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import PictureKeeper
from surveilnav.services.gateway.looks import Looks
from surveilnav.services.gateway.single_flight import SingleFlight

_TIDY_S = 30.0
#: Nobody is shown one that is older than a second; what lies here longer is of no use.
_THUMBNAIL_S = 60.0


class Pictures:
    """Tidies the gateway's own, on a thread until the node ends; asks all others that keep any."""

    def __init__(self, node: Node, thumbnails: SingleFlight[bytes], looks: Looks) -> None:
        self._node, self._thumbnails, self._looks = node, thumbnails, looks
        node.alive("fusion")  # the first call starts watching
        threading.Thread(target=self._run, name="tidy", daemon=True).start()

    def forget(self) -> list[PictureKeeper]:
        """Has everybody forget past pictures; what each says that it does.

        Raises:
            Problem: fusion is there and doesn't say that it does (504, with the answers of the others).
        """
        message = ForgetPictures(stamp_ns=clock_ns(), reason="a client of the gateway asked for it")
        dropped = self._thumbnails.drop(0.0)
        answers = [PictureKeeper(keeper="gateway", message=f"{dropped} thumbnails are gone")]
        told = {
            r.ids["keeper"]: r.message for r in self._node.ask_all(contract.FORGET_PICTURES, message, timeout_s=2.0)
        }
        answers += [PictureKeeper(keeper=keeper, message=told[keeper].message) for keeper in sorted(told)]
        if silent := sorted(self._node.alive("fusion") - set(told)):
            detail = f"{', '.join(silent)} didn't say that it forgets its pictures: try again"
            raise Problem(504, "keeper_silent", detail, keepers=[a.model_dump() for a in answers])
        return answers

    def _run(self) -> None:
        while not self._node.stopping.wait(_TIDY_S):
            self._thumbnails.drop(_THUMBNAIL_S)
            self._looks.tidy()
