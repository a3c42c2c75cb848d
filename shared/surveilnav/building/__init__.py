"""Simulated buildings: sources, scene, renderer, navigation, camera placement. No bus in here."""
