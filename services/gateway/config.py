"""Settings of the gateway: ``SURVEILNAV_GATEWAY__<FIELD>`` in the environment."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from services.gateway.core.hosts import allowed_names


class GatewaySettings(BaseSettings):
    """Where it listens, and what it is called on the bus."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_GATEWAY__", extra="ignore")

    host: str = Field(default="127.0.0.1", description="the address to listen at; 0.0.0.0 in a container")
    port: int = Field(default=8080, ge=0, le=65535, description="the TCP port; 0: any free one")
    allowed_hosts: str = Field(
        default="localhost,127.0.0.1,[::1]",
        description="names that requests may be for (their Host), with commas between, beside the host; * for any",
    )
    node_id: str = Field(default="gateway", description="its name on the bus")

    @property
    def names(self) -> frozenset[str] | None:
        """The names that it answers under; None: any."""
        return allowed_names(self.allowed_hosts, self.host)

    @model_validator(mode="after")
    def _readable(self) -> Self:
        _ = self.names
        return self
