"""``cameras.yaml``: a building's real cameras, their streams, places and lenses (docs/use/cameras.md).

model   what the file may say, as Pydantic models; their JSON schema is published
load    reads a file and names every mistake at its line; a mistake in one camera leaves the others usable
edit    writes single values into a file, and leaves its comments and all other lines as they are
urls    addresses of streams: passwords from the environment, and how an address is shown to people
views   the pinhole views that are made of a camera's picture
passwords      the file of passwords beside it
uncalibrated   what stands there for the place of a camera that isn't measured yet
"""

from surveilnav.cameras_file.load import CamerasFile, Problem, load_cameras
from surveilnav.cameras_file.model import CameraEntry, FloorEntry, LensEntry

__all__ = ["CameraEntry", "CamerasFile", "FloorEntry", "LensEntry", "Problem", "load_cameras"]
