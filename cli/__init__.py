"""The command line: the composition root. May import everything; nothing imports it."""
