"""An example of each resource, for the OpenAPI document and for tests."""

from __future__ import annotations

from typing import Any

_TIMES = {"last_seen": "2026-01-31T10:00:41Z", "stale": False}

NEW_MISSION: dict[str, Any] = {"target": "potted plant", "robot": None, "max_steps": 500, "queue": False}
MISSION: dict[str, Any] = {
    **_TIMES,
    "id": "m-0123456789ab",
    "target": "potted plant",
    "asked": None,
    "robot": "r1",
    "state": "active",
    "phase": "exploring",
    "step": 61,
    "max_steps": 500,
    "path_m": 10.2,
    "distance_remaining_m": 3.1,
    "time_remaining_s": 12.4,
    "elapsed_s": 41.0,
    "floor": "0",
    "found": False,
    "judged": None,
    "object_id": None,
    "error": None,
    "message": "to a frontier, 3.1 m",
    "request_id": "0af7651916cd43dd8448eb211c80319c",
    "started": "2026-01-31T10:00:00Z",
    "finished": None,
    "floor_choice_bytes": 1234,
}
_PLACE: dict[str, Any] = {
    "kind": "frontier",
    "x_m": 4.1,
    "y_m": 2.0,
    "chance": 0.41,
    "cost_m": 5.3,
    "utility": 0.077,
    "chosen": True,
    "note": "best value, 3.1 m",
    "object_id": None,
}
PLAN: dict[str, Any] = {
    **_TIMES,
    "mission": "m-0123456789ab",
    "robot": "r1",
    "floor": "0",
    "step": 61,
    "action": "move_forward",
    "why": "to a frontier, 3.1 m",
    "waypoint": _PLACE,
    "path_m": [[1.0, 2.0], [4.1, 2.0]],
    "candidates": [
        _PLACE,
        {
            "kind": "candidate",
            "x_m": 6.0,
            "y_m": 1.2,
            "chance": 0.12,
            "cost_m": 6.0,
            "utility": 0.02,
            "chosen": False,
            "note": "the maps rejected it: two views say vase",
            "object_id": 17,
        },
    ],
}
OBJECT: dict[str, Any] = {
    **_TIMES,
    "id": 17,
    "floor": "0",
    "label": "couch",
    "status": "confirmed",
    "reason": "0.81 >= 0.5",
    "confidence": 0.81,
    "confidence_robot": 0.0,
    "confidence_surveillance": 0.81,
    "label_robot": "",
    "label_surveillance": "couch",
    "n_detections": 3,
    "n_points": 812,
    "center_m": [6.0, 1.2, 0.4],
    "size_m": [2.0, 0.9, 0.8],
    "position_sigma_m": 0.0,
    "first_seen": "2026-01-31T10:00:12Z",
    "sources": ["camera/c0-1"],
    "relevance": None,
    "history": [
        {
            "time": "2026-01-31T10:00:12Z",
            "source": "camera/c0-1",
            "view": 3,
            "seq": 1,
            "label": "couch",
            "score": 0.81,
            "what": "created",
            "note": "",
            "box_px": [120.0, 340.0, 410.0, 520.0],
        }
    ],
}
SIGHTINGS: dict[str, Any] = {
    "target": "couch",
    "sightings": [
        {
            "floor": "0",
            "object": 17,
            "label": "couch",
            "status": "confirmed",
            "confidence": 0.81,
            "position_m": [6.0, 1.2, 0.4],
            "room": "lounge",
            "position_sigma_m": 0.14,
            "last_seen": "2026-01-31T10:00:12Z",
            "sources": ["camera/lobby"],
            "picture": "/api/v1/floors/0/objects/17/history/3.jpg",
        }
    ],
    "cameras": [{"id": "lobby", "views": 1, "views_processed": 1, "lacking": ""}],
    "rooms": [
        {"floor": "0", "name": "lounge", "in_view": 0.72, "cameras": ["lobby"]},
        {"floor": "0", "name": "store", "in_view": 0.0, "cameras": []},
    ],
    "complete": True,
}
RECORDING: dict[str, Any] = {
    "id": "20260131T100000250Z_m-0123456789ab",
    "mission": "m-0123456789ab",
    "target": "potted plant",
    "state": "complete",
    "n_bytes": 41_231_870,
    "started": "2026-01-31T10:00:00.250000Z",
    "changed": "2026-01-31T10:01:12Z",
    "recorder": "recorder",
    "cameras": ["c0-1"],
    "file": "/api/v1/recordings/20260131T100000250Z_m-0123456789ab/file",
}
RECORDER: dict[str, Any] = {
    **_TIMES,
    "id": "recorder",
    "recording": [],
    "problem": None,
    "dropped": 0,
    "n_bytes": 1_231_870_000,
    "free_bytes": 81_000_000_000,
}
REPLAY: dict[str, Any] = {
    **_TIMES,
    "mission": "m1",
    "target": "tv",
    "began": "2026-11-25T14:35:19.250000Z",
    "at_s": 12.5,
    "duration_s": 74.0,
    "speed": 1.0,
    "playing": True,
    "jumps": 0,
}
ROBOT: dict[str, Any] = {
    **_TIMES,
    "id": "r1",
    "floor": "0",
    "seq": 62,
    "state": "moving",
    "position_m": [1.0, 2.0, 0.0],
    "yaw_rad": 1.57,
    "mission": "m-0123456789ab",
    "message": "",
    "frame_problem": "",
    "frame_correction": None,
    "battery": 0.83,
    "notes": [],
}
CAMERA: dict[str, Any] = {
    **_TIMES,
    "id": "c0-1",
    "floor": "0",
    "position_m": [2.0, 1.0, 2.2],
    "mounting_offset_m": 2.2,
    "hfov_rad": 1.75,
    "width_px": 1280,
    "height_px": 1280,
    "tier": "jpeg+depth",
    "label": "",
    "stream": {"state": "live", "reason": "", "since": None, "n_bytes": 0},
    "paused": False,
    "invoked": True,
    "views_processed": 13,
    "quarantine": "",
    "labels": {"couch": 0.81},
    "views": [{"view": 0, "yaw_rad": 0.0, "pitch_rad": -0.52, "picture": "/api/v1/cameras/c0-1/views/0.jpg"}],
}
