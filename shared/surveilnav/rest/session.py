"""Who is signed in."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class NewSession(BaseModel):
    """A key, to be exchanged for a session."""

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    key: str = Field(min_length=1, max_length=200, description="as `surveilnav security key add` shows it")


class Session(BaseModel):
    """Whether the gateway needs a key, and who is signed in."""

    needed: bool = Field(description="whether this gateway answers only with a key")
    name: str = Field(default="", description="the name of the session's key; empty: nobody is signed in")
    role: Literal["viewer", "operator", "admin"] | None = None
