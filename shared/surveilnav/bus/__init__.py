"""The bus that connects all services: publishing, queries with bounded queues, presence, traffic figures, health.

``Node`` is the interface. Services see messages and bytes, never a type of Zenoh.
"""

from surveilnav.bus.connection import Received
from surveilnav.bus.correlation import bound_request_id, is_request_id, keep_request_id, request_id
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
    "bound_request_id",
    "clock_ns",
    "is_request_id",
    "keep_request_id",
    "request_id",
]
