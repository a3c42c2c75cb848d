"""What a run leaves behind: ``run.json`` for programs, ``report.html`` for people.

record = RunRecord(building="SweetHome3DExample", ...)
write_report(record, run_dir / "report.html")
json.dumps(run_json(record, run_dir / "report.html"))
"""

from surveilnav.cli.report.page import write_report
from surveilnav.cli.report.record import (
    DecidingView,
    MapMoment,
    RunRecord,
    Step,
    TrafficLine,
    run_json,
    traffic_lines,
)
from surveilnav.cli.report.words import outcome

__all__ = [
    "DecidingView",
    "MapMoment",
    "RunRecord",
    "Step",
    "TrafficLine",
    "outcome",
    "run_json",
    "traffic_lines",
    "write_report",
]
