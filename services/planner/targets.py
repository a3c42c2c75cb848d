"""What can be searched for: any phrase that whoever looks at the pictures understands."""

from __future__ import annotations

from surveilnav.bus import Node, Refused, clock_ns
from surveilnav.contract import PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import BusError, MissionError, TargetError
from surveilnav.messages import InferRequest
from surveilnav.perception.prompts import value_prompt
from surveilnav.words import checked_word

_MOST_ASKED, _PATIENCE_S = 3, 1.0


def understood(node: Node, name: str) -> str:
    """The target's one spelling.

    Raises:
        MissionError: it is no phrase, or no perception worker that answers knows it. Where none answers, it may be known.
    """
    try:
        word = checked_word(name)
    except TargetError as error:
        raise MissionError("bad_target", str(error)) from error
    refusal = ""
    for worker in _one_of_each_model(node):
        request = InferRequest(stamp_ns=clock_ns(), texts=[value_prompt(word)])
        try:
            node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_PATIENCE_S)
            return word
        except Refused as error:
            if error.name == "bad_target":
                refusal = str(error)
        except BusError:
            continue
    if refusal:
        raise MissionError("bad_target", refusal)
    return word


def _one_of_each_model(node: Node) -> list[str]:
    """Perception workers that know other words than each other."""
    alive = node.alive("perception")
    loads = [received.message for received in node.ask_all(PERCEPTION_LOAD, timeout_s=_PATIENCE_S)] if alive else []
    return sorted({load.models: load.worker for load in loads if load.worker in alive}.values())[:_MOST_ASKED]
