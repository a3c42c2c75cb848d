"""How every service's process begins and ends: logs set up, a user's mistake as one line, exit 1."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

from pydantic import ValidationError
from pydantic_settings import SettingsError

from surveilnav.bus import logs
from surveilnav.bus.settings import BusSettings
from surveilnav.errors import SurveilNavError


def run_service(main: Callable[[], None]) -> int:
    """Runs ``main``; returns the process's exit code."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until ``Node.run`` takes over
    try:
        settings = BusSettings()
        logs.configure(settings.log_format, settings.log_level)
        main()
    except ValidationError as error:
        print(explain(error), file=sys.stderr)
        return 1
    except (SettingsError, SurveilNavError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def explain(error: ValidationError) -> str:
    """A wrong setting in one line per fault: variable, what was expected, what arrived."""
    lines = []
    for fault in error.errors():
        name = ".".join(str(part) for part in fault["loc"])
        lines.append(f"error: setting {error.title}.{name}: {fault['msg']}, got {fault.get('input')!r}")
    return "\n".join(lines)
