"""Runs one camera of cameras.yaml. A change of its entry takes effect within seconds, without a restart of anything else."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import structlog

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.main import exit_on_sigterm
from surveilnav.cameras_file import CameraEntry, CamerasFile, load_cameras
from surveilnav.cameras_file.urls import shown
from surveilnav.errors import ConfigError
from surveilnav.perception.backend import Backend
from surveilnav.perception.depth import DepthEstimator, DepthNetwork
from surveilnav.perception.depth.fitted import FittedDepth
from surveilnav.perception.depth.reference import LOWEST_M
from surveilnav.perception.parts import load_depth_model
from surveilnav.perception.runtime import Runtime
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.reader import FrameReader
from surveilnav.services.camera_node.sources.stream import StreamSource
from surveilnav.services.camera_node.taking import take_camera
from surveilnav.storage import file_stamp

_LOOK_AT_FILE_S = 2.0


def run_real_camera(settings: CameraSettings, bus: BusSettings) -> None:
    """Runs one camera of ``settings.file`` until SIGTERM.

    Raises:
        ConfigError: the file can't be read, or the camera that the settings name has a mistake in it.
    """
    watched = _WatchedFile(Path(settings.file))
    changed = True
    while changed:
        exit_on_sigterm()
        watched.reload_if_changed()
        _report_problems(watched.file, settings.id)
        with take_camera(settings.id, watched.names, settings.file, bus) as (name, node):
            changed = _run(watched, name, node, settings)


def _report_problems(file: CamerasFile, camera: str) -> None:
    """Writes the mistakes in the file to the log. ConfigError: the camera that this process is to run has one."""
    log = structlog.get_logger()
    for problem in file.problems:
        if camera and problem.camera == camera:
            raise ConfigError(f"{file.path}, {problem}")
        log.warning("a mistake in the file of cameras", file=str(file.path), mistake=str(problem))


def _run(watched: _WatchedFile, name: str, node: Node, settings: CameraSettings) -> bool:
    """Runs a camera until SIGTERM or until its entry in the file has changed; returns whether it has."""
    file, entry = watched.file, watched.file.cameras[name]

    def make_reader() -> FrameReader:
        size_px = entry.lens.width_px, entry.lens.height_px
        return choose_reader(entry.stream, file.path.parent, os.environ, size_px, 1.0 / entry.max_hz)

    try:
        make_reader()
        source = StreamSource(
            entry,
            file.floors[entry.floor].z_m,
            make_reader,
            settings.max_age_s,
            lambda text: node.log.warning(text),
            _depth_estimator(settings, entry, file.floors[entry.floor].z_m, lambda text: node.log.info(text)),
        )
    except (ValueError, ConfigError) as error:
        raise ConfigError(f"{file.path}: camera {entry.name}: {error}") from None
    watcher = _EntryWatcher(watched, name)
    node.log.info("reads a stream", stream=shown(entry.stream), views=len(source.views))
    service = CameraService(node, source, settings, OwnPerception(source, partial(_own_backend, settings)))

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


def _own_backend(settings: CameraSettings) -> Backend:
    from surveilnav.perception.choose import choose_backend  # loads ONNX Runtime, which few cameras need
    from surveilnav.perception.presets import NetworkSettings

    return choose_backend(settings.perception, NetworkSettings(threads=settings.threads, download=settings.download))


def _depth_estimator(
    settings: CameraSettings, entry: CameraEntry, floor_z_m: float, report: Callable[[str], None]
) -> DepthEstimator | None:
    """What estimates the camera's depth; None if it isn't wanted, or if the camera hangs too low for it.

    ``report`` gets a line when depth is fitted to the floor.

    Raises:
        PerceptionError: the chosen network isn't on this machine or can't be loaded.
    """
    if settings.depth == "none" or entry.position_m[2] - floor_z_m < LOWEST_M:
        return None
    if settings.depth == "network":
        return DepthNetwork()
    model = load_depth_model(settings.depth_model, Runtime(threads=settings.threads), download=settings.download)
    return FittedDepth(model, report)


class _EntryWatcher:
    """Notices that a camera's entry in the file has changed or is gone. A file or an entry with a mistake changes nothing."""

    def __init__(self, watched: _WatchedFile, name: str) -> None:
        self._watched, self._name = watched, name
        self._running = watched.file
        self._looked_s = time.monotonic()
        self.has_changed = False

    def changed(self) -> bool:
        """Whether the entry is another one now; the file is read at most every two seconds."""
        now_s = time.monotonic()
        if now_s - self._looked_s < _LOOK_AT_FILE_S:
            return self.has_changed
        self._looked_s = now_s
        if self._watched.reload_if_changed():
            self.has_changed = self._differs(self._watched.file)
        return self.has_changed

    def _differs(self, file: CamerasFile) -> bool:
        entry, running = file.cameras.get(self._name), self._running.cameras[self._name]
        if entry is None:
            mistakes = [str(p) for p in file.problems if p.camera == self._name]
            for mistake in mistakes:
                structlog.get_logger().warning("the changed entry isn't used", mistake=mistake)
            return not mistakes  # it was removed
        return entry != running or file.floors[entry.floor] != self._running.floors[running.floor]


class _WatchedFile:
    """The file of cameras as it was last read. It is read again only after it has changed.

    Raises:
        ConfigError: nothing in it can be used.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._stamp = path, file_stamp(path)
        self.file = load_cameras(path)

    def reload_if_changed(self) -> bool:
        """Whether the file has changed and was read. If nothing in it can be used, ``file`` stays the former one."""
        if (stamp := file_stamp(self._path)) == self._stamp:
            return False
        self._stamp = stamp
        try:
            self.file = load_cameras(self._path)
        except ConfigError as error:
            structlog.get_logger().warning("the changed file of cameras isn't used", error=str(error))
            return False
        return True

    def names(self) -> list[str]:
        """The cameras of the file as it is now."""
        self.reload_if_changed()
        return list(self.file.cameras)
