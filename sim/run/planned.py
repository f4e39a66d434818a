"""A run of a hand-over plan: its tuple is the goal, its receiver moves as planned."""

import gc
from collections.abc import Mapping

import numpy as np

from handover.plans.limb import agent_model
from handover.scenes.plan_file import read_plan, read_shape
from odm import CellMap, ReactivePlanner, load_map
from odm.obstacles.obstacles import Obstacles
from roadmap.builds.chunks import Progress
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_of_flat
from sim.loop.loop import Loop, LoopSettings
from sim.loop.run_result import RunResult
from sim.people.receiver import PlannedReceiver, motion_of
from sim.run.places import set_up_scene, warm_up
from sim.run.report import print_report
from sim.run.request import RunRequest

_SAME = 1e-3  # [m] and in a rotation: two tools at one configuration


class PlanTask:
    """To where the plan hands over, beside its receiver, who may come otherwise.

    It begins where the giver has lifted the object, or as soon after that on its way
    as the map's clearance allows, and ends with the object on offer.

    Attributes:
        cell_map: The map, once it was opened.
        places: (2, dof) where it begins and where it hands over.
    """

    cell_map: CellMap

    def __init__(self, request: RunRequest) -> None:
        self.request = request
        self.record = read_plan(request.plan)

    def person(self) -> PlannedReceiver:
        """Return the receiver."""
        asked = self.request
        early, aside = asked.early or 0.0, asked.elsewhere or 0.0
        self._person = PlannedReceiver(self.record, early, aside, asked.seed)
        return self._person

    def open(self, tell: Progress) -> None:
        """Load the map, and find where the run begins.

        Raises:
            BadInput: The map is another robot's than the giver, or the giver is nearer
                to something than the map's clearance where it begins or hands over.
        """
        self.cell_map = load_map(self.request.map_dir)
        robot = self.cell_map.robot
        check_giver(self.record, robot)
        self._planner = self._new_planner()
        carry = configurations(motion_of(self.record, "giver", "carry"), robot)
        offer = configurations(motion_of(self.record, "giver", "offer"), robot)[-1]
        self._check(offer, Obstacles(), "hands over")
        there = Obstacles(capsules=self._person.capsules(0.0))
        for q in carry[:-1]:
            trouble = self._trouble(q, there)
            if not trouble:
                break
        else:
            self._check(carry[0], there, "begins to carry")
        self.places = np.array([q, offer])

    def _check(self, q: np.ndarray, there: Obstacles, where: str) -> None:
        trouble = self._trouble(q, there)
        if trouble:
            raise BadInput(
                f"where the plan {self.request.plan} {where}, the giver is not free "
                f"with the map's clearance: {trouble}; plan with more room there, or "
                "build a map with a smaller clearance"
            )

    def _trouble(self, q: np.ndarray, there: Obstacles) -> str:
        """Return why the giver cannot be at q with something there, "" for nothing."""
        self._planner.set_goals([q])
        self._planner.step(there, q=q)
        free = self._planner.is_free(q, q)
        return "" if free else str(free.reason)

    def loop(self, person: PlannedReceiver, settings: LoopSettings) -> Loop:
        """Compile everything, then return a loop whose planner knows nothing of it."""
        warm_up(self._planner, self.places, person, settings)
        self._planner = self._new_planner()
        gc.collect()
        gc.freeze()
        robot = self._planner.robot
        return Loop(self._planner, robot, self.places, person, settings)

    def _new_planner(self) -> ReactivePlanner:
        """Return a planner that knows the plan's scenery, and --scene's."""
        planner = ReactivePlanner(self.cell_map)
        T = np.linalg.inv(np.array(self.record["giver"]["T_world_base"]))
        for entry in self.record["scenery"]:
            planner.scene.add(f"plan {entry['name']}", read_shape(entry), T)
        set_up_scene(planner, self.request.scene)
        planner.scene.test_waiting()
        return planner

    def figures(self, loop: Loop, result: RunResult) -> dict:
        """Return what became of the hand-over, by "plan"."""
        there = np.abs(result.q - self.places[-1]).max(axis=1) <= 1e-6
        begin, end = loop.motion.reach_s
        return {
            "plan": {
                "file": str(self.request.plan),
                "offered_s": float(there.argmax() / result.rate_hz)
                if there.any()
                else None,
                "receiver_reaches_s": begin,
                "receiver_is_there_s": end,
                "receiver_stands_elsewhere_m": self.request.elsewhere or 0.0,
                "early_s": self.request.early or 0.0,
            }
        }

    def show(self, result: RunResult, figures: dict) -> None:
        """Print the tables, and what became of the hand-over."""
        print_report(result, None, self.cell_map.hash)
        told = figures["plan"]
        offered = told["offered_s"]
        what = (
            "was not on offer in this time"
            if offered is None
            else f"is on offer after {offered:.1f} s"
        )
        print(
            f"the object {what}; the receiver's hand is there after "
            f"{told['receiver_is_there_s']:.1f} s"
        )


def check_giver(record: Mapping, robot: Robot) -> None:
    """Refuse the map of a robot with other joints or another tool than the giver's."""
    giver = record["giver"]
    joints = {k: float(v) for k, v in giver["joints"].items()}
    trouble = ""
    missing = [name for name in robot.joint_names if name not in joints]
    if missing:
        trouble = f"has no joint {missing[0]}"
    else:
        model = agent_model(giver["urdf"])
        link = model.description.links.get(robot.tip_name)
        if link is None:
            trouble = f"has no link {robot.tip_name}"
        else:
            q = np.array([joints[name] for name in robot.joint_names])
            body = model.tree.link_body[robot.tip_name]
            T = pose_of_flat(model.frames(joints)[body])
            T = T @ model.tree.T_body_link[robot.tip_name]
            if np.abs(T - tool_pose(robot, q)).max() > _SAME:
                trouble = f"has its {robot.tip_name} elsewhere at the same joints"
    if trouble:
        raise BadInput(
            f"the map is of {robot.name}, but the plan's giver is {giver['name']}, "
            f"which {trouble}; give --map a map of the plan's giver"
        )


def configurations(motion: Mapping, robot: Robot) -> np.ndarray:
    """Return the robot's joints (n, dof) along a motion of a plan."""
    columns = [motion["joints"].index(name) for name in robot.joint_names]
    return np.array(motion["positions"], float)[:, columns]
