"""Furniture: the libraries it comes from, its models, its names, where it stands."""
