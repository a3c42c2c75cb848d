"""The disk fills in mid-mission: whoever writes says so in `status`, the mission waits, and all heals once there is room."""

from __future__ import annotations

import io
import itertools
import mmap
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from rich.console import Console

from surveilnav.bus.router import free_port
from surveilnav.cli.status import everything, show_status
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.messages import FINISHED_STATES
from tests.waiting import until


class Disk:
    """A disk whose size can be changed: a tmpfs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self._mount("mount", "-t", "tmpfs", "-o", "size=4g", "tmpfs")

    def _mount(self, *command: str) -> None:
        subprocess.run([*command, str(self.folder)], check=True, capture_output=True)

    def fill(self) -> None:
        """Leaves no room at all."""

        def filled() -> bool:
            try:
                self._mount("mount", "-o", f"remount,size={shutil.disk_usage(self.folder).used}")
            except (
                subprocess.CalledProcessError
            ):  # somebody wrote meanwhile: so much doesn't fit into that size any more
                return False
            return True

        until(filled)

    def make_room(self) -> None:
        self._mount("mount", "-o", "remount,size=4g")

    def end(self) -> None:
        self._mount("umount", "--lazy")


def use_up_pages(folder: Path) -> None:
    """Has each file end with a page of the disk, so that one more line in it needs a new page. Empty lines are passed over."""
    for path in folder.iterdir():
        with path.open("ab") as file:
            file.write(b"\n" * (-path.stat().st_size % mmap.PAGESIZE))


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    try:
        found = Disk(tmp_path / "disk")
    except (subprocess.CalledProcessError, OSError):
        pytest.skip("only root may mount a disk")
    yield found
    found.end()


@pytest.mark.slow
def test_a_full_disk_is_named_harms_no_mission_and_heals(disk, system, tmp_path, monkeypatch):
    for name in ("state", "recordings", "looks"):
        (disk.folder / name).mkdir()
        (tmp_path / name).symlink_to(disk.folder / name)
    monkeypatch.setenv("SURVEILNAV_GATEWAY__ACCESS_LOG", str(disk.folder / "looks"))
    port = free_port()
    s = system(cameras=1, gateway_port=port, recorder=True)
    client, mission = Client(f"http://127.0.0.1:{port}"), "m1"
    s.search("tv", mission=mission)
    s.wait(lambda m: m.step >= 2, 90, mission)
    camera = s.building.plan.cameras[0].name

    def problems() -> dict[str, str]:
        return {f"{n.kind} {what}": why for n in client.traffic().nodes for what, why in n.problems.items()}

    views = itertools.count()

    def look() -> None:
        """Looks through another view each time: the same one counts once a minute, and that once may just find room."""
        with suppress(GatewayError):
            client.picture(camera, next(views) % 13)

    assert problems() == {}
    look()
    until(lambda: any((disk.folder / "looks").iterdir()))
    disk.fill()
    expected = {"fusion store", "recorder recordings", "gateway access log", "planner store"}

    def all_named() -> bool:
        disk.fill()  # again: what a store has freed meanwhile would be room for somebody else
        use_up_pages(disk.folder / "looks")
        look()
        with suppress(GatewayError):
            client.submit("bed", queue=True)  # refused while the planner can't write it
        return expected <= set(problems())

    until(all_named, lambda: f"{problems()}", 60)
    show_status(everything(client), Console(file=(shown := io.StringIO()), width=300))
    for name in ("fusion/fusion, store", "recordings: ", "access log: ", "planner/planner, store: "):
        assert name in shown.getvalue()
    held = s.status(mission)
    assert held.state not in FINISHED_STATES, held

    disk.make_room()
    until(lambda: not {"fusion store", "planner store", "gateway access log"} & set(problems()), problems, 30)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 180, mission)
    assert (ended.state, ended.found) == ("done", True), ended
    until(lambda: problems() == {}, problems, 30)  # the recorder's, with the mission that it couldn't record
    lines = "".join(file.read_text() for file in (disk.folder / "looks").iterdir())
    assert camera in lines, "what couldn't be written then was written later"
