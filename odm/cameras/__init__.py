"""Depth cameras: what they see occupied, free or not at all, as cells and points."""

from odm.cameras.camera import DepthCamera, look_at
from odm.cameras.space import Seen, SeenSettings, SeenSpace

__all__ = ["DepthCamera", "Seen", "SeenSettings", "SeenSpace", "look_at"]
