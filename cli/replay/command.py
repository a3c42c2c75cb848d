"""``surveilnav replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surveilnav.cli.extras import needs
from surveilnav.cli.options import AsJson, console, print_result, results


@needs("services")
def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording (.mcap); an interrupted one will do.")],
    speed: Annotated[  # the limits of surveilnav.messages, which help shan't wait for
        float, typer.Option(min=0.01, max=1000, metavar="N", help="How many times as fast as it happened.")
    ] = 1.0,
    port: Annotated[int, typer.Option(min=1, max=65535, metavar="N", help="The gateway's port.")] = 8080,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Only make the maps again and compare them with the recorded ones. Exit 0 only if they are the same.",
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show a recorded search again, on the page and by REST, until Ctrl-C."""
    if not check:
        from surveilnav.cli.replay.play import run_replay

        run_replay(console, file, speed=speed, port=port)
        return
    from surveilnav.cli.replay.check import check as compare

    outcome = compare(file)
    print_result(outcome.as_dict(), as_json, lambda: results.print(outcome.in_words(), markup=False))
    raise typer.Exit(0 if outcome.same else 1)
