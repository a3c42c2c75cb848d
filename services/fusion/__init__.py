"""Fusion: the joint maps of a building, made of what robots and surveillance cameras see."""
