"""The two commands of the README, and a user's mistakes: one clear line, no traceback, a non-zero exit."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from surveilnav.bus.router import free_port, open_router

ROOT = Path(__file__).parents[2]


def surveilnav(*arguments: str, cache: Path, timeout_s: float = 200, **env: str) -> subprocess.CompletedProcess[str]:
    variables = {**os.environ, "SURVEILNAV_SIM__LIGHTING": "flat", "SURVEILNAV_CACHE_DIR": str(cache), **env}
    return subprocess.run(
        [sys.executable, "-m", "surveilnav.cli.main", *arguments],
        cwd=ROOT,
        env=variables,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


@pytest.mark.slow
def test_demo_finds_its_target_and_says_so_as_json(tmp_path, home_cache):
    run = surveilnav(
        "demo",
        "--building",
        "parametric_flat",
        "--target",
        "tv",
        "--perception",
        "oracle",
        "--cameras",
        "2",
        "--json",
        "--runs",
        str(tmp_path / "runs"),
        cache=home_cache,
    )
    assert run.returncode == 0, run.stderr
    outcome = json.loads(run.stdout)
    assert outcome["found"] is True
    assert outcome["success"] is True
    assert 0 < outcome["spl"] <= 1
    assert 5 <= outcome["shortest_path_m"] <= outcome["path_m"] + 0.3
    assert outcome["perception"] == "oracle"
    assert outcome["cameras"] == 2
    assert outcome["invoked_cameras"] == ["c0-1", "c0-2"]
    assert set(outcome["traffic"]) == {"offered", "delivered", "wire"}
    assert all(n > 1_000_000 for n in outcome["traffic"].values())
    report = Path(outcome["report"])
    page = report.read_text()
    assert "<svg" in page
    assert not re.search(r"(src|href)=[\"']https?:", page), "the report loads nothing from elsewhere"
    assert json.loads((report.parent / "run.json").read_text())["steps"] == outcome["steps"]


@pytest.mark.slow
def test_demo_without_surveillance_uses_no_camera(tmp_path, home_cache):
    run = surveilnav(
        "demo",
        "--building",
        "parametric_flat",
        "--target",
        "bed",
        "--perception",
        "oracle",
        "--surveillance",
        "off",
        "--max-steps",
        "20",
        "--json",
        "--runs",
        str(tmp_path / "runs"),
        cache=home_cache,
    )
    outcome = json.loads(run.stdout)
    assert outcome["cameras"] == 0
    assert outcome["invoked_cameras"] == []
    assert run.returncode == (0 if outcome["success"] else 1)


def bad_home(case: str, path: Path) -> str:
    """Writes a file that is no home; what the message must name."""
    if case == "entities":
        bomb = '<!DOCTYPE h [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><home version="7000" name="&b;"/>'
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("Home.xml", bomb)
        return "entit|DTD|DOCTYPE"
    if case == "zip bomb":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("Home.xml", b" " * 400_000_000)
        return "larg|big|bytes|MB|limit|unpack"
    path.write_bytes({"text": b"hello", "empty": b"", "truncated": b"PK\x03\x04 and no more"}[case])
    return "sh3d|zip|Home.xml|home"


@pytest.mark.parametrize("case", ["text", "empty", "truncated", "entities", "zip bomb"])
def test_hostile_homes_are_refused_in_one_line(tmp_path, case):
    path = tmp_path / f"{case.replace(' ', '-')}.sh3d"
    names = bad_home(case, path)
    run = surveilnav("demo", "--building", str(path), "--target", "tv", cache=tmp_path / "cache")
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    said = " ".join(run.stderr.split()).partition("error: ")[2].replace(str(path), "")
    assert re.search(names, said), run.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--building", "atlantis"), "atlantis.*parametric_flat"),
        (("--building", "parametric_flat", "--target", "unicorn"), "unicorn.*robots can get to.*couch"),
        (("--building", "parametric_flat", "--target", "tv", "--perception", "psychic"), "psychic"),
        (("--building", "/nowhere/home.sh3d"), "/nowhere/home.sh3d"),
    ],
)
def test_mistakes_are_explained(tmp_path, home_cache, arguments, words):
    run = surveilnav("demo", *arguments, "--runs", str(tmp_path / "runs"), cache=home_cache)
    assert run.returncode in (1, 2)  # 2: what the command line itself refuses
    assert "Traceback" not in run.stderr
    assert re.search(words, " ".join(run.stderr.split())), run.stderr


def test_a_taken_port_is_named(tmp_path):
    port = free_port()
    with open_router(f"tcp/127.0.0.1:{port}"):
        run = surveilnav(
            "up",
            "--building",
            "parametric_flat",
            "--cameras",
            "0",
            "--router",
            f"tcp/127.0.0.1:{port}",
            "--logs",
            str(tmp_path / "logs"),
            cache=tmp_path / "cache",
        )
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    assert re.search(rf"port {port} .*taken", " ".join(run.stderr.split())), run.stderr


def test_find_without_a_system_says_how_to_start_one(tmp_path):
    run = surveilnav("find", "tv", "--url", f"http://127.0.0.1:{free_port()}", cache=tmp_path / "cache")
    assert run.returncode == 1
    assert "surveilnav up" in run.stderr
    assert "Traceback" not in run.stderr
