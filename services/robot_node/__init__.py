"""One robot: executes commands, publishes observations. Simulated here; a real one speaks the same contract."""
