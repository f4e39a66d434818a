"""Who stands on the ladder, and which tools stand on the table."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from handover import Human, ReachMap
from handover.meet.held_object import HeldObject, fist_grasps
from odm import CellMap, ReactivePlanner
from odm.frame.last_phase import gripper_links
from odm.obstacles.shapes import Box
from roadmap.errors import BadInput
from roadmap.geometry.gaps import least_gap, moved_rods
from roadmap.robot.robot import Robot
from sim.people.partner import PartnerTraits
from sim.people.whole_person import BASE_HEIGHT
from sim.story.cases import (
    StoryCase,
    StorySetup,
    grasp_spare,
    holder_at,
    in_reach,
    on_floor,
    pads_of,
    rest_of,
    setup_of,
    upright,
)
from sim.story.cases import story_wrench as whole_wrench
from sim.story.request import ARMAR3, PANDA
from sim.story.robot_hand import box_of, held_farther_out

SIZES = (1.0, 0.96, 0.92)  # of the wrenches, against one of 25 cm
HEIGHTS = 1.55, 1.90  # of the person [m]
_TIP = 0.02  # [m] from the tool to the end of the jaw that the fingers hold
_DRAWS = 40  # places of the ladder that are looked at
_APART = 0.05  # [m] of a tool that is held out from the person's arm at rest
_END = 0.11  # [m] from the middle of the wrench to that end


@dataclass(frozen=True)
class WorkPlace:
    """Where a robot, the table with the tools and the ladder stand."""

    recipe: str = "story"  # name of the recipe of the robot's map
    # links that may touch a tool; empty: see `sim.story.cases.pads_of`
    pads: tuple[str, ...] = ()
    # of the robot's base above the floor of the ladder [m]
    base_height: float = BASE_HEIGHT
    table: float = 0.0  # how high the table is, base frame [m]
    # where each tool stands on it, base frame [m]
    places_xy: tuple[tuple[float, float], ...] = (
        (0.38, -0.42),
        (0.20, -0.46),
        (0.53, -0.33),
    )
    # nearest and farthest place of the ladder from the base [m]
    distances: tuple[float, float] = (0.65, 0.85)
    # of the ladder, seen from the base: least and most [deg]
    bearings: tuple[float, float] = (-20.0, 20.0)

    @classmethod
    def told(cls, kept: dict) -> "WorkPlace":
        """Return it again from plain data, as a recording keeps it."""
        places = tuple(map(tuple, kept["places_xy"]))
        rest = {k: tuple(v) if isinstance(v, list) else v for k, v in kept.items()}
        return cls(**rest | {"places_xy": places})


BESIDE_PANDA = WorkPlace()
WORK_PLACES = {
    PANDA: BESIDE_PANDA,
    ARMAR3: WorkPlace(  # the table is low and on its left, so that the hand hangs down
        "armar3_tools",
        ("hand",),
        base_height=0.0,
        table=0.56,
        places_xy=((0.25, 0.485), (0.09, 0.485), (0.41, 0.485)),
        distances=(1.20, 1.35),
        bearings=(-12.0, 2.0),
    ),
}


@dataclass(frozen=True)
class LadderCase(StoryCase):
    """A hand-over to or from a person on the second step of a ladder."""

    def body(self) -> Human:
        """Return the person, arms at rest, who faces the robot; base frame."""
        d, b = self.distance, self.bearing
        body = Human(self.height, "ladder")
        body = body.placed(d * np.cos(b), d * np.sin(b), b + np.pi)
        return on_floor(body, self.base_height)

    @classmethod
    def drawn_at(
        cls, seed: int, draw: int = 0, at: WorkPlace = BESIDE_PANDA
    ) -> "LadderCase":
        """Return the case number `draw` of a seed, by a ladder `at` a place."""
        rng = np.random.default_rng([seed, draw, 19])
        return cls(
            "give",
            seed,
            float(rng.uniform(*at.distances)),
            float(np.radians(rng.uniform(*at.bearings))),
            float(rng.uniform(*HEIGHTS)),
            PartnerTraits.drawn(rng),
            at.base_height,
        )

    def of(self, direction: str) -> "LadderCase":
        """Return the same with the other direction."""
        return replace(self, direction=direction)


@dataclass(frozen=True, eq=False)
class ToolSetup(StorySetup):
    """A setup in which other tools stand about."""

    # the other tools, each with (4, 4) its place, base frame [m]
    others: tuple[tuple[HeldObject, np.ndarray], ...] = ()

    def planner(self) -> ReactivePlanner:
        """Return a planner that knows all holders, and the tools in the others."""
        planner = super().planner()
        for k, (tool, T_place) in enumerate(self.others):
            planner.scene.add(f"holder {k + 2}", holder_at(T_place, self.table))
            box = box_of(tool)
            standing = Box(box.size, T_place @ box.T_base_shape)
            planner.scene.add(f"tool {k + 2}", standing)
        return planner


def wrench_of(size: float) -> HeldObject:
    """Return a wrench of another size, held by the tip of its jaw."""
    whole = whole_wrench()
    T = np.array(whole.T_tool_object)
    T[2, 3] = _TIP + _END * size
    return HeldObject(
        f"wrench of {25 * size:.0f} cm",
        whole.capsules * np.r_[np.full(6, size), 1.0],
        whole.mass_kg * size,
        T,
        fist_grasps([0.05 * size]),
    )


def pads_at(robot: Robot, asked: Sequence[str], at: WorkPlace) -> tuple[str, ...]:
    """Return the links that may touch a tool: as asked, or the work place's."""
    carried = gripper_links(robot)
    if not asked and not carried.issuperset(at.pads):
        raise BadInput(
            f"the map is of {robot.name}, whose tool carries no link {at.pads[0]!r}, "
            f"which touches the tools at this work place ({at.recipe}); leave --robot, "
            "or say which links may touch them with `--pads LINK`, of "
            f"{', '.join(sorted(carried))}"
        )
    return pads_of(robot, asked or at.pads)


