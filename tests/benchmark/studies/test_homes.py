"""The table of homes: resumed, never mixed, and true to its records."""

from __future__ import annotations

import pytest

from surveilnav.benchmark.studies import homes

RECORD = {
    "building": "studio",
    "seed": 0,
    "target": "tv",
    "surveillance": "on",
    "perception": "onnx-coco",
    "success": True,
    "found": True,
    "reason": "",
    "message": "found",
    "steps": 10,
    "spl": 0.5,
    "path_m": 6.0,
    "shortest_path_m": 3.0,
    "success_at_0_2_m": True,
    "success_at_1_m": True,
    "cameras": 1,
    "invoked": ["c0-1"],
    "robot_bytes": 1_000_000,
    "camera_bytes": 2_000_000,
    "start_notes": [],
    "seconds": 1.0,
}
FAILED = RECORD | {"surveillance": "off", "success": False, "reason": "not_found", "spl": 0.0, "message": "a|b"}


def test_a_torn_line_costs_only_itself(tmp_path):
    rows = homes.rows_in(tmp_path)
    rows.append(RECORD)
    with (tmp_path / "episodes.jsonl").open("a") as file:
        file.write('{"building": "stu')
    rows.append(FAILED)
    assert rows.load() == [RECORD, FAILED]


def test_the_table_counts_what_is_there():
    page = homes.table([RECORD, FAILED, RECORD | {"target": "couch", "skipped": "no couch"}], "command")
    assert "| surveillance on | 1 | 100.0 % |" in page
    assert "| surveillance off | 1 | 0.0 % |" in page
    assert "| tv | 1/1 | 50.0 | 0/1 | 0.0 |" in page
    assert "| not_found | 0 | 1 |" in page
    assert "off: not_found (a/b)" in page
    assert "no couch" in page


def test_other_settings_need_another_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(homes, "_work", None)
    arguments = ["--out", str(tmp_path), "--table"]
    assert homes.main(arguments) == 0
    assert homes.main(arguments) == 0
    with pytest.raises(homes.ConfigError, match="max_steps"):
        homes.main([*arguments, "--max-steps", "50"])
    (tmp_path / "settings.json").write_text('{"perception": "onnx-coco", "max_steps": 500}')
    with pytest.raises(homes.ConfigError, match="views_per_step"):  # made when all views were looked at first
        homes.main(arguments)
