"""A stack's folder in memory."""

from __future__ import annotations

from pathlib import Path

from surveilnav.cli import stack as stack_module
from surveilnav.cli.stack import Stack

BUS = {"SURVEILNAV_BUS__ROUTER": "tcp/127.0.0.1:7447", "SURVEILNAV_BUS__BUILDING": "b"}
HANDOVER = "SURVEILNAV_BUS__HANDOVER_FOLDER"


def test_two_stacks_of_one_router_have_folders_of_their_own_and_leave_none(tmp_path, monkeypatch):
    """The second ends because its port is taken; that must not take the first one's folder away."""
    monkeypatch.setattr(stack_module, "_IN_MEMORY", tmp_path)
    monkeypatch.setattr(Stack, "_programs", lambda self: {})
    monkeypatch.delenv(HANDOVER, raising=False)
    with Stack(BUS, tmp_path / "logs") as one:
        folder = Path(one.environment[HANDOVER])
        assert folder.stat().st_mode & 0o777 == 0o700
        with Stack(BUS, tmp_path / "logs") as other:
            assert other.environment[HANDOVER] != one.environment[HANDOVER]
        assert folder.is_dir()
    assert [path.name for path in tmp_path.iterdir()] == ["logs"]


def test_a_folder_that_the_environment_names_is_left_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(stack_module, "_IN_MEMORY", tmp_path)
    monkeypatch.setattr(Stack, "_programs", lambda self: {})
    (tmp_path / "mine").mkdir()
    monkeypatch.setenv(HANDOVER, str(tmp_path / "mine"))
    with Stack(BUS, tmp_path / "logs") as stack:
        assert HANDOVER not in stack.environment
    assert (tmp_path / "mine").is_dir()


def test_without_a_file_system_in_memory_everything_is_sent(tmp_path, monkeypatch):
    monkeypatch.setattr(stack_module, "_IN_MEMORY", tmp_path / "none")
    monkeypatch.setattr(Stack, "_programs", lambda self: {})
    with Stack(BUS, tmp_path / "logs") as stack:
        assert HANDOVER not in stack.environment
