"""Instance ids of views, which the nodes of a simulator tell the backends ``oracle`` and ``simulated`` alone."""

from __future__ import annotations

from surveilnav.bus import Node, Refused
from surveilnav.contract import TRUTH
from surveilnav.errors import BusError, WireError
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.sensing.views import TrueInstances


def ask_for_truth(node: Node, backend: str, source: str, view: int, seq: int) -> TrueInstances:
    """Asks the node that sees a view which instance each of its pixels shows. ``backend``: who wants to know, for the error.

    Raises:
        Refused: it doesn't know (any more), or nobody answers.
        WireError: the answer is malformed, or about another view.
    """
    try:
        told = node.ask(TRUTH, source=source.replace("/", "-"), view=view, parameters={"seq": str(seq)})
    except (BusError, ValueError) as error:  # ValueError: the names can't stand in a key
        what = (
            f"no instance ids of {source} view {view} seq {seq}: the backend {backend} runs only where simulator nodes"
        )
        raise Refused("no_truth", f"{what} tell them ({error})") from error
    truth = told.message
    if (truth.source, truth.view, truth.seq) != (source, view, seq):
        raise WireError(
            f"expected the instance ids of {source} view {view} seq {seq}, got those of {truth.source:.80} view {truth.view} "
            f"seq {truth.seq}"
        )
    return truth_from_wire(truth, told.payload)
