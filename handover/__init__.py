"""Where robot and person meet: reach of both, the person's body and comfort."""

from handover.arm import Arm, ArmSolutions
from handover.body import Part
from handover.chain import Chain, chain_of
from handover.constraints import Above, Constraint, Inside, Upright
from handover.fit import human_from_joints
from handover.held_object import HeldObject, mallet, wrench
from handover.human import Human
from handover.meet_settings import MeetSettings
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
from handover.workspace import InteractionWorkspace, Target

__all__ = [
    "POSTURES",
    "Above",
    "Arm",
    "ArmSolutions",
    "ArmState",
    "Chain",
    "Constraint",
    "HeldObject",
    "Human",
    "Inside",
    "InteractionWorkspace",
    "MeetSettings",
    "Part",
    "Quality",
    "QualitySettings",
    "ReachMap",
    "ReachSettings",
    "RotationGrid",
    "Skeleton",
    "Target",
    "Upright",
    "build_reach_map",
    "chain_of",
    "human_from_joints",
    "load_reach_map",
    "mallet",
    "posture_quality",
    "rotation_grid",
    "total_quality",
    "wrench",
]
