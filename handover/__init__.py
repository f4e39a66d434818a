"""Where robot and person meet: reach of both, the person's body and comfort."""

from handover.arm import Arm, ArmSolutions
from handover.body import Part
from handover.chain import Chain, chain_of
from handover.fit import human_from_joints
from handover.human import Human
from handover.postures import POSTURES
from handover.quality import (
    ArmState,
    Quality,
    QualitySettings,
    posture_quality,
    total_quality,
)
from handover.reach_build import ReachSettings, build_reach_map
from handover.reach_map import ReachMap, load_reach_map
from handover.rotations import RotationGrid, rotation_grid
from handover.skeleton import Skeleton

__all__ = [
    "POSTURES",
    "Arm",
    "ArmSolutions",
    "ArmState",
    "Chain",
    "Human",
    "Part",
    "Quality",
    "QualitySettings",
    "ReachMap",
    "ReachSettings",
    "RotationGrid",
    "Skeleton",
    "build_reach_map",
    "chain_of",
    "human_from_joints",
    "load_reach_map",
    "posture_quality",
    "rotation_grid",
    "total_quality",
]
