"""Where robot and person meet: reachability, and later the hand-over targets."""

from handover.chain import Chain, chain_of
from handover.reach_build import ReachSettings, build_reach_map
from handover.reach_map import ReachMap, load_reach_map
from handover.rotations import RotationGrid, rotation_grid

__all__ = [
    "Chain",
    "ReachMap",
    "ReachSettings",
    "RotationGrid",
    "build_reach_map",
    "chain_of",
    "load_reach_map",
    "rotation_grid",
]
