"""What every service stands on: the Zenoh session, queries with bounded queues, presence, traffic, health.

``Node`` is the whole interface; services see messages and numpy arrays, never a Zenoh type.
"""

from surveilnav.bus.connection import Received
from surveilnav.bus.node import Node
from surveilnav.bus.publishing import LatestMessage, Publisher, Subscription, Table
from surveilnav.bus.queries import Answer, Request
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
    "LatestMessage",
    "Subscription",
    "Table",
    "Unanswered",
    "clock_ns",
]
