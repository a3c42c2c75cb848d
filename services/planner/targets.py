"""What can be searched for: any phrase that whoever looks at the pictures understands."""

from __future__ import annotations

import time

from surveilnav.bus import Node, Refused, clock_ns
from surveilnav.contract import PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import BusError, MissionError, TargetError
from surveilnav.messages import InferRequest, TextReply
from surveilnav.perception.prompts import value_prompt
from surveilnav.words import validate_word

_MOST_ASKED, _PATIENCE_S = 3, 1.0
#: So long workers that warm up are asked again; who sends a goal waits five seconds.
_WARM_UP_S, _AGAIN_S = 2.0, 0.2


def understood(node: Node, name: str) -> str:
    """The target as whoever looks at the pictures calls it ("Fernseher": "tv"), in one spelling.

    Raises:
        MissionError: it is no phrase, or no perception worker that answers knows it. Where none answers, it may be known.
    """
    try:
        word = validate_word(name)
    except TargetError as error:
        raise MissionError("bad_target", str(error)) from error
    refusal, until_s = "", time.monotonic() + _WARM_UP_S
    for worker in _one_of_each_model(node):
        try:
            return _own_name(_reply(node, worker, word, until_s), word)
        except Refused as error:
            if error.name == "bad_target":
                refusal = str(error)
        except BusError:
            continue
    if refusal:
        raise MissionError("bad_target", refusal)
    return word


def _reply(node: Node, worker: str, word: str, until_s: float) -> TextReply:
    """What a worker says of a target, asked again while it warms up. BusError: nothing, or it refuses."""
    while True:
        request = InferRequest(stamp_ns=clock_ns(), texts=[value_prompt(word)])
        try:
            reply: TextReply = node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_PATIENCE_S).message
            return reply
        except Refused as error:
            if error.name != "not_ready" or time.monotonic() > until_s or node.stopping.wait(_AGAIN_S):
                raise


def _own_name(reply: TextReply, word: str) -> str:
    """What the worker calls it; the word itself where it knows any, or says what is no word."""
    try:
        return validate_word(reply.words[0]) if len(reply.words) == 1 and reply.words[0] else word
    except TargetError:
        return word


def _one_of_each_model(node: Node) -> list[str]:
    """Perception workers that know other words than each other; those with a vocabulary first: any other knows their names."""
    alive = node.alive("perception")
    loads = [received.message for received in node.ask_all(PERCEPTION_LOAD, timeout_s=_PATIENCE_S)] if alive else []
    of_models = {load.models: load for load in loads if load.worker in alive}.values()
    ordered = sorted(of_models, key=lambda load: (load.open_vocabulary, load.worker))
    return [load.worker for load in ordered][:_MOST_ASKED]
