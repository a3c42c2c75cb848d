"""What a run leaves behind: ``run.json`` for programs, ``report.html`` for people.

record = RunRecord(building="SweetHome3DExample", ...)
write_report(record, run_dir / "report.html")
json.dumps(run_json(record, run_dir / "report.html"))
"""

from cli.report.page import write_report
from cli.report.record import DecidingView, MapMoment, Moment, RunRecord, Step, TrafficLine, run_json, traffic_lines
from cli.report.words import outcome

__all__ = [
    "DecidingView", "MapMoment", "Moment", "RunRecord", "Step", "TrafficLine", "outcome", "run_json", "traffic_lines",
    "write_report",
]  # fmt: skip
