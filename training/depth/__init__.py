"""Training of the depth network ``surveilnav.perception.depth``."""
