"""Where and how robot and person meet: reach, body, comfort, grasps, whole plans."""

from handover.chain import Chain, chain_of
from handover.grasps.agents import Agent, AgentArm, Posture, agent_names, load_agent
from handover.grasps.arm_reach import ArmReach, build_arm_reach
from handover.grasps.grasp_build import GraspSettings, build_grasps
from handover.grasps.grasp_set import GraspSet, load_grasps
from handover.grasps.hand import Hand, load_hand
from handover.grasps.hands import HandSpec, hand_names
from handover.grasps.objects import GraspObject, load_object, make_object, object_names
from handover.human.body import Part
from handover.human.fit import human_from_joints
from handover.human.human import Human
from handover.human.human_arm import Arm, ArmSolutions
from handover.human.postures import POSTURES
from handover.human.skeleton import Skeleton
from handover.meet.constraints import Above, Constraint, Inside, Upright
from handover.meet.find import Handover, find_handover
from handover.meet.held_object import HeldObject, mallet, wrench
from handover.meet.quality import ArmState, Quality, posture_quality, total_quality
from handover.meet.settings import FindSettings, MeetSettings, QualitySettings
from handover.meet.validity import PlannerValidity
from handover.meet.workspace import InteractionWorkspace, Target
from handover.plans.motions import PlannedMotion
from handover.plans.planner import HandoverPlan, plan_handover
from handover.plans.settings import PlanSettings
from handover.reach.reach_build import ReachSettings, build_reach_map
from handover.reach.reach_map import ReachMap, load_reach_map
from handover.reach.rotations import RotationGrid, rotation_grid
from handover.scenes.load import load_scene, scene_names
from handover.scenes.scene import Fixture, PlacedAgent, Scene, stand
from handover.targets.live_targets import LiveTargets, Pursuit
from handover.targets.node_index import NodeIndex
from handover.targets.settings import ChoiceSettings, LiveSettings

__all__ = [
    "Above",
    "Agent",
    "AgentArm",
    "Arm",
    "ArmReach",
    "ArmSolutions",
    "ArmState",
    "Chain",
    "ChoiceSettings",
    "Constraint",
    "FindSettings",
    "Fixture",
    "GraspObject",
    "GraspSet",
    "GraspSettings",
    "Hand",
    "HandSpec",
    "Handover",
    "HandoverPlan",
    "HeldObject",
    "Human",
    "Inside",
    "InteractionWorkspace",
    "LiveSettings",
    "LiveTargets",
    "MeetSettings",
    "NodeIndex",
    "POSTURES",
    "Part",
    "PlacedAgent",
    "PlanSettings",
    "PlannedMotion",
    "PlannerValidity",
    "Posture",
    "Pursuit",
    "Quality",
    "QualitySettings",
    "ReachMap",
    "ReachSettings",
    "RotationGrid",
    "Scene",
    "Skeleton",
    "Target",
    "Upright",
    "agent_names",
    "build_arm_reach",
    "build_grasps",
    "build_reach_map",
    "chain_of",
    "find_handover",
    "hand_names",
    "human_from_joints",
    "load_agent",
    "load_grasps",
    "load_hand",
    "load_object",
    "load_reach_map",
    "load_scene",
    "make_object",
    "mallet",
    "object_names",
    "plan_handover",
    "posture_quality",
    "rotation_grid",
    "scene_names",
    "stand",
    "total_quality",
    "wrench",
]
