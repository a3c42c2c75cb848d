"""``docker compose`` on a real engine, for the tests of the compose files."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

ROOT = Path(__file__).parents[2]
UP_S, MISSION_S = 1200, 300
_FINISHED = ("done", "failed", "cancelled")


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

    def compose(self, *arguments: str, timeout_s: float = 60.0) -> str:
        done = subprocess.run(
            [
                "docker",
                "compose",
                *self._files,
                "--project-name",
                self._project,
                "--progress",
                "quiet",
                *arguments,
            ],
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
            found: dict[str, Any] = self.get(f"/api/v1/missions/{mission}")
            if found["state"] in _FINISHED:
                return found
            time.sleep(0.5)
        pytest.fail(f"the mission is still {found} after {MISSION_S} s\n{self.state()}")
