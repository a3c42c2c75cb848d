"""``/pictures``."""

from __future__ import annotations

from fastapi import APIRouter

from surveilnav.services.gateway.core.resources import ROOT, Items, PictureKeeper
from surveilnav.services.gateway.pictures import Pictures
from surveilnav.services.gateway.routes.paging import page_of


def router(pictures: Pictures) -> APIRouter:
    """Past pictures, forgotten."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.delete("/pictures", status_code=202)
    def forget() -> Items[PictureKeeper]:
        """Has all services forget past pictures, within seconds. Maps, reports in folders and recordings stay."""
        return page_of(pictures.forget(), 1000, 0)

    return router
