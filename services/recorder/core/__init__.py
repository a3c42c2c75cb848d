"""The recorder's pure parts: what a message becomes in a file, and which files are deleted."""
