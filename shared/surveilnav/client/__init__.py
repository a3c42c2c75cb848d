"""A client of the gateway's REST interface. Its calls return the resources of ``surveilnav.rest``."""

from surveilnav.client.client import Client
from surveilnav.client.events import ServerEvent

__all__ = ["Client", "ServerEvent"]
