"""What a run leaves behind: ``run.json`` for programs, ``report.html`` for people. ``record.RunRecord`` is what both say."""
