"""Where robot and person meet: the person's body, reach and comfort."""

from handover.arm import Arm, ArmSolutions
from handover.body import Part
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
from handover.skeleton import Skeleton

__all__ = [
    "POSTURES",
    "Arm",
    "ArmSolutions",
    "ArmState",
    "Human",
    "Part",
    "Quality",
    "QualitySettings",
    "Skeleton",
    "human_from_joints",
    "posture_quality",
    "total_quality",
]
