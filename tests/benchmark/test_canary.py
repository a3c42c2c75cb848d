"""The golden run: what its digest covers, and that it fails when a search goes another way."""

from __future__ import annotations

import msgspec
import pytest

from surveilnav.benchmark import canary
from surveilnav.errors import ConfigError

SHORT = next(s for s in canary.read().searches if s.name == "few steps")


def test_the_searches_are_a_dozen_and_most_gate():
    searches = canary.read().searches
    assert len({s.name for s in searches}) == len(searches) >= 12
    assert [s.name for s in searches if s.did is None] == [s.name for s in searches if canary.needs_weights(s)]
    assert canary.digest() == canary.digest_of(searches)


@pytest.mark.parametrize("field", ["success", "steps", "path_mm", "reason", "actions"])
def test_the_digest_covers_what_a_search_did(field):
    other = {"success": True, "steps": 41, "path_mm": 3001, "reason": "stuck", "actions": "F"}[field]
    changed = msgspec.structs.replace(SHORT, did=msgspec.structs.replace(SHORT.did, **{field: other}))
    assert canary.digest_of([changed]) != canary.digest_of([SHORT])


def test_a_file_that_was_edited_is_refused(tmp_path):
    file = tmp_path / "canary.json"
    file.write_bytes(canary.FILE.read_bytes().replace(b'"steps": 40', b'"steps": 41'))
    with pytest.raises(ConfigError, match="was it edited"):
        canary.read(file)


@pytest.mark.assets
def test_a_search_goes_as_written_and_a_constant_of_the_planner_turns_it(capsys):
    assert canary.main(["few steps", "--workers", "1"]) == 0
    assert "the same" in capsys.readouterr().out
    other = canary.play(msgspec.structs.replace(SHORT, run={**SHORT.run, "planning": {"scan_turns": 3}}))
    assert other.actions != SHORT.did.actions


def test_an_unknown_search_is_named(capsys):
    with pytest.raises(SystemExit):
        canary.main(["no such search"])
    assert "few steps" in capsys.readouterr().err


@pytest.mark.parametrize("more", [["few steps"], ["--no-pixels"]])
def test_all_searches_are_renewed_or_none(more, capsys):
    with pytest.raises(SystemExit):
        canary.main(["--renew", *more])
    assert "name none" in capsys.readouterr().err
