"""The how-tos are run as they stand, on a real system: what is fenced as bash or python has to work."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs/use").glob("*.md"))
FENCED = re.compile(r"^```(bash|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
HOWTOS = [page for page in PAGES if FENCED.search(page.read_text(encoding="utf-8"))]
# rest.md's example waits for an end that only a made-up building has at hand (tests/services/gateway runs it);
# models.md needs PyTorch.
NOT_HERE = {"rest.md", "models.md"}


def scripts(page: Path, port: int) -> list[tuple[str, str]]:
    """(language, code) of a page: all bash is one script, as the reader has one shell; each Python block is one."""
    text = re.sub(r"(localhost|127\.0\.0\.1):8080", rf"\1:{port}", page.read_text(encoding="utf-8"))
    blocks = FENCED.findall(text)
    shell = "".join(code for language, code in blocks if language == "bash")
    return [("bash", shell)] * bool(shell) + [(language, code) for language, code in blocks if language == "python"]


@pytest.fixture
def place(tmp_path, home_cache, flat, monkeypatch):
    """A folder to work in, with `surveilnav` and `python` on the path, and the running system as the gateway."""
    bin = tmp_path / "bin"
    bin.mkdir()
    for name, arguments in (("surveilnav", "-m surveilnav.cli.main"), ("python", "")):
        (bin / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments} "$@"\n')
        (bin / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{bin}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'shared'}")
    monkeypatch.setenv("SURVEILNAV_URL", f"http://127.0.0.1:{flat.gateway_port}")
    monkeypatch.setenv("SURVEILNAV_SIM__LIGHTING", "flat")
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    (tmp_path / "work").mkdir()
    return tmp_path / "work"


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", [page for page in HOWTOS if page.name not in NOT_HERE], ids=lambda page: page.stem)
def test_a_howto_works_as_it_stands(page, place, flat):
    for language, code in scripts(page, flat.gateway_port):
        command = ["bash", "-euxo", "pipefail", "-c", code] if language == "bash" else [sys.executable, "-c", code]
        run = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=300, check=False)
        assert run.returncode == 0, f"{code}\n{run.stdout[-3000:]}\n{run.stderr[-3000:]}"
        assert "Traceback" not in run.stderr


def test_the_pages_are_found_and_a_broken_command_would_be():
    assert {"rest-howto", "building", "command-line"} <= {page.stem for page in HOWTOS}
    text = FENCED.findall("```bash\nfalse\n```\n```\nnot run\n```\n```python\n1 / 0\n```\n")
    assert text == [("bash", "false\n"), ("python", "1 / 0\n")]
