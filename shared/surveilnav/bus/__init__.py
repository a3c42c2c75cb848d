"""What every service stands on: the Zenoh session, queries with bounded queues, presence, traffic, health.

``Node`` is the whole interface; services see messages and numpy arrays, never a Zenoh type.
"""

from surveilnav.bus.node import Answer, Node, Publisher, Received, Request, Slot, Table
from surveilnav.bus.settings import BusSettings
from surveilnav.bus.wire import Refused, Unanswered, clock_ns

__all__ = [
    "Answer",
    "BusSettings",
    "Node",
    "Publisher",
    "Received",
    "Refused",
    "Request",
    "Slot",
    "Table",
    "Unanswered",
    "clock_ns",
]
