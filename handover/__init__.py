"""Where robot and person meet: reach of both, the person's body and comfort."""

from handover.arm import Arm, ArmSolutions
from handover.body import Part
from handover.chain import Chain, chain_of
from handover.constraints import Above, Constraint, Inside, Upright
from handover.find import Handover, find_handover
from handover.fit import human_from_joints
from handover.held_object import HeldObject, mallet, wrench
from handover.human import Human
from handover.live_targets import LiveSettings, LiveTargets, Pursuit
from handover.meet_settings import MeetSettings
from handover.node_index import NodeIndex
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
from handover.target_choice import ChoiceSettings
from handover.validity import PlannerValidity
from handover.workspace import InteractionWorkspace, Target

__all__ = [
    "POSTURES",
    "Above",
    "Arm",
    "ArmSolutions",
    "ArmState",
    "Chain",
    "ChoiceSettings",
    "Constraint",
    "Handover",
    "HeldObject",
    "Human",
    "Inside",
    "InteractionWorkspace",
    "LiveSettings",
    "LiveTargets",
    "MeetSettings",
    "NodeIndex",
    "Part",
    "PlannerValidity",
    "Pursuit",
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
    "find_handover",
    "human_from_joints",
    "load_reach_map",
    "mallet",
    "posture_quality",
    "rotation_grid",
    "total_quality",
    "wrench",
]
