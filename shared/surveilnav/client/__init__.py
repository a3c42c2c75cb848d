"""A client of the gateway's REST interface: ``Client``, and the resources that it answers with."""

from surveilnav.client.client import Client
from surveilnav.client.events import Told

__all__ = ["Client", "Told"]
