"""Joint object confirmation: decides whether an object is what detectors take it for.

There are two rules: the paper's (``PaperConfirmation``) and ours (``PosteriorConfirmation``). Each looks at the evidence on one
object and answers with an ``Assessment``.
"""

from __future__ import annotations

from typing import Protocol

from surveilnav.services.fusion.core.objects.assessment import Assessment, Status
from surveilnav.services.fusion.core.objects.confidences import Confidences
from surveilnav.services.fusion.core.objects.config import ObjectConfig
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.paper_confirmation import PaperConfirmation
from surveilnav.services.fusion.core.objects.posterior_confirmation import PosteriorConfirmation


class ConfirmationRule(Protocol):
    """A rule of confirmation. After new evidence, ``update`` is called once; then ``assess`` may be asked at any time."""

    def confidences(self, evidence: Evidence) -> Confidences:
        """The confidence in each class."""
        ...

    def update(self, evidence: Evidence) -> None:
        """Records in the evidence which category the rule has decided on, if it is one that decides for good."""
        ...

    def assess(self, evidence: Evidence, previous: Status) -> Assessment:
        """Concludes from the evidence what the object is. ``previous``: its status so far, for hysteresis. Changes nothing."""
        ...


def confirmation_rule(config: ObjectConfig) -> ConfirmationRule:
    if config.confirmation.rule == "paper":
        return PaperConfirmation(config.confirmation.paper)
    return PosteriorConfirmation(config.confirmation.posterior)
