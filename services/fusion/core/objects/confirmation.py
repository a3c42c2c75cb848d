"""Joint object confirmation: is a candidate what it is taken for?

Two rules: the paper's (``PaperConfirmation``), and ours (``PosteriorConfirmation``). Either looks at the evidence of one object
and answers with an ``Assessment``.
"""

from __future__ import annotations

from typing import Protocol

from surveilnav.services.fusion.core.config import ObjectConfig
from surveilnav.services.fusion.core.objects.assessment import Assessment, Status
from surveilnav.services.fusion.core.objects.confidences import Confidences
from surveilnav.services.fusion.core.objects.evidence import Evidence
from surveilnav.services.fusion.core.objects.paper_confirmation import PaperConfirmation
from surveilnav.services.fusion.core.objects.posterior_confirmation import PosteriorConfirmation


class Confirmation(Protocol):
    """A rule of confirmation. Whoever adds evidence calls ``settle``, then asks ``assess``."""

    def confidences(self, evidence: Evidence) -> Confidences:
        """Confidence in each class."""
        ...

    def settle(self, evidence: Evidence) -> None:
        """Settles the class of an object, or changes it, where the evidence is enough for that. Updates the evidence."""
        ...

    def assess(self, evidence: Evidence, was: Status) -> Assessment:
        """What follows from the evidence on an object that ``was`` of some status before. Changes nothing."""
        ...


def confirmation_of(config: ObjectConfig) -> Confirmation:
    """The rule that the settings name."""
    if config.confirmation.rule == "paper":
        return PaperConfirmation(config.confirmation.paper)
    return PosteriorConfirmation(config.confirmation.posterior)
