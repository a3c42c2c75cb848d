"""What a base installation leaves out: commands that need an extra say which."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Literal, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Extra = Literal["services", "simulator", "bench"]


def needs(extra: Extra) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Marks a command that runs only with the packages of ``extra``, an optional dependency of pyproject.toml.

    Where a package is missing, the command raises MissingExtraError, which names the extra, in place of Python's
    ModuleNotFoundError. A module of our own that is missing is a bug and keeps its traceback.
    """

    def marked(command: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(command)
        def run(*args: P.args, **options: P.kwargs) -> R:
            try:
                return command(*args, **options)
            except ModuleNotFoundError as error:
                package = (error.name or "").partition(".")[0]
                if package in ("", "surveilnav"):
                    raise
                from surveilnav.errors import MissingExtraError

                raise MissingExtraError(
                    f"this command needs the extra [{extra}], of which {package} isn't installed: "
                    f"pip install 'surveilnav[{extra}]'. Commands that ask a running system work without it."
                ) from error

        return run

    return marked
