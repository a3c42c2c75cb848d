"""SurveilNav: surveillance cameras and a robot search a building together."""

__version__ = "0.1.0"
