"""Start and end of a service's process: sets up logging, and reports a user's mistake in one line with exit code 1."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable

import structlog
from pydantic import ValidationError
from pydantic_settings import SettingsError

from surveilnav.bus import logs
from surveilnav.bus.settings import BusSettings
from surveilnav.errors import SurveilNavError, explain_settings_error

#: Environment variable with which a process that starts a service has it end when the service's standard input is closed.
ENDS_WITH_STDIN = "SURVEILNAV_ENDS_WITH_STDIN"
#: A service that hasn't ended this long after SIGTERM is ended at once [s].
_GRACE_S = 5.0


def run_service(main: Callable[[], None]) -> int:
    """Runs ``main`` and returns the process's exit code."""
    exit_on_sigterm()
    end_with_stdin()
    try:
        settings = BusSettings()
        logs.configure(settings.log_format, settings.log_level)
        main()
    except ValidationError as error:
        print(explain_settings_error(error), file=sys.stderr)
        return 1
    except (SettingsError, SurveilNavError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    finally:
        # Python would look through all objects before it ends, which takes seconds on a busy machine once Numba has compiled.
        gc.freeze()
    return 0


def exit_on_sigterm() -> None:
    """Has SIGTERM end the process while no node runs: from the start until ``Node.run``, and between two nodes' runs."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))


def run_warm_up(warm_up: Callable[[], None]) -> None:
    """Runs a service's warm-up, which compiles its loops. If that fails the service starts all the same, and compiles later."""
    log, start_s = structlog.get_logger(), time.monotonic()
    log.info("compiles its loops, or reads them from the cache")
    try:
        warm_up()
    except Exception as error:
        log.warning(
            "not all loops are compiled; the first search waits for them", why=f"{type(error).__name__}: {error}"
        )
    else:
        log.info("its loops are compiled", seconds=round(time.monotonic() - start_s, 1))


def end_with_stdin() -> None:
    """Ends the process when its standard input is closed, because its starter has ended; only if ``ENDS_WITH_STDIN`` is set."""
    if os.environ.get(ENDS_WITH_STDIN):
        threading.Thread(target=_end_when_stdin_closes, name="stdin", daemon=True).start()


def _end_when_stdin_closes() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE_S)
    os._exit(1)
