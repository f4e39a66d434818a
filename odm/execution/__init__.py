"""Set-points beside a person: joined, timed and braked before anyone is touched."""

from odm.execution.executor import ExecutionSettings, Executor
from odm.execution.robot_spheres import RobotSpheres
from odm.execution.robot_threat import intent_of, intent_threat, limits_threat
from odm.execution.threat import CloudThreat, Threat, ThreatSettings, Watcher

__all__ = [
    "CloudThreat",
    "ExecutionSettings",
    "Executor",
    "RobotSpheres",
    "Threat",
    "ThreatSettings",
    "Watcher",
    "intent_of",
    "intent_threat",
    "limits_threat",
]
