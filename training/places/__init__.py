"""What lies beyond a frontier: states recorded while playing, rows made of them, and the model that learns from these."""
