"""How every service's process begins and ends: logs set up, a user's mistake as one line, exit 1."""

from __future__ import annotations

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
from surveilnav.errors import SurveilNavError

#: In the environment of a service that whoever started it keeps its standard input open for: it ends when that is closed.
ENDS_WITH_STDIN = "SURVEILNAV_ENDS_WITH_STDIN"
#: A service that doesn't end by SIGTERM within this is ended hard [s].
_LAST_WORDS_S = 5.0


def run_service(main: Callable[[], None]) -> int:
    """Runs ``main``; returns the process's exit code."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until ``Node.run`` takes over
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
    return 0


def run_warm_up(warm_up: Callable[[], None]) -> None:
    """Runs a service's warm-up. One that fails keeps nobody from starting: what it would have compiled is compiled later."""
    log, began_s = structlog.get_logger(), time.monotonic()
    log.info("compiles its loops, or reads them from the cache")
    try:
        warm_up()
    except Exception as error:
        log.warning(
            "not all loops are compiled; the first search waits for them", why=f"{type(error).__name__}: {error}"
        )
    else:
        log.info("its loops are compiled", seconds=round(time.monotonic() - began_s, 1))


def end_with_stdin() -> None:
    """Has the process end when its standard input is closed, if it was told so: who started it is gone then."""
    if os.environ.get(ENDS_WITH_STDIN):
        threading.Thread(target=_wait_for_the_end, name="stdin", daemon=True).start()


def _wait_for_the_end() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_LAST_WORDS_S)
    os._exit(1)


def explain_settings_error(error: ValidationError) -> str:
    """A wrong setting in one line per fault: variable, what was expected, what arrived."""
    lines = []
    for fault in error.errors():
        name = ".".join(str(part) for part in fault["loc"])
        lines.append(f"error: setting {error.title}.{name}: {fault['msg']}, got {fault.get('input')!r}")
    return "\n".join(lines)
