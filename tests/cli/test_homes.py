"""``surveilnav homes``: whatever lies in a folder, there is a line for it."""

from __future__ import annotations

import io
import json
import zipfile

import pytest
from rich.console import Console
from typer.testing import CliRunner

import surveilnav.cli.homes
import surveilnav.simulator.sources
from surveilnav.cli.homes import as_dict, homes_in, show, survey_folder
from surveilnav.cli.main import app
from surveilnav.errors import AssetError, ConfigError

PLAN = """<?xml version='1.0'?>
<home version='6200' wallHeight='250'>
  <room id='r1' name='Hall'><point x='0' y='0'/><point x='600' y='0'/><point x='600' y='400'/><point x='0' y='400'/></room>
  <wall id='w0' xStart='0' yStart='0' xEnd='600' yEnd='0' height='250' thickness='10'/>
  <wall id='w1' xStart='600' yStart='0' xEnd='600' yEnd='400' height='250' thickness='10'/>
  <wall id='w2' xStart='600' yStart='400' xEnd='0' yEnd='400' height='250' thickness='10'/>
  <wall id='w3' xStart='0' yStart='400' xEnd='0' yEnd='0' height='250' thickness='10'/>
  {more}
</home>"""
SHUT = "<wall id='w4' xStart='420' yStart='0' xEnd='420' yEnd='400' height='250' thickness='10'/>"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A good plan, one with a shut-off half, an old one, a broken mesh, a file that is none, and an empty HM3D folder."""

    def refuse(*_, **__):
        raise AssetError("none here")

    monkeypatch.setattr(surveilnav.simulator.sources, "ensure_assets", refuse)  # walls need no furniture
    homes = tmp_path / "homes"
    (homes / "deep" / "deeper").mkdir(parents=True)
    (homes / "deep" / "deeper" / "Home.xml").write_text(PLAN.format(more=""))
    for name, member, content in (("shut", "Home.xml", PLAN.format(more=SHUT)), ("old", "Home", "\xac\xed")):
        with zipfile.ZipFile(homes / f"{name}.sh3d", "w") as file:
            file.writestr(member, content)
    (homes / "broken.glb").write_bytes(b"glTF and then nothing")
    (homes / "notes.txt").write_text("no home")
    (homes / "00800-abcd").mkdir()
    (homes / "00800-abcd" / "other.glb").write_bytes(b"")
    return homes


NAMES = ["00800-abcd", "broken.glb", "deep/deeper/Home.xml", "old.sh3d", "shut.sh3d"]


def test_every_file_has_a_line_whatever_it_holds(folder):
    told = []
    lines = survey_folder(folder, lambda *about: told.append(about))
    assert [line.file for line in lines] == NAMES
    assert told == [*((n, 5, name) for n, name in enumerate(NAMES)), (5, 5, "")]
    said = {line.file: as_dict(line) for line in lines}
    assert "has no abcd.glb" in said["00800-abcd"]["error"]
    assert said["old.sh3d"]["error"]
    assert said["broken.glb"]["error"]
    whole, shut = said["deep/deeper/Home.xml"], said["shut.sh3d"]
    assert (whole["rooms"], whole["says"], whole["reached_m2"]) == (1, "", whole["free_m2"])
    assert whole["levels"] == [
        {"id": "0", "name": "Ground floor", "free_m2": whole["free_m2"], "reached_m2": whole["free_m2"]}
    ]
    assert shut["reached_m2"] < 0.75 * shut["free_m2"]
    assert shut["says"].endswith("m² of level 0 (Hall): walls stand between")


def test_a_bug_of_ours_is_a_line_too(folder, monkeypatch):
    def fail(*_, **__):
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(surveilnav.cli.homes, "survey", fail)
    errors = {line.file: line.error for line in survey_folder(folder)}
    assert errors["shut.sh3d"] == "can't be opened by a mistake of this program: ZeroDivisionError: by nothing"
    assert "mistake of this program" not in errors["old.sh3d"]


def test_the_command_says_it_as_one_object_or_as_a_table(folder):
    ran = CliRunner().invoke(app, ["homes", str(folder), "--json"])
    assert ran.exit_code == 0
    said = json.loads(ran.stdout)
    assert [home["file"] for home in said["homes"]] == NAMES
    assert CliRunner().invoke(app, ["homes", str(folder / "old.sh3d")]).exit_code == 1, "nothing could be read"
    console = Console(width=80, file=io.StringIO())
    show(survey_folder(folder), console)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= 80
    assert "2 of 5 files could be read" in text
    assert "shut.sh3d: robots reach" in text


def test_a_folder_without_homes_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"has no \.sh3d file"):
        homes_in(tmp_path)
    with pytest.raises(ConfigError, match="there is no"):
        homes_in(tmp_path / "nothing")
