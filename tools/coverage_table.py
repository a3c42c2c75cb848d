"""Prints line coverage by package, from the .coverage file that `make coverage` wrote."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path, PurePosixPath


def package_of(file: str) -> str:
    """Which line of the table a file counts for: "services/fusion", "shared/surveilnav/bus", "cli"."""
    folders = PurePosixPath(file).parent.parts
    return "/".join(folders[: {"shared": 3, "services": 2}.get(folders[0], 1)])


def table(files: dict[str, tuple[int, int]]) -> list[str]:
    """Lines of text from (statements run, statements) of each file: a line a package, and the total."""
    sums: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for file, counts in files.items():
        for name in (package_of(file), "total"):
            sums[name][0] += counts[0]
            sums[name][1] += counts[1]
    width = max(map(len, sums))
    names = [*sorted(sums.keys() - {"total"}), "total"]
    rows = (
        f"{name:{width}}  {sums[name][1]:6}  {100 * sums[name][0] / max(sums[name][1], 1):4.0f} %" for name in names
    )
    return [f"{'coverage of':{width}}   lines    run", *rows]


def main() -> None:
    """Reads what coverage.py measured; its own report has a line for each of 400 files."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "coverage.json"
        subprocess.run([sys.executable, "-m", "coverage", "json", "-q", "-o", str(report)], check=True)
        measured = json.loads(report.read_text(encoding="utf-8"))["files"]
    counts = {file: (m["summary"]["covered_lines"], m["summary"]["num_statements"]) for file, m in measured.items()}
    print("\n".join(table(counts)))


if __name__ == "__main__":
    main()
