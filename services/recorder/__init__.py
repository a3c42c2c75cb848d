"""The recorder: every mission as one MCAP file."""
