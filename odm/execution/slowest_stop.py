"""How far a person may come while a robot stops from the slowest speed it uses."""

from dataclasses import replace

from odm.execution.executor import ExecutionSettings
from odm.execution.settings import PaceSettings
from odm.execution.stop_test import stop_time
from odm.execution.threat import ThreatSettings
from roadmap.robot.robot import Robot


def slowest_stop(
    robot: Robot, settings: ExecutionSettings, period: float, threat: ThreatSettings
) -> tuple[float, float]:
    """Return how long the shortest stop takes [s], and how far somebody comes [m].

    A robot that is slowed down for a person uses its slowest level of speed. The joint
    that takes longest to stop from there counts, by its limits of acceleration and
    jerk, after one more period; the person stands before, as far as the sensor can
    tell, and starts off as hard as is assumed of them. Nearer to them than that, and
    the clearance, it does not get: it brakes as soon as it has begun to move.

    Args:
        robot: The robot.
        settings: Of its execution.
        period: Time between frames [s].
        threat: What is assumed of the person, and of the sensor.
    """
    time = stop_time(robot, settings.slowest_scale, period)
    if time <= PaceSettings().quick_s:  # nobody is expected to speed up harder
        threat = replace(threat, jerk=0.0)
    return time, threat.strays(time, period)
