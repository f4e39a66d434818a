"""Scripted scenes in which the robot must hold, back off or escape.

The other motions are blind to the robot. A scene is staged: arms stand before the two
work places, so that on the way from the first to the second the state that the scene
is named after has to occur. How a hand moves is then a script as any other.
"""

from dataclasses import dataclass, replace

import numpy as np

from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.robot.robot import Robot
from roadmap.transforms import pose_of
from sim.people.arm import HumanArm
from sim.people.arm_path import Person, Round
from sim.people.human_motion import HumanMotion, Together, motion_names, register_motion
from sim.people.placed import Placed

TOOLS = ((0.42, 0.35, 0.23), (0.42, -0.35, 0.23))  # where none are known [m]
SHOULDER = (0.45, 0.15, 0.25)  # from the tool: outward, to the left, up [m]
HOME = 0.30  # a hand rests so far outward from where the tool is [m]
CLEAR = 0.20  # and at least so far from the robot when it is there [m]
# distances of a hand from the cover of the robot at a work place [m]
BLOCK_GAP, BACKOFF_GAP, ESCAPE_GAP = -0.02, 0.08, 0.006
ROUND_S = 16.0  # every arm repeats its script after this time [s]
_STEPS = (0.01, 0.0005)  # between the places that are tried for a gap [m]
# other scripts are written for work places on both sides of here, base frame [m]
SCRIPTED_FOR = (0.42, 0.0, 0.23)
NEAR = 0.10  # what lies nearer to it than this leaves the person where it is [m]


