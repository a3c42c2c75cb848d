"""Runs the robot of a robot file. A new ``T_building_map`` in the file takes effect within seconds, without a restart."""

from __future__ import annotations

from pathlib import Path

from surveilnav.bus import Node
from surveilnav.errors import ConfigError
from surveilnav.robot_file import RobotFile, load_robot
from surveilnav.ros2.session import RosSession
from surveilnav.services.robot_node.bodies.ros2.body import Ros2Body
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from surveilnav.storage import file_stamp


def run_real_robot(settings: RobotSettings) -> None:
    """Runs the robot of ``settings.file`` until SIGTERM.

    Raises:
        ConfigError: the file can't be read or used.
        RosError: no router of the robot can be reached.
    """
    path = Path(settings.file)
    file = load_robot(path)
    with Node("robot", settings.id) as node, _session(file, node) as session:
        body = Ros2Body(file, session)
        watched = _WatchedFrame(path, file)
        service = RobotService(node, body, settings)

        def step() -> bool:
            if watched.reload_if_changed(node):
                body.place.set_frame(watched.file.T_building_map.transform() if watched.file.T_building_map else None)
            return service.step()

        try:
            node.run(step)
        finally:
            body.halt()
            body.close()


def _session(file: RobotFile, node: Node) -> RosSession:
    def on_fault(text: str) -> None:
        node.warn_seldom("a message of the robot can't be read", why=text)

    return RosSession("surveilnav", router=file.router, domain=file.domain, namespace=file.namespace, on_fault=on_fault)


class _WatchedFrame:
    """Notices that the file has changed. ``file``: as it was last read."""

    def __init__(self, path: Path, file: RobotFile) -> None:
        self._path, self._stamp, self.file = path, file_stamp(path), file

    def reload_if_changed(self, node: Node) -> bool:
        """Whether the file has changed and was read. A file with a mistake changes nothing."""
        if (stamp := file_stamp(self._path)) == self._stamp:
            return False
        self._stamp = stamp
        try:
            changed = load_robot(self._path)
        except ConfigError as error:
            node.log.warning("the changed robot file isn't used", error=str(error))
            return False
        if changed.model_copy(update={"T_building_map": None}) != self.file.model_copy(update={"T_building_map": None}):
            node.log.warning("of the changed robot file only T_building_map is used; restart this service for the rest")
        self.file = changed
        return True
