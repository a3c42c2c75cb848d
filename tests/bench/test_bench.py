"""The steps of fusion's benchmark still run: they reach into cores whose functions change, and nothing else calls them."""

import subprocess
import sys
from pathlib import Path


def test_every_step_of_fusion_runs_beside_its_peers():
    script = Path(__file__).with_name("bench_fusion.py")
    once = ["--benchmark-disable", "-k", "not test_view", "-p", "no:cacheprovider"]  # whole views need its statistics
    command = [sys.executable, "-m", "pytest", "-q", *once, str(script)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=script.parents[2], timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