def robot_balls(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return (n, 4) the moving spheres of a robot's cover at q (dof,) [m]."""
    return cover_balls(robot, q)[robot.moving]


def gap_from(balls: np.ndarray, capsules: np.ndarray) -> float:
    """Return the distance of balls (n, 4) from capsules (k, 7) [m]."""
    return float(ball_gaps(balls, capsules).min(initial=np.inf))


@dataclass(frozen=True)
class Stand:
    """An arm before a work place, seen in a frame turned about the base's z axis.

    In that frame the tool is at (r, 0, z) and the person looks along -x.
    """

    person: Person  # whose arm it is, its shoulder in the turned frame
    p_tool: tuple[float, float, float]  # (x, y, z) of the tool in the turned frame [m]
    yaw: float  # angle of the turned frame in the robot's base [rad]
    # (n, 4) balls of the robot that stands there [m]; None where it is not known
    cover: np.ndarray | None = None
    home: float = HOME  # the hand rests so far outward from the tool [m]

    @classmethod
    def before(
        cls, person: Person, p_base_tool: np.ndarray, cover: np.ndarray | None = None
    ) -> "Stand":
        """Return the stand of a person in front of a tool, (3,) in the base [m].

        It is so far outward that the resting arm is well away from the robot there.
        """
        x, y, z = (float(v) for v in p_base_tool)
        p_tool = (float(np.hypot(x, y)), 0.0, z)
        shoulder = tuple(float(v) for v in np.add(p_tool, SHOULDER))
        there = replace(person, p_base_shoulder=shoulder)
        near = cls(there, p_tool, float(np.arctan2(y, x)), cover)
        if cover is None:
            return near
        stands = [near.backward(step) for step in np.arange(0.0, 0.6, 0.05).tolist()]
        return next((s for s in stands if s.gap(s.home) >= CLEAR), stands[-1])

    def backward(self, step: float) -> "Stand":
        """Return the stand of one who stands so much farther outward [m]."""
        x, y, z = self.person.p_base_shoulder
        person = replace(self.person, p_base_shoulder=(x + step, y, z))
        return replace(self, person=person, home=self.home + step)

    def at(self, outward: float) -> tuple[float, float, float]:
        """Return the place so far outward from the tool, in the turned frame [m]."""
        return (self.p_tool[0] + outward, *self.p_tool[1:])

    def capsules(self, outward: float) -> np.ndarray:
        """Return the arm with its hand there as (2, 7) capsules in the base [m]."""
        script = Round(self.person, self.at(outward), 1.0)
        turn = pose_of((0.0, 0.0, 0.0), (0.0, 0.0, self.yaw))
        return moved_rods(self.person.capsules(script.home), turn)

    def gap(self, outward: float) -> float:
        """Return how far an arm whose hand is there is from the robot [m]."""
        return gap_from(self.cover, self.capsules(outward))

    def stop(self, gap: float) -> float:
        """Return the first place on the way in that leaves no more than a gap [m]."""
        if self.cover is None:
            return 0.1 + gap
        begin, end = self.home, -HOME
        for step in _STEPS:
            places = np.arange(begin, end, -step).tolist()
            first = next((p for p in places if self.gap(p) <= gap), places[-1])
            begin, end = first + step, first - step
        return first


@dataclass(frozen=True)
class Cue:
    """One move of a hand."""

    outward: float  # how far from the tool it ends [m]
    speed: float  # its peak [m/s]
    rest: float  # time to stay there [s]


def play(name: str, stand: Stand, begin: float, *cues: Cue) -> Placed:
    """Return an arm that begins at a place and then follows its cues, over and over.

    The hand begins at `begin`, outward from the tool [m]; the last rest lasts until the
    round is over.
    """
    fastest = max(cue.speed for cue in cues)
    limit = min(fastest, stand.person.max_speed or fastest)
    script = Round(stand.person, stand.at(begin), limit)
    for cue in cues:
        script.move(stand.at(cue.outward), cue.rest, min(cue.speed / limit, 1.0))
    script.close(0.0, 0.5)
    last = script.legs[-1]
    rest = max(0.0, ROUND_S - sum(leg.duration + leg.rest for leg in script.legs))
    script.legs[-1] = replace(last, rest=last.rest + rest)
    return Placed(script.motion(name, limit), stand.yaw)


# --- the scenes: arms before the first work place and before the second --------------


def hold(waiting: Stand, goal: Stand) -> tuple[Placed, ...]:
    """Let a hand come to where the robot is going, stay for 4 s and leave."""
    block = Cue(goal.stop(BLOCK_GAP), 1.0, 4.0)
    return (play("goal", goal, goal.home, block, Cue(goal.home, 0.8, 8.0)),)


def backoff(waiting: Stand, goal: Stand) -> tuple[Placed, ...]:
    """Let one hand block the goal, and another come slowly near the waiting robot."""
    near = waiting.stop(BACKOFF_GAP)
    come = Cue(near, 0.12, 2.0)
    home = waiting.home
    arm = play("near", waiting, home, _stay(home, 0.5), come, Cue(home, 0.5, 1.0))
    return _blocking(goal, 9.0), arm


def escape(waiting: Stand, goal: Stand) -> tuple[Placed, ...]:
    """Let one hand block the goal, and another rest within the robot's clearance.

    It is there from the start: from one that comes a robot backs off before.
    """
    close = waiting.stop(ESCAPE_GAP)
    leave = Cue(waiting.home, 0.5, 7.0)
    arm = play("close", waiting, close, _stay(close, 4.0), leave)
    return _blocking(goal, 7.0), arm


def _blocking(goal: Stand, rest: float) -> Placed:
    there = goal.stop(BLOCK_GAP)
    return play("goal", goal, there, _stay(there, rest), Cue(goal.home, 0.8, 4.0))


def _stay(outward: float, rest: float) -> Cue:
    return Cue(outward + 1e-4, 0.1, rest)  # a leg leads somewhere


SCENES = {"hold": hold, "backoff": backoff, "escape": escape}


@dataclass(frozen=True, eq=False)
class Scene(Together):
    """One of `SCENES`, before work places of a table until `before` puts it elsewhere.

    Its motions are those of the arms.
    """

    person: Person  # sizes and speed limit of the arms; where they stand follows
    film_s = 12.0  # the first so many seconds show it [s]

    def before(self, robot: Robot, places: np.ndarray) -> "Scene":
        """Return the scene staged for a robot that waits at the first work place.

        Args:
            robot: The robot.
            places: (n, dof) its work places; the first two are used.
        """
        tools = [tool_pose(robot, q)[:3, 3] for q in places[:2]]
        covers = [robot_balls(robot, q) for q in places[:2]]
        waiting, goal = map(Stand.before, [self.person] * 2, tools, covers)
        return replace(self, motions=SCENES[self.name](waiting, goal))


def make_scene(name: str, person: Person | None = None) -> Scene:
    """Return a scene by its name, not staged yet: see `Scene.before`."""
    person = person or Person(HumanArm.sized())
    waiting, goal = (Stand.before(person, np.array(p)) for p in TOOLS)
    return Scene(name, SCENES[name](waiting, goal), person)


for _name in SCENES:
    register_motion(_name, lambda person, rng, name=_name: make_scene(name, person))


def before_work_places(
    motion: HumanMotion, robot: Robot, places: np.ndarray
) -> HumanMotion:
    """Return a motion with the person moved along with the work places (n, dof).

    A scene is staged before them. Other motions, such as recorded ones and keys, stand
    where they were told to.
    """
    if isinstance(motion, Scene):
        return motion.before(robot, places)
    if motion.name not in motion_names():
        return motion
    tools = [tool_pose(robot, q)[:3, 3] for q in places]
    offset = np.mean(tools, axis=0) - SCRIPTED_FOR
    return motion if np.linalg.norm(offset) < NEAR else Placed(motion, offset=offset)
