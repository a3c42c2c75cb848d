"""A camera's budget of bytes, and how much of which view it sends from it.

The budget is a token bucket: it fills at the budget's rate up to two seconds' worth, and every frame takes its bytes out. A frame
may be sent as soon as the bucket isn't empty, whatever its size; then the camera waits until its debt is paid. So over any time
a camera sends what its budget allows, and at most one frame and two seconds' worth more, and no frame is too large to be sent.

With the tier ``auto`` a view is sent as ``features``; as ``objects`` if the features of all waiting views would take longer than
``_PATIENCE_S``, by the budget or by what the link takes, and as features after all once nothing else waits; and as ``jpeg+depth``
if somebody has asked for the pictures.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from surveilnav.messages import PERCEIVED_TIERS, Tier, TierChoice
from surveilnav.services.camera_node.core.link import Link

_BURST_S = 2.0
_PATIENCE_S = 5.0
#: Bytes of a view as ``features``, before the camera has sent any.
_TYPICAL_FEATURES_BYTES = 9_000


@dataclass(frozen=True, slots=True)
class TokenBucket:
    """``level_bytes`` may be sent at ``at_s``; less than 0: so much is owed."""

    rate_bytes_s: float
    level_bytes: float
    at_s: float

    @classmethod
    def full(cls, rate_bytes_s: float, now_s: float) -> TokenBucket:
        return cls(rate_bytes_s, rate_bytes_s * _BURST_S, now_s)

    def at(self, now_s: float) -> TokenBucket:
        """The bucket at a later time. A clock that went back fills nothing."""
        gained = max(0.0, now_s - self.at_s) * self.rate_bytes_s
        return replace(self, level_bytes=min(self.level_bytes + gained, self.rate_bytes_s * _BURST_S), at_s=now_s)

    def without(self, n_bytes: int) -> TokenBucket:
        """The bucket after a frame of ``n_bytes`` was sent."""
        return replace(self, level_bytes=self.level_bytes - n_bytes)

    @property
    def allows(self) -> bool:
        """Whether a frame may be sent."""
        return self.level_bytes > 0.0

    @property
    def soon_bytes(self) -> float:
        """What may be sent within ``_PATIENCE_S``."""
        return max(self.level_bytes, 0.0) + _PATIENCE_S * self.rate_bytes_s


def soon_bytes(bucket: TokenBucket | None, link: Link) -> float:
    """How many bytes can be sent within ``_PATIENCE_S``. ``bucket``: the budget; None: there is none."""
    by_link = math.inf if link.rate_bytes_s is None else _PATIENCE_S * link.rate_bytes_s
    return by_link if bucket is None else min(bucket.soon_bytes, by_link)


def tier_of(
    choice: TierChoice,
    view: int,
    *,
    pictures_wanted: Collection[int],
    n_waiting: int,
    soon_bytes: float,
    mean_bytes: float,
) -> Tier:
    """The tier in which a view is sent now.

    Args:
        choice: the camera's setting.
        pictures_wanted: views of which somebody has asked for the pictures.
        n_waiting: how many views wait that nobody has yet.
        soon_bytes: how many bytes can be sent within ``_PATIENCE_S``.
        mean_bytes: of the views that were sent as ``features``; 0: none was yet.
    """
    if view in pictures_wanted and choice in ("auto", *PERCEIVED_TIERS):
        return "jpeg+depth"
    if choice != "auto":
        return choice
    return "features" if n_waiting * (mean_bytes or _TYPICAL_FEATURES_BYTES) <= soon_bytes else "objects"


def views_to_improve(
    choice: TierChoice, sent: Mapping[int, Tier], pictures_wanted: Collection[int], bucket: TokenBucket | None
) -> dict[int, Tier]:
    """What is sent again while nothing else waits, in this order: views that were sent in a lower tier than they should be, with
    the tier in which they are sent now."""
    if choice not in ("auto", *PERCEIVED_TIERS) or (bucket is not None and not bucket.allows):
        return {}
    better: dict[int, Tier] = {v: "jpeg+depth" for v in sorted(pictures_wanted) if sent.get(v) in PERCEIVED_TIERS}
    if choice == "auto":
        better |= {v: "features" for v in sorted(sent) if sent[v] == "objects" and v not in pictures_wanted}
    return better
