"""Depth cameras: what they see occupied, free or not at all, as cells and points."""

from odm.cameras.camera import DepthCamera, look_at
from odm.cameras.settings import SeenSettings
from odm.cameras.space import Seen, SeenSpace

__all__ = ["DepthCamera", "Seen", "SeenSettings", "SeenSpace", "look_at"]
