"""Names files above 1 MB among its arguments, and then fails: they stay in git's history for ever. A pre-commit hook."""

from __future__ import annotations

import sys
from pathlib import Path

MOST_BYTES = 1_000_000

if __name__ == "__main__":
    large = [path for path in map(Path, sys.argv[1:]) if path.is_file() and path.stat().st_size > MOST_BYTES]
    for path in large:
        print(
            f"{path} has {path.stat().st_size / 1e6:.1f} MB; keep it elsewhere, or except it in .pre-commit-config.yaml"
        )
    sys.exit(bool(large))
