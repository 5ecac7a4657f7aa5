"""Maps people have, read into a `World`: GeoJSON, OpenStreetMap, ROS map_server, MovingAI, WKT and CSV."""

from sandwich_sitl.world.importers.read import read_world
from sandwich_sitl.world.importers.result import ImportedWorld, ImportReport, Note
from sandwich_sitl.world_config import ImportOptions

__all__ = ["ImportOptions", "ImportReport", "ImportedWorld", "Note", "read_world"]
