from __future__ import annotations

import pytest

from surveilnav.services.camera_node.core.sending import SendState, views_to_send


def test_views_are_sent_once_while_somebody_listens() -> None:
    versions = {0: 1, 1: 1, 2: 1}
    state, send = views_to_send(SendState(), versions=versions, matched=[])
    assert send == (), "nobody listens"
    state, send = views_to_send(state, versions=versions, matched=[0, 2])
    assert send == (0, 2)
    state, send = views_to_send(state, versions=versions, matched=[0, 2])
    assert send == (), "nothing changed"
    state, send = views_to_send(state, versions={**versions, 1: 2, 2: 2}, matched=[0, 2])
    assert send == (2,), "view 1 changed too, but nobody listens to it"
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[0, 1, 2], requested=[2])
    assert send == (2, 1), "what was asked for goes first"
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[1, 2])
    assert send == ()
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[0, 1, 2])
    assert send == (0,), "a new listener of view 0 has nothing yet"


@pytest.mark.parametrize("requested", [[0], [7], [0, 7, -1]])
def test_a_request_without_a_listener_sends_nothing(requested) -> None:
    assert views_to_send(SendState(), versions={0: 1}, matched=[], requested=requested)[1] == ()
    assert 7 not in views_to_send(SendState(), versions={0: 1}, matched=[0, 7], requested=requested)[1]
