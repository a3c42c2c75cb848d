"""``surveilnav``: the command line. Each command is a function of its noun's file; what takes time to load, it loads itself."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperGroup

from surveilnav.cli import (
    backup,
    bench,
    cameras,
    dataset,
    map,
    missions,
    models,
    objects,
    robots,
    security,
    start,
    status,
    survey,
    traffic,
    watch,
    where,
)
from surveilnav.cli.building_setup.command import init
from surveilnav.cli.exits import Exit
from surveilnav.cli.replay.command import replay


class _Root(TyperGroup):
    """``--install-completion`` is for once: the last line of the help names it, and its table has one option less."""

    def get_params(self, ctx: Any) -> list[Any]:
        """As the base has them."""
        params: list[Any] = super().get_params(ctx)
        for param in params:
            if param.name in ("install_completion", "show_completion"):
                param.hidden = True
        return params


app = typer.Typer(
    name="surveilnav",
    cls=_Root,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Surveillance cameras and a robot search a building together.",
    epilog="Completion for your shell: [bold]surveilnav --install-completion[/]",
)

_REAL, _SIMULATED, _RUNNING = "A real building", "A simulated building", "The running system"
_BENCHMARK = "Models and benchmark"
_command: Callable[..., Any]
for _command in (init, survey.doctor):
    app.command(rich_help_panel=_REAL)(_command)
for _command in (start.demo, start.up, start.prepare, survey.buildings, survey.homes, replay):
    app.command(rich_help_panel=_SIMULATED)(_command)
app.command(rich_help_panel=_RUNNING)(missions.find)
app.add_typer(missions.app, name="missions", rich_help_panel=_RUNNING)
app.add_typer(cameras.app, name="cameras", rich_help_panel=_RUNNING)
app.add_typer(robots.app, name="robots", rich_help_panel=_RUNNING)
app.add_typer(traffic.app, name="traffic", rich_help_panel=_RUNNING)
for _command in (
    where.where,
    status.status,
    watch.watch,
    objects.objects,
    map.map_,
    robots.stop,
    robots.release,
    backup.backup,
    backup.restore,
):
    app.command(_command.__name__.rstrip("_"), rich_help_panel=_RUNNING)(_command)
app.add_typer(security.app, name="security", rich_help_panel=_RUNNING)
app.add_typer(models.app, name="models", rich_help_panel=_BENCHMARK)
app.add_typer(dataset.app, name="dataset", rich_help_panel=_BENCHMARK)
app.add_typer(bench.app, name="bench", rich_help_panel=_BENCHMARK)


def main() -> None:
    """The console script: a user's mistake is one line, never a traceback."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(Exit.TERMINATED))  # so that whatever was started is stopped
    as_json = "--json" in sys.argv[1:]
    try:
        code = app(prog_name="surveilnav", standalone_mode=False) or Exit.DONE
        sys.stdout.flush()
        sys.exit(code)
    except (KeyboardInterrupt, typer.Abort):
        print("interrupted", file=sys.stderr)
        sys.exit(Exit.INTERRUPTED)
    except BrokenPipeError:  # `surveilnav objects | head -1`: what is still in the buffer has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(Exit.FAILED)
    except Exception as error:
        sys.exit(_explained(error, as_json))


def _explained(error: Exception, as_json: bool) -> Exit:
    """Tells people, and with ``--json`` a program, what is wrong; a bug keeps its traceback."""
    from surveilnav.cli.mistakes import as_object, in_words, usage_of

    usage = usage_of(error)
    words = usage if usage is not None else in_words(error)
    if words is None:
        raise error
    if as_json:
        print(json.dumps(as_object(error, words)))
    if usage is not None:
        from typer.rich_utils import rich_format_error

        rich_format_error(error)  # type: ignore[arg-type]
        return Exit.MISTYPED
    print(words, file=sys.stderr)
    return Exit.FAILED


if __name__ == "__main__":
    main()
