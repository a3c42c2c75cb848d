"""From a plan of rooms and walls to a scene."""
