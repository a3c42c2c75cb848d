"""``surveilnav replay``: a recording shown again, or checked."""
