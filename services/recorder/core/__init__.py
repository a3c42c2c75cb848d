"""The recorder's pure parts: what goes into a file, and which files are kept."""
