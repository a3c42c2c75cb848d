"""The backends of perception, pure: arrays in, arrays out."""

from services.perception.core.backend import Backend

__all__ = ["Backend"]