def tools_of(
    cell_map: CellMap,
    reach: ReachMap,
    pads: Sequence[str] = (),
    at: WorkPlace = BESIDE_PANDA,
) -> tuple[ToolSetup, ...]:
    """Return the setup of each tool, in the order in which they are asked for.

    `pads` are links that may touch a tool; empty: those of the work place `at` which
    the tools stand. A robot without fingers is refused.
    """
    pads = pads_at(cell_map.robot, pads, at)
    shared = setup_of(cell_map, reach, place=False, pads=pads)
    planner, nodes = shared.planner(), shared.index.nodes
    spare = grasp_spare(cell_map.robot)
    whole = [wrench_of(size) for size in SIZES]
    tools = [held_farther_out(planner, tool, nodes, spare) for tool in whole]
    standing = [
        (tool, upright(tool, xy, at.table))
        for tool, xy in zip(tools, at.places_xy, strict=True)
    ]
    setups = []
    for k, (tool, T_place) in enumerate(standing):
        setup = ToolSetup(
            cell_map,
            reach,
            tool,
            shared.index,
            shared.rest,
            shared.side,
            shared.pads,
            T_place=T_place,
            others=tuple(standing[:k] + standing[k + 1 :]),
            table=at.table,
        )
        setups.append(setup)
    # no tool is in the hand yet: all of them stand
    others = (*setups[0].others, (setups[0].obj, setups[0].T_place))
    whole = replace(setups[0], T_place=None, others=others).planner()
    rest = rest_of(whole, shared.index, max(tools, key=_length))
    return tuple(replace(setup, rest=rest) for setup in setups)


def _length(tool: HeldObject) -> float:
    return float(box_of(tool).size.max())


def case_in_reach(
    setups: tuple[ToolSetup, ...], seed: int, at: WorkPlace = BESIDE_PANDA
) -> LadderCase:
    """Return the first case of a seed in which both ways are in reach, for each tool.

    Told by exact inverse kinematics before the run; see `sim.story.cases.in_reach`. A
    tool is held out where it is `_APART` from the person's arm at rest: the
    simulated person would draw the arm through it. BadInput where none of `_DRAWS` is.
    """
    for draw in range(_DRAWS):
        case = LadderCase.drawn_at(seed, draw, at)
        if all(_goes_both_ways(setup, case) for setup in setups):
            return case
    raise BadInput(
        f"none of {_DRAWS} places of the ladder is in reach of the robot for seed "
        f"{seed}; give another seed, or a robot with a longer arm"
    )


def _goes_both_ways(setup: ToolSetup, case: LadderCase) -> bool:
    """Whether a tool can be held out, be let go of, and be given."""
    found = in_reach(setup, case.of("receive"))
    if found is None:
        return False
    tool = moved_rods(setup.obj.capsules, found.target.T_world_object)
    at_rest = case.body().capsules()
    if least_gap(tool, at_rest) < _APART:
        return False
    return in_reach(setup, case.of("give")) is not None
