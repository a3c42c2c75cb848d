"""``docker compose`` on a real engine, for the tests of the compose files."""

from __future__ import annotations

import ipaddress
import json
import os
import shutil
import socket
import subprocess
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from surveilnav.security.api_keys import ApiKeysFile
from surveilnav.security.folder import SecurityFolder
from surveilnav.security.identities import identity_from_name
from surveilnav.security.roles import Role
from tests.waiting import until

ROOT = Path(__file__).parents[2]
UP_S, MISSION_S = 1200, 300
_FINISHED = ("done", "failed", "cancelled")


#: The containers' user.
_USER = 10001


def create_security(folder: Path, names: Sequence[str], *, simulation: bool = False) -> dict[str, str]:
    """Identities, access rules and a key for each role, which the containers may read; returns the keys by role."""
    identities = [identity_from_name(name) for name in names]
    SecurityFolder.create(folder, "building", identities, ("router", "127.0.0.1"), simulation=simulation)
    file = ApiKeysFile(folder / "gateway" / "api_keys.json")
    keys = {role.name: file.add(role.name, role) for role in Role}
    for part in ("identities", "gateway"):
        for path in (folder / part).rglob("*"):
            shutil.chown(path, _USER, _USER)
    return keys


def missing() -> str:
    """Why there is no engine to test on; empty if there is one."""
    if shutil.which("docker") is None:
        return "no docker command: install Docker Engine with Compose v2"
    for command in (["docker", "info"], ["docker", "compose", "version"]):
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines() or ["no answer"]
            return f"`{' '.join(command)}` fails: {said[-1]}"
    return ""


def host_as_containers_see_it() -> str:
    """This machine's address on Docker's default network, which containers of other networks reach, too."""
    command = ["docker", "network", "inspect", "bridge", "--format", "{{json .IPAM.Config}}"]
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    network = json.loads(told)[0]
    # older engines name only the subnet, whose first address it is
    return str(network.get("Gateway") or next(ipaddress.ip_network(network["Subnet"]).hosts()))


class Stack:
    """``docker compose`` with a project, a port and settings of its own."""

    def __init__(self, models: Path, file: str = "compose.yaml", *over: str, **environment: str) -> None:
        """``over``: files that are laid over ``file``."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        self._project = f"surveilnav-test-{uuid.uuid4().hex[:8]}"
        self._files = [word for name in (file, *over) for word in ("--file", name)]
        self._environment = os.environ | environment
        self._environment |= {"SURVEILNAV_PORT": str(port), "SURVEILNAV_MODELS_DIR": str(models)}
        self.gateway = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0)

    def _command(self, *arguments: str) -> list[str]:
        return [
            "docker",
            "compose",
            *self._files,
            "--project-name",
            self._project,
            "--progress",
            "quiet",
            *arguments,
        ]

    def compose(self, *arguments: str, timeout_s: float = 60.0) -> str:
        done = subprocess.run(
            self._command(*arguments),
            cwd=ROOT,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
        )
        assert done.returncode == 0, (
            f"docker compose {' '.join(arguments)} failed:\n{(done.stdout + done.stderr)[-4000:]}"
        )
        return done.stdout

    @contextmanager
    def running(self, *scale: str) -> Iterator[Stack]:
        """Builds the images, brings everything up, and takes it down again. ``scale``: more arguments of ``up``."""
        try:
            self.compose("build", timeout_s=UP_S)
            try:
                self.compose("up", "--wait", *scale, timeout_s=UP_S)
            except AssertionError as error:
                raise AssertionError(f"{error}\n{self.state()}") from None
            yield self
        finally:
            self.compose("down", "--volumes", "--remove-orphans", "--timeout", "5", timeout_s=120)

    def scale(self, **counts: int) -> None:
        """Has so many containers of each service, and waits until all are healthy."""
        words = [word for name, n in counts.items() for word in ("--scale", f"{name}={n}")]
        self.compose("up", "--detach", "--wait", "--no-recreate", *words, timeout_s=UP_S)

    def kill(self, *services: str) -> None:
        """SIGKILL for the process of each service's first container, as a crash would; Docker starts it again."""
        for service in services:
            # the container's init ends with its child, and this command with the container
            command = ["exec", "-T", service, "sh", "-c", "kill -9 -1"]
            subprocess.run(self._command(*command), cwd=ROOT, env=self._environment, capture_output=True, timeout=60)

    def restarts(self) -> dict[str, int]:
        """How often Docker has started the containers of each service again."""
        counts: dict[str, int] = {}
        for container in self.containers():
            command = ["docker", "inspect", "--format", "{{.RestartCount}}", container["ID"]]
            n = int(subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout)
            counts[container["Service"]] = counts.get(container["Service"], 0) + n
        return counts

    def search(self, target: str, killed: Sequence[str] = ()) -> dict[str, Any]:
        """Searches for ``target`` until the end. Once the robot moves, the services in ``killed`` are killed."""
        answer = self.gateway.post("/api/v1/missions", json={"target": target, "max_steps": 200})
        assert answer.status_code == 202, answer.text
        mission = answer.json()["id"]
        if killed:
            until(lambda: self.get(f"/api/v1/missions/{mission}")["step"] > 0, "the robot never moved", MISSION_S)
            before = self.restarts()
            self.kill(*killed)
            ended = self.wait_for_end(mission)
            after = self.restarts()
            assert [s for s in after if after[s] > before[s]] == sorted(killed, key=list(after).index), self.state()
            return ended
        return self.wait_for_end(mission)

    def containers(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.compose("ps", "--all", "--format", "json").splitlines()]

    def state(self) -> str:
        """For people: every container's state, and the ends of the logs."""
        rows = [f"{c['Name']}: {c['Status']}" for c in self.containers()]
        return "\n".join([*rows, self.compose("logs", "--no-color", "--tail", "15")])

    def get(self, path: str) -> Any:
        return self.gateway.get(path).raise_for_status().json()

    def wait_for_end(self, mission: str) -> dict[str, Any]:
        deadline_s = time.monotonic() + MISSION_S
        while time.monotonic() < deadline_s:
            try:
                found: dict[str, Any] = self.get(f"/api/v1/missions/{mission}")
            except httpx.HTTPError:  # what answers may be killed just now
                found = {"state": "unknown"}
            if found["state"] in _FINISHED:
                return found
            time.sleep(0.5)
        pytest.fail(f"the mission is still {found} after {MISSION_S} s\n{self.state()}")
