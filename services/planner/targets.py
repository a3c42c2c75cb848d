"""What can be searched for: any phrase that a perception worker understands."""

from __future__ import annotations

import time

from surveilnav.bus import Node, Refused, clock_ns
from surveilnav.contract import PERCEPTION_LOAD, PERCEPTION_TEXT
from surveilnav.errors import BusError, MissionError, TargetError
from surveilnav.messages import InferRequest, TextReply
from surveilnav.perception.prompts import value_prompt
from surveilnav.words import validate_word

_MAX_WORKERS, _TIMEOUT_S = 3, 1.0
#: Workers that are still warming up are asked again for this long; whoever sent the goal waits for five seconds.
_WARM_UP_S, _RETRY_S = 2.0, 0.2


def resolve_target(node: Node, name: str) -> str:
    """The target in the perception workers' own vocabulary and spelling ("Fernseher" becomes "tv").

    If no worker answers, the target is accepted as it is: it may well be known.

    Raises:
        MissionError: it isn't a valid phrase, or none of the workers that answer knows it.
    """
    try:
        word = validate_word(name)
    except TargetError as error:
        raise MissionError("bad_target", str(error)) from error
    refusal, until_s = "", time.monotonic() + _WARM_UP_S
    for worker in _one_of_each_model(node):
        try:
            return _own_name(_ask_worker(node, worker, word, until_s), word)
        except Refused as error:
            if error.name == "bad_target":
                refusal = str(error)
        except BusError:
            continue
    if refusal:
        raise MissionError("bad_target", refusal)
    return word


def _ask_worker(node: Node, worker: str, word: str, until_s: float) -> TextReply:
    """A worker's answer about a target; asks again while the worker warms up. Raises BusError: no answer, or a refusal."""
    while True:
        request = InferRequest(stamp_ns=clock_ns(), texts=[value_prompt(word)])
        try:
            reply: TextReply = node.ask(PERCEPTION_TEXT, request, worker=worker, timeout_s=_TIMEOUT_S).message
            return reply
        except Refused as error:
            if error.name != "not_ready" or time.monotonic() > until_s or node.stopping.wait(_RETRY_S):
                raise


def _own_name(reply: TextReply, word: str) -> str:
    """The worker's own name for a target; the word itself if the worker takes any word or its answer isn't a valid one."""
    try:
        return validate_word(reply.words[0]) if len(reply.words) == 1 and reply.words[0] else word
    except TargetError:
        return word


def _one_of_each_model(node: Node) -> list[str]:
    """One perception worker of each model, those with a fixed vocabulary first: the others know their names, too."""
    alive = node.alive("perception")
    loads = [received.message for received in node.ask_all(PERCEPTION_LOAD, timeout_s=_TIMEOUT_S)] if alive else []
    of_models = {load.models: load for load in loads if load.worker in alive}.values()
    ordered = sorted(of_models, key=lambda load: (load.open_vocabulary, load.worker))
    return [load.worker for load in ordered][:_MAX_WORKERS]
