"""Where a camera's pictures come from, behind one protocol."""
