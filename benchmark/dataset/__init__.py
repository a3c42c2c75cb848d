"""The collaborative dataset: buildings, cameras and episodes, built anew on any machine by one command."""
