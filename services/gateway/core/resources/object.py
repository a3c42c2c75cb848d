"""Objects of the joint map, with their histories."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.messages import ObjectRecord
from surveilnav.services.gateway.core.resources import examples
from surveilnav.services.gateway.core.resources.base import Number, Resource, Time


class ObjectEvent(BaseModel):
    time: Time = Field(validation_alias="stamp_ns")
    source: str
    view: int
    seq: int
    label: str
    score: Number
    what: str
    note: str
    box_px: list[Number] | None


class Object(Resource):
    model_config = ConfigDict(json_schema_extra={"example": examples.OBJECT})

    id: int
    floor: str
    label: str
    status: str
    reason: str
    confidence: Number
    confidence_robot: Number
    confidence_surveillance: Number
    label_robot: str
    label_surveillance: str
    n_detections: int
    n_points: int
    center_m: tuple[Number, Number, Number]
    size_m: tuple[Number, Number, Number]
    first_seen: Time = Field(validation_alias="first_seen_ns")
    sources: list[str]
    relevance: Number | None = Field(default=None, description="how well it fits the text asked for, -1 to 1")
    history: list[ObjectEvent]

    @classmethod
    def from_record(cls, record: ObjectRecord) -> Object:
        """An object as fusion tells of it; asked for a moment ago, it is never stale."""
        return cls.made_of(record, last_seen=record.last_seen_ns, stale=False)
