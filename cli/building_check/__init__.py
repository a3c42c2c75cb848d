"""``surveilnav doctor --building building.yaml``: each part of a real building, against the running hardware.

check          all parts: which run at once, and their deadlines
files          the building's files, as far as they can be read
floor_check    floor plans and Nav2's maps
camera_check   streams, places and directions
system_check   the running system, asked by its gateway
"""
