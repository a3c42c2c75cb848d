"""The command starts at once: what takes time to load is loaded by the command that needs it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
HEAVY = ("numpy", "pydantic", "httpx", "zenoh", "msgspec", "numba", "onnxruntime")
OURS = ("surveilnav.simulator", "surveilnav.services", "surveilnav.benchmark", "surveilnav.bus")


def test_the_help_loads_nothing_that_takes_time():
    code = f"import sys, surveilnav.cli.main; print(*[name for name in {HEAVY + OURS!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


def test_the_shell_completes_commands():
    asked = {"_SURVEILNAV_COMPLETE": "complete_bash", "COMP_WORDS": "surveilnav mi", "COMP_CWORD": "1"}
    command = [sys.executable, "-m", "surveilnav.cli.main"]
    run = subprocess.run(command, cwd=ROOT, env=os.environ | asked, capture_output=True, text=True, check=False)
    assert run.stdout.split() == ["missions"]
