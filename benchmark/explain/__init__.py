"""Where the SPL of a run is lost: ``surveilnav bench explain``."""
