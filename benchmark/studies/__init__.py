"""Studies of parts: association, calibration, homes, floors, detectors."""
