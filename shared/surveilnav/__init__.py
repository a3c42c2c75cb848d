"""SurveilNav: surveillance cameras and a robot search a building together."""

import os

# ONNX Runtime since 1.29 reports its use to its maker unless this is set before it is imported.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

__version__ = "0.1.0"
