"""The objects of a floor by id, with an index of where they are."""

from __future__ import annotations

from surveilnav.services.fusion.core.objects.box_index import BoxIndex
from surveilnav.services.fusion.core.objects.map_object import MapObject


class IndexedObjects(dict[int, MapObject]):
    """Objects by id, with a spatial index. An object whose shape has changed must be assigned again to update the index.

    Attributes:
        estimated: ids of the objects whose place is only estimated.
    """

    def __init__(self) -> None:
        super().__init__()
        self.boxes = BoxIndex()
        self.estimated: set[int] = set()

    def __setitem__(self, id_: int, obj: MapObject) -> None:
        super().__setitem__(id_, obj)
        self.boxes.put(id_, obj.shape)
        (self.estimated.discard if obj.covariance_m2 is None else self.estimated.add)(id_)

    def __delitem__(self, id_: int) -> None:
        super().__delitem__(id_)
        self.boxes.remove(id_)
        self.estimated.discard(id_)
