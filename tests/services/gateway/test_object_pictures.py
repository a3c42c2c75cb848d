"""What the events of an object's history saw."""

from __future__ import annotations

import pytest


def test_an_event_is_shown_with_what_it_saw(client):
    history = client.get("/api/v1/floors/0/objects/1").json()["history"]
    assert history[0]["box_px"]
    answer = client.get("/api/v1/floors/0/objects/1/history/0.jpg")
    assert answer.content.startswith(b"\xff\xd8")
    assert answer.headers["content-type"] == "image/jpeg"
    looks = client.get("/api/v1/cameras/c1/looks").json()["items"]
    assert "history" in [look["what"] for look in looks], "who was shown what a camera saw is noted"


@pytest.mark.parametrize(
    ("path", "status", "name"),
    [
        ("objects/1/history/99.jpg", 404, "not_found"),
        ("objects/1/history/x.jpg", 422, "invalid"),
        ("objects/99/history/0.jpg", 404, ""),
    ],
)
def test_what_isnt_there_is_refused(client, path, status, name):
    answer = client.get(f"/api/v1/floors/0/{path}")
    assert answer.status_code == status
    assert answer.json()["type"].endswith(name)
