"""The wheel is whole: built, installed apart from the checkout, it plays a search."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    out = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(out), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True, text=True, timeout=120)
    (built,) = out.glob("*.whl")
    return built


def test_every_package_and_all_its_data_are_in_the_wheel(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split(
        "\n"
    )
    ours = {name for name in tracked if name.startswith(("shared/", "simulator/", "services/", "cli/", "benchmark/"))}
    files = {name for name in ours if (ROOT / name).is_file()}
    assert {f"surveilnav/{name.removeprefix('shared/surveilnav/')}" for name in files} <= inside
    assert {name.partition("/")[0] for name in inside if ".dist-info/" not in name} == {"surveilnav"}


@pytest.mark.slow
def test_installed_apart_from_the_checkout_it_plays_a_search(wheel: Path, tmp_path: Path) -> None:
    """In an environment of its own, which has the packages that ours depends on, but not our checkout."""
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True, timeout=60)
    (site,) = venv.glob("lib/python*/site-packages")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(venv / "bin" / "python"),
        "install",
        "-q",
        "--no-deps",
        "--no-index",
    ]
    subprocess.run([*pip, str(wheel)], check=True, capture_output=True, text=True, timeout=120)
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")  # its own .pth files aren't read
    script = [str(venv / "bin" / "surveilnav"), "models", "list", "--json"]
    listed = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True)
    assert "grounding-dino-tiny" in listed.stdout
    play = [str(venv / "bin" / "python"), "-m", "surveilnav.benchmark.canary", "with cameras", "--workers", "1"]
    run = subprocess.run(play, cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert run.returncode == 0, run.stderr
    assert "the same" in run.stdout
    code = "import surveilnav.benchmark as b; print(b.__file__)"
    where = subprocess.run([play[0], "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True)
    assert str(site) in where.stdout, "it must not run our checkout"
