"""The wheel is whole: installed apart from the checkout it plays a search, and without extras it asks a running system."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
import zipfile
from dataclasses import dataclass
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
    run = subprocess.run(play, cwd=tmp_path, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr
    assert "the same" in run.stdout
    code = "import surveilnav.benchmark as b; print(b.__file__)"
    where = subprocess.run([play[0], "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True)
    assert str(site) in where.stdout, "it must not run our checkout"


# --- the base installation, from a package registry ---------------------------------------------------------------

#: The client and the command line are to stay a small thing to install: packages of others, and megabytes in all.
MOST_PACKAGES = 25
MOST_MB = 60


@dataclass(frozen=True)
class Installed:
    """An environment that had nothing, after ``pip install surveilnav``."""

    folder: Path

    @property
    def site(self) -> Path:
        (site,) = self.folder.glob("lib/python*/site-packages")
        return site

    def packages(self) -> list[str]:
        return sorted(path.name.partition("-")[0] for path in self.site.glob("*.dist-info"))

    def megabytes(self) -> float:
        return sum(path.stat().st_size for path in self.site.rglob("*") if path.is_file()) / 1e6

    def surveilnav(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Runs the command in the folder of the environment, which is no checkout."""
        command = [str(self.folder / "bin" / "surveilnav"), *arguments]
        return subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=100, check=False)


def pip(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pip", *arguments, "-q", "--retries", "1", "--timeout", "10"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=250, check=False)


@pytest.fixture(scope="module")
def base(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The wheel without extras, and what pip brings along. Skips where no package registry can be reached."""
    folder = tmp_path_factory.mktemp("base") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, timeout=60)
    pinned = ["-c", str(ROOT / "constraints.txt")]
    run = pip("--python", str(folder / "bin" / "python"), "install", *pinned, str(wheel))
    if run.returncode:
        tried = pip("download", "--no-deps", "--no-cache-dir", *pinned, "-d", str(folder), "typing-extensions")
        if tried.returncode:  # nor can a package be had that surely exists
            pytest.skip("no package registry can be reached: pip finds no typing-extensions either")
        pytest.fail(run.stderr)
    return Installed(folder)


@pytest.mark.slow
def test_a_base_installation_is_small_and_takes_one_name(base: Installed) -> None:
    packages, megabytes = base.packages(), base.megabytes()
    print(f"pip install surveilnav: {len(packages)} packages, {megabytes:.0f} MB: {', '.join(packages)}")
    assert len(packages) - 1 <= MOST_PACKAGES, packages
    assert megabytes <= MOST_MB
    (record,) = base.site.glob("surveilnav-*.dist-info/RECORD")
    tops = {line.partition("/")[0] for line in record.read_text().splitlines() if not line.startswith("..")}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"surveilnav"}
    assert (base.site / "surveilnav" / "py.typed").exists()


@pytest.mark.slow
def test_a_base_installation_asks_a_running_system(base: Installed, running) -> None:
    """Every command that needs no extra, as people and as programs read it."""
    url = ["--url", f"http://127.0.0.1:{running.gateway_port}"]
    status = base.surveilnav("status", "--json", *url)
    assert status.returncode == 0, status.stderr
    assert [camera["id"] for camera in json.loads(status.stdout)["cameras"]["items"]] == ["c0-1"]
    short = ["--max-steps", "8", "--queue"]  # it needn't find anything; and the planner may not have met the robot yet
    found = base.surveilnav("find", "tv", *short, "--json", *url)
    assert "Traceback" not in found.stderr
    mission = json.loads(found.stdout)["id"]
    commands = [
        ["status"],
        ["missions"],
        ["missions", "show", mission],
        ["cameras"],
        ["objects"],
        ["map"],
        ["map", "value"],
        ["map", "--out", "map.npy"],
        ["traffic"],
        ["traffic", "--mission", mission],
        ["stop"],
        ["release"],
    ]
    wrong = {}
    for command in commands:
        run = base.surveilnav(*command, *url)
        if run.returncode or "Traceback" in run.stderr or not (run.stdout + run.stderr).strip():
            wrong[" ".join(command)] = run.stderr or run.stdout
    assert wrong == {}
    assert "#" in base.surveilnav("map", *url).stdout
    watch = [str(base.folder / "bin" / "surveilnav"), "watch", "--json", *url]
    with subprocess.Popen(watch, cwd=base.folder, stdout=subprocess.PIPE, text=True) as watching:
        assert watching.stdout is not None
        assert watching.stdout.readline().startswith('{"id": "')
        watching.terminate()
    assert (base.folder / "map.npy").read_bytes().startswith(b"\x93NUMPY")


@pytest.mark.slow
@pytest.mark.parametrize(("command", "extra"), [("up", "simulator"), ("demo", "simulator"), ("replay x", "services")])
def test_what_a_base_installation_cant_run_names_its_extra(base: Installed, command: str, extra: str) -> None:
    run = base.surveilnav(*command.split())
    assert run.returncode == 1
    assert f"pip install 'surveilnav[{extra}]'" in run.stderr
    assert "Traceback" not in run.stderr
