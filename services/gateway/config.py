"""Settings of the gateway: ``SURVEILNAV_GATEWAY__<FIELD>`` in the environment."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.services.gateway.core.hosts import (
    Networks,
    allowed_names,
    is_loopback,
    listen_address,
    names_of_address,
    networks,
)


class GatewaySettings(BaseSettings):
    """Where the gateway listens, whom it answers, what it records, and its name on the bus."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_GATEWAY__", extra="ignore")

    host: str = Field(
        default="127.0.0.1", description="the address to listen at, without a port; 0.0.0.0 in a container"
    )
    port: int = Field(default=8080, ge=0, le=65535, description="the TCP port; 0: any free one")
    allowed_hosts: str = Field(
        default="localhost,127.0.0.1,[::1]",
        description="names in Host headers that are answered, beside the host: without ports, separated by commas; * for any",
    )
    root_path: str = Field(
        default="",
        pattern=r"^(/[A-Za-z0-9_.~-]+)*$",
        description="the path below which a proxy offers the gateway, such as /surveilnav; the proxy removes it from requests",
    )
    trusted_proxies: str = Field(
        default="",
        description="proxies whose X-Forwarded-For the access log believes: addresses or networks, separated by commas",
    )
    access_log: str = Field(
        default="",
        description="the folder of the access log, which says who was shown which camera; empty: it is kept in memory only",
    )
    access_log_days: int = Field(default=90, ge=1, le=3650, description="how long a line of the access log is kept")
    access_log_mb: int = Field(
        default=10, ge=2, le=1000, description="the size of all files of the access log; the oldest are removed first"
    )
    keys_file: Path | None = Field(
        default=None,
        description="the file of API keys, which `surveilnav security key` writes; it is read again when it changes",
    )
    authentication: Literal["auto", "keys", "none"] = Field(
        default="auto",
        description="who is answered: only who has a key (keys), everybody (none), or everybody as long as there is no file of "
        "keys and the gateway listens at a loopback address (auto)",
    )
    cameras_file: Path | None = Field(
        default=None,
        description="the file of real cameras, whose rooms answers name: where something was seen, and where nobody sees",
    )
    node_id: str = Field(default="gateway", description="the gateway's name on the bus")

    @field_validator("host")
    @classmethod
    def _address(cls, value: str) -> str:
        return listen_address(value)

    @field_validator("allowed_hosts")
    @classmethod
    def _hosts(cls, value: str) -> str:
        allowed_names(value)
        return value

    @field_validator("trusted_proxies")
    @classmethod
    def _proxies(cls, value: str) -> str:
        networks(value)
        return value

    @property
    def proxies(self) -> Networks:
        return networks(self.trusted_proxies)

    @property
    def needs_keys(self) -> bool:
        """Whether only requests with a key are answered."""
        if self.authentication == "auto":
            return self.keys_file is not None or not is_loopback(self.host)
        return self.authentication == "keys"

    @property
    def names(self) -> frozenset[str] | None:
        """The names that the gateway answers under; None: any."""
        allowed = allowed_names(self.allowed_hosts)
        return None if allowed is None else allowed | names_of_address(self.host)
