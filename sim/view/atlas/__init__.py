"""A reach map as one interactive page: the robot, the map around it, and its witnesses."""

from sim.view.atlas.page import write_atlas_page

__all__ = ["write_atlas_page"]
