"""Runs one camera of cameras.yaml. A change of its entry takes effect within seconds, without a restart of anything else."""

from __future__ import annotations

import os
import time
from pathlib import Path

import structlog

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import exit_on_sigterm
from surveilnav.cameras_file import CameraEntry, CamerasFile, load_cameras
from surveilnav.cameras_file.urls import shown
from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.reader import FrameReader
from surveilnav.services.camera_node.sources.stream import StreamSource
from surveilnav.services.camera_node.taking import take_camera

_LOOK_AT_FILE_S = 2.0


def run_real_camera(settings: CameraSettings, bus: BusSettings) -> None:
    """Runs one camera of ``settings.file`` until SIGTERM.

    Raises:
        ConfigError: the file can't be read, or the camera that the settings name has a mistake in it.
    """
    path = Path(settings.file)
    changed = True
    while changed:
        exit_on_sigterm()
        _report_problems(load_cameras(path), settings.id)
        with take_camera(settings.id, lambda: list(load_cameras(path).cameras), str(path), bus) as (name, node):
            file = load_cameras(path)
            entry = file.cameras.get(name)  # None: it was removed while it was being taken
            changed = entry is None or _run(file, entry, node, settings)


def _report_problems(file: CamerasFile, camera: str) -> None:
    """Writes the mistakes in the file to the log. ConfigError: the camera that this process is to run has one."""
    log = structlog.get_logger()
    for problem in file.problems:
        if camera and problem.camera == camera:
            raise ConfigError(f"{file.path}, {problem}")
        log.warning("a mistake in the file of cameras", file=str(file.path), mistake=str(problem))


def _run(file: CamerasFile, entry: CameraEntry, node: Node, settings: CameraSettings) -> bool:
    """Runs a camera until SIGTERM or until its entry in the file has changed; returns whether it has."""

    def make_reader() -> FrameReader:
        size_px = entry.lens.width_px, entry.lens.height_px
        return choose_reader(entry.stream, file.path.parent, os.environ, size_px, 1.0 / entry.max_hz)

    try:
        make_reader()
        source = StreamSource(
            entry, file.floors[entry.floor].z_m, make_reader, settings.max_age_s, lambda text: node.log.warning(text)
        )
    except (ValueError, ConfigError) as error:
        raise ConfigError(f"{file.path}: camera {entry.name}: {error}") from None
    watcher = _EntryWatcher(file, entry)
    node.log.info("reads a stream", stream=shown(entry.stream), views=len(source.views))
    service = CameraService(node, source, settings)

    def step() -> bool:
        if watcher.changed():
            node.log.info("its entry in the file of cameras has changed")
            node.stop()
        return service.step()

    source.start()
    try:
        node.run(step, idle_s=0.05)
    finally:
        source.close()
    return watcher.has_changed


class _EntryWatcher:
    """Notices that a camera's entry in the file has changed or is gone. A file or an entry with a mistake changes nothing."""

    def __init__(self, file: CamerasFile, entry: CameraEntry) -> None:
        self._file, self._entry = file, entry
        self._stamp = _stamp(file.path)
        self._looked_s = time.monotonic()
        self.has_changed = False

    def changed(self) -> bool:
        """Whether the entry is another one now; the file is read at most every two seconds."""
        now_s = time.monotonic()
        if now_s - self._looked_s < _LOOK_AT_FILE_S:
            return self.has_changed
        self._looked_s = now_s
        stamp = _stamp(self._file.path)
        if stamp != self._stamp:
            self._stamp = stamp
            self.has_changed = self._differs()
        return self.has_changed

    def _differs(self) -> bool:
        try:
            file = load_cameras(self._file.path)
        except ConfigError as error:
            structlog.get_logger().warning("the changed file of cameras isn't used", error=str(error))
            return False
        entry = file.cameras.get(self._entry.name)
        if entry is None:
            mistakes = [str(p) for p in file.problems if p.camera == self._entry.name]
            for mistake in mistakes:
                structlog.get_logger().warning("the changed entry isn't used", mistake=mistake)
            return not mistakes  # it was removed
        return entry != self._entry or file.floors[entry.floor] != self._file.floors[self._entry.floor]


def _stamp(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0
    return status.st_mtime_ns, status.st_size
