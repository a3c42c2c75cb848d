"""All backends that a simulated building can have: the library's, and those that only a simulator knows."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from surveilnav.errors import PerceptionError
from surveilnav.perception import choose as real
from surveilnav.perception.backend import Backend
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import NetworkSettings

BACKENDS: tuple[str, ...] = tuple(BackendName)


def choose_backend(
    name: str = "auto", *, seed: int = 0, harder: float = 0.0, simulated: bool = True, **networks: Any
) -> Backend:
    """The backend of that name; "auto" takes a real detector if one can run, else ``simulated`` and says so.

    Args:
        seed, harder: of ``simulated``.
        simulated: whether the building is: "auto" may then take what learnt from such ones.
        networks: see ``surveilnav.perception.presets.NetworkSettings``.

    Raises:
        PerceptionError: it can't run; the message says what is missing.
    """

    def oracle(why: str) -> Backend:
        with _needing_scipy():
            from surveilnav.simulator.truth.backends import Oracle
        return Oracle()

    def error_model(why: str) -> Backend:
        with _needing_scipy():
            from surveilnav.simulator.truth.backends import Simulated
        told = "the simulator's own instance ids through an error model"
        if name == "simulated":
            return Simulated(f"{why}: {told}", seed, harder=harder)
        return Simulated(f"{told} stand in, so these figures aren't a detector's. {why}", seed)

    others = {"oracle": oracle, "simulated": error_model}
    return real.choose_backend(
        name, NetworkSettings(**networks), simulated=simulated, others=others, fallback="simulated"
    )


def with_perfect_detector(backend: Backend) -> Backend:
    """The backend as it would be with a perfect detector. PerceptionError: SciPy isn't installed."""
    with _needing_scipy():
        from surveilnav.simulator.truth.backends import PerfectDetector
    return PerfectDetector(backend)


@contextmanager
def _needing_scipy() -> Iterator[None]:
    """For the import of the simulator's own backends, which alone need SciPy: a worker with a real detector goes without.

    Raises:
        PerceptionError: SciPy isn't installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise PerceptionError(
            f"the backends `oracle` and `simulated` need the extra [simulator], of which {error.name} isn't installed: "
            "pip install 'surveilnav[simulator]', or choose a detector: `surveilnav models list`"
        ) from error
