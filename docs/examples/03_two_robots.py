"""Two robots in one space: each plans round the other and brakes for it.

    python docs/examples/03_two_robots.py [MAP]

Each robot is the moving obstacle of the other by its joints alone, and tells what it
may still do without another test. They decide one after the other. `odm run-two` does
the same with work places found by itself, turns taken, an exact audit and pictures.
"""

import sys
from pathlib import Path

import numpy as np

import odm
import roadmap
from odm.execution import (
    ExecutionSettings,
    Executor,
    RobotSpheres,
    intent_of,
    intent_threat,
)
from odm.obstacles.robot_surface import standing_shapes
from roadmap.transforms import pose_of

RECIPE = Path(__file__).with_name("small_arm.toml")
PERIOD = 0.01  # [s]
# the second base in the first one's frame: they face each other
T_FIRST_SECOND = pose_of((0.95, 0.0, 0.0), (0.0, 0.0, np.pi))


class Arm:
    """One of the robots: it goes to and fro between two places.

    Args:
        cell_map: Its map.
        other: Spheres of the other robot.
        T: (4, 4) base of the other one in its own base frame.
    """

    def __init__(
        self, cell_map: odm.CellMap, other: RobotSpheres, T: np.ndarray
    ) -> None:
        """Stand at the first place."""
        self.robot, self.other, self.T = cell_map.robot, other, T
        self.planner = odm.ReactivePlanner(cell_map)
        self.planner.set_static(standing_shapes(other.robot, T))
        self.places, self.place, self.trips = self._two_places(), 1, 0
        self.executor = Executor(
            self.robot, self.planner, self.places[0].copy(), PERIOD,
            ExecutionSettings(speed_scale=0.5, min_retreat_separation=np.inf),
        )  # fmt: skip
        self.planner.set_goals([self.places[1]])

    def _two_places(self) -> np.ndarray:
        """Return free configurations whose tools are far to the left and right."""
        nodes = self.planner.cell_map.roadmap.nodes
        tools = np.array([roadmap.tool_pose(self.robot, q)[:3, 3] for q in nodes])
        order = np.argsort(np.where(tools[:, 0] > 0.2, tools[:, 1], 0.0))
        free = [nodes[k] for k in order if self.planner.is_free(nodes[k], nodes[k])]
        return np.array([free[0], free[-1]])

    @property
    def q(self) -> np.ndarray:
        """(dof,) where it is."""
        return self.executor.set_point.q

    def decide(self, other: "Arm", now: float) -> float:
        """Plan round the other robot and brake for it; return their distance [m]."""
        there = self.other.obstacles(other.q, self.T)
        commit, dq = self.executor.commit(), self.executor.set_point.dq
        answer = self.planner.step(there, q=commit.q, dq=dq, stamp=now, now=now)
        # all that the other one may still sweep before it stands
        threat = intent_threat(self.other, intent_of(other.executor), self.T)
        self.executor.update(answer, commit, threat)
        return self.planner.separation(self.q)

    def advance(self) -> None:
        """Move on by one period; at a place, go to the other one."""
        self.executor.advance()
        off = np.abs(self.q - self.places[self.place]).max()
        if self.executor.at_rest and off < 1e-6:
            self.trips, self.place = self.trips + 1, 1 - self.place
            self.planner.set_goals([self.places[self.place]])
            self.executor.new_goal()


def main(cell_map: odm.CellMap, seconds: float = 20.0) -> dict:
    """Run two of the same robot and return what happened."""
    spheres = RobotSpheres(cell_map.robot)
    T = T_FIRST_SECOND
    first, second = Arm(cell_map, spheres, T), Arm(cell_map, spheres, np.linalg.inv(T))
    closest = np.inf
    for frame in range(round(seconds / PERIOD)):
        now = frame * PERIOD
        closest = min(closest, first.decide(second, now), second.decide(first, now))
        first.advance()
        second.advance()
    print(f"trips: {first.trips} and {second.trips} in {seconds:.0f} s")
    print(f"never nearer to each other than {100 * closest:.1f} cm")
    return {"trips": (first.trips, second.trips), "closest": closest}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(odm.load_map(sys.argv[1]))
    else:
        main(odm.build_map(odm.load_recipe(RECIPE)))
