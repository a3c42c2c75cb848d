"""What the fuzzer plays: targets, each of which makes an input from chance and has the code under test process it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, Literal

from surveilnav.errors import SurveilNavError, WireError
from tests.fuzz.values import Values

#: What became of an input: its schema refused it (or the first look at a file), the code behind that did, or it was taken.
Outcome = Literal["stopped", "refused", "taken"]


class Target(ABC):
    """One decoder or reader with the code behind it.

    Attributes:
        name: in reports.
        share: how often it is played, beside the others.
        documented: the errors that the code may raise for an input, beside ``SurveilNavError``.
    """

    name: ClassVar[str]
    share: ClassVar[int] = 10
    documented: ClassVar[tuple[type[Exception], ...]] = ()

    def play(self, values: Values) -> Outcome:
        """Makes an input and has it processed. Any exception is a defect of the code under test."""
        try:
            with passes_schema():
                data = self.input(values)
        except _StoppedError:
            return "stopped"
        try:
            return "taken" if self.process(data, values) is not False else "refused"
        except (SurveilNavError, *self.documented):
            return "refused"

    @abstractmethod
    def input(self, values: Values) -> object:
        """An input that has passed the check of its schema. Raises WireError where it didn't pass."""

    @abstractmethod
    def process(self, data: object, values: Values) -> bool | None:
        """Has the code under test process the input; False if that refused it without an exception."""

    def check(self) -> None:  # noqa: B027  # most leave nothing behind
        """AssertionError: something was left behind that mustn't be. Called now and then."""


class _StoppedError(Exception):
    """The schema refused an input."""


@contextmanager
def passes_schema() -> Iterator[None]:
    try:
        yield
    except WireError as error:
        raise _StoppedError from error
    except OverflowError as error:  # MessagePack has no such number: it can't be sent
        raise _StoppedError from error
