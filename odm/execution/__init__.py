"""Set-points beside a person: joined, timed and braked before anyone is touched."""

from odm.execution.executor import Executor
from odm.execution.missing import MissingParts
from odm.execution.robot_spheres import RobotSpheres
from odm.execution.robot_threat import intent_of, intent_threat, limits_threat
from odm.execution.settings import ExecutionSettings
from odm.execution.stop_test import slowest_stop
from odm.execution.threat import CloudThreat, Threat, ThreatSettings, Watcher

__all__ = [
    "CloudThreat",
    "ExecutionSettings",
    "Executor",
    "MissingParts",
    "RobotSpheres",
    "Threat",
    "ThreatSettings",
    "Watcher",
    "intent_of",
    "intent_threat",
    "limits_threat",
    "slowest_stop",
]
