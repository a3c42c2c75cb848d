"""What moves and sees, behind one protocol."""
