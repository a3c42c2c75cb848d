"""Settings of the gateway: ``SURVEILNAV_GATEWAY__<FIELD>`` in the environment."""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class GatewaySettings(BaseSettings):
    """Where it listens, and what it is called on the bus."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_GATEWAY__", extra="ignore")

    host: str = Field(default="127.0.0.1", description="the address to listen at; 0.0.0.0 in a container")
    port: int = Field(default=8080, ge=0, le=65535, description="the TCP port; 0: any free one")
    node_id: str = Field(default="gateway", description="its name on the bus")
