"""The backends of perception, pure: arrays in, arrays out."""

from surveilnav.perception.backend import Backend

__all__ = ["Backend"]
