"""Settings of a hand-over: distances, patience, the way back.

`StorySettings` and its parts are what a caller sets, and are kept in recordings. The
others tune how a story is played, and are not.
"""

from dataclasses import dataclass, field

import numpy as np

from odm.execution.speed_limit import SpeedSettings
from odm.execution.threat import ThreatSettings
from roadmap.errors import BadInput
from roadmap.kinematics.joint_tree import JOINT, KIND, REVOLUTE, check_robot
from roadmap.ranges import CheckedSettings, check_kind, setting, told
from roadmap.robot.robot import Robot
from sim.story.machine import DIRECTIONS
from sim.story.pull import PullSettings

# who hands over waits for the robot, or comes to it: no harder from now on than so far
PARTNER = ThreatSettings(jerk=0.0)
QUICK_TURN = 2.0  # [rad/s] of a joint; times are limited for robots as quick as that
MOST_PATIENT = 4.0  # times as long, however slow a robot is


@dataclass(frozen=True)
class ComfortSettings(CheckedSettings):
    """What makes a hand-over pleasant: costs of new paths, never conditions.

    Where the hand-over itself is, and whether the person sees it, is the targets'
    business (`handover.QualitySettings`); the speed near the hand is
    `SpeedSettings.hand_speed`.

    Attributes:
        face_to_hand: New paths keep clear of a rod of this radius between the person's
            face and the hand that takes part, where they can [m]; 0: they do not.
        unseen: ... of a rod of this radius behind the person, where they do not look
            [m]; 0: they do not.
    """

    face_to_hand: float = setting(0.06, 0.0, 0.5, "m")
    unseen: float = setting(0.20, 0.0, 0.5, "m")


@dataclass(frozen=True)
class ComfortRodSettings(CheckedSettings):
    """Where the rods are that new paths keep clear of (`comfort.comfort_rods`).

    Attributes:
        short: The hand's end of the rod to it is left out by this [m]: there the object
            is handed over.
        behind: The other rod is this far behind the head [m],
        down: ... and goes down from there by this [m].
    """

    short: float = setting(0.12, 0.0, 2.0, "m")
    behind: float = setting(0.35, 0.0, 2.0, "m")
    down: float = setting(0.60, 0.0, 2.0, "m")


@dataclass(frozen=True)
class ConductSettings(CheckedSettings):
    """How a story reads its frames and shares out their time (`handover.Handover`).

    Attributes:
        arrived: Largest distance of a joint from a goal that is reached [rad or m].
        tracked: The straight motion is aimed anew when the object moved by this [m].
        stands: A robot slower than this in all joints stands [rad/s or m/s].
        gone_s: A hand that was away for so long has gone [s].
        felt_s: Fingers that are said for so long to hold nothing, or to hold something
            after all, are believed [s].
        missing_s: A part of the person that was seen, and is not now, is taken to be
            where it was for so long [s], and to come from there: most often the robot
            itself hides it. More: the robot waits for longer after somebody has left
            all at once. 0: who is not seen is not there.
        instead: The person's other hand takes part from now on once it has been held
            out toward the robot's base by this, and by as much farther than the one
            that did, for `gone_s` [m]; not while that one is so near to the object.
        expected: Times ahead at which new paths keep clear of the person [s].
        untouched: Times, longest first: within the first of them in which nobody can
            reach a resting object, it is not expected to move [s].
        hurries: An object this many times as fast as `still_speed` is not put between
            the pads.
        goes_on_s: Time over which an object's speed is averaged [s]. More: a trembling
            hand seems stiller, and one that sets off is noticed later.
        leap_s: Two frames farther apart than this mean that the clock was set [s].
        periods: Periods that a frame counts for at most: a late frame does not show
            that something lasted.
        tell_s: Interval at which the planner is told where the person will be [s]; its
            history is ten times as long.
        late_s: Age at which that is told in any case, before the step [s].
        moved_off: Distance that counts as having moved off a place [m].
        tests: Tests of `improve` in a frame, where there is time for them,
        tests_moving: ... and while the robot moves.
        braked_every: Frames after which a braked robot looks for grasps anew.
        too_rare: A robot in whose shortest stop, a frame included, somebody may come
            nearer by this [m] hardly ever closes on what they hold out: at 20 Hz 2 cm,
            and a Panda takes all, at 10 Hz 6 cm, and none.
    """

    arrived: float = setting(1e-4, 1e-9, 0.1, "rad or m")
    tracked: float = setting(0.004, 0.0, 0.1, "m")
    stands: float = setting(1e-3, 1e-9, 1.0, "rad/s or m/s")
    gone_s: float = setting(0.5, 0.001, 60.0, "s")
    felt_s: float = setting(0.03, 0.0, 60.0, "s")
    missing_s: float = setting(2.0, 0.0, 60.0, "s")
    instead: float = setting(0.05, 0.001, 2.0, "m")
    expected: tuple[float, ...] = setting((0.1, 0.2, 0.3, 0.4), 0.0, 10.0, "s")
    untouched: tuple[float, ...] = setting((0.8, 0.5, 0.3, 0.2, 0.1), 0.0, 10.0, "s")
    hurries: float = setting(2.0, 0.1, 100.0)
    goes_on_s: float = setting(0.12, 0.001, 60.0, "s")
    leap_s: float = setting(1.0, 0.001, 60.0, "s")
    periods: int = setting(3, 1, 1000)
    tell_s: float = setting(0.025, 0.001, 60.0, "s")
    late_s: float = setting(0.08, 0.001, 60.0, "s")
    moved_off: float = setting(0.05, 0.001, 2.0, "m")
    tests: int = setting(2, 1, 1000)
    tests_moving: int = setting(1, 1, 1000)
    braked_every: int = setting(4, 1, 1000)
    too_rare: float = setting(0.025, 0.001, 1.0, "m")


@dataclass(frozen=True)
class GraspingSettings(CheckedSettings):
    """How hard a grasp of what is held out is looked for (`grasping.Reaches`).

    Attributes:
        seeds: Near nodes that inverse kinematics starts from, for each grasp,
        most_seeds: ... and the most of them, where fewer lead nowhere.
        shares: Shares of the straight way's length, tried in turn.
        kept: Pairs of configurations, at the object and before it, that are kept.
        steps: Steps of the inverse kinematics.
        tolerance: Largest error of the tool's pose [m] and [rad].
        straight: Largest move of a joint from before the object to it [rad].
        lengths: Ways back that are tried until one has room,
        more: ... each longer by what lacks and this [m].
        looked_at: Nodes at which the arm beside a grasped object is checked.
        out_steps: Steps at most in which an object is held farther out of the hand,
        most_out: ... and how far at most, until no link is too near to it [m].
    """

    seeds: int = setting(6, 1, 10_000)
    most_seeds: int = setting(48, 1, 10_000)
    shares: tuple[float, ...] = setting((1.0,), 0.05, 1.0)
    kept: int = setting(4, 1, 10_000)
    steps: int = setting(40, 1, 10_000)
    tolerance: float = setting(1e-3, 1e-9, 0.1)
    straight: float = setting(0.9, 0.01, np.pi, "rad")
    lengths: int = setting(3, 1, 10_000)
    more: float = setting(0.002, 1e-6, 2.0, "m")
    looked_at: int = setting(100, 1, 10_000)
    out_steps: int = setting(20, 1, 10_000)
    most_out: float = setting(0.25, 1e-6, 2.0, "m")


def patience_with(robot: Robot) -> float:
    """Return how many times as long a robot may take as a quick one; 1 to 4.

    Quick is whose turning joints reach 2 rad/s, in the middle of all, as a Panda's do.
    """
    tree = robot.tree_i
    turning = np.unique(tree[tree[:, KIND] == REVOLUTE, JOINT])
    if not len(turning):
        return 1.0
    speed = float(np.median(robot.max_velocity[turning]))
    return min(max(1.0, QUICK_TURN / speed), MOST_PATIENT)


# at a place on a table; the object in the hand is held by one grasp of four
AT_PLACE = GraspingSettings(most_seeds=6, shares=(1.0, 0.75, 0.5))
HELD_AT_PLACE = GraspingSettings(seeds=24, most_seeds=24, shares=(1.0, 0.75, 0.5))


@dataclass(frozen=True)
class GripperSettings(CheckedSettings):
    """The simulated gripper of two fingers (`play.Fingers`).

    Attributes:
        closing_s: Time of the fingers from open to closed [s].
        held: Share to which they close on an object.
        loose: Open farther than this share they do not hold any more.
        between: An object so near to where a grasp has it is between the fingers [m].
    """

    closing_s: float = setting(0.25, 0.001, 60.0, "s")
    held: float = setting(0.15, 0.0, 1.0)
    loose: float = setting(0.4, 0.0, 1.0)
    between: float = setting(0.025, 0.0, 0.5, "m")


_PARTS = {
    "pull": PullSettings,
    "speed": SpeedSettings,
    "comfort": ComfortSettings,
    "threat": ThreatSettings,
}


@dataclass(frozen=True)
class StorySettings(CheckedSettings):
    """How a hand-over goes; all times are of the frames' clock.

    Attributes:
        direction: "give" or "receive".
        near: A receiving hand this near to the object has come [m],
        comes: ... if it came nearer by this since the object was held out [m], unlike a
            hand that hangs beside it. 0: any hand that near counts; above 0, one that
            waits there from the beginning never does.
        gone: A hand farther away than this has gone again [m].
        back: Length of the straight motions to an object and away from it [m]; longer
            where `room` asks for it.
        room: Distance beyond the clearance at which the robot waits before an object
            [m]. 0.02: more than the 13 mm that a hand may come in the 80 ms of a stop;
            with 4 mm the robot creeps.
        follow: The robot follows an object that moved by this [m].
        still_speed: An object slower than this on average is held still [m/s],
        steady_s: ... and after so long the robot closes in [s].
        between: An object this near to where a grasp would have it is between the
            fingers [m],
        between_rad: ... if it is turned by no more than this [rad], and the map's
            payload envelope, if it has one, has room for it there.
        leave_s: The person has left after so long without a place in reach [s].
        blocked_s: Another way is taken after so long without a certified motion [s].
        tries: Failures in a row to find a certified motion to the object, after which
            the robot gives up. 4: one for each quarter turn of the grasp.
        stuck_s: A robot that is stopped for so long on its way to a target tries
            another one first [s].
        grip_s: After so long the fingers have closed, on the object or on nothing [s].
        wait_s: Patience in any state beside the person [s].
        fetch_s: Time limit for fetching the object [s].
        place_s: After so long on its way to a place [s], most of it slowed or stopped
            for the person, the robot puts the object down in another one.
        again_s: Where no place could be reached, the robot waits at rest for so long
            [s], or until the person moved off, and tries again.
        put_down_s: Time limit for putting down, other places and waiting included [s].
        slow: Whether the speed near the person follows `speed`.
        pull: What counts as a pull at the wrist.
        speed: Terms of speed and separation.
        comfort: Where new paths do not pass, if they can.
        threat: Bounds on the person's motion, and on the measured error of person and
            object. Default: `PARTNER`, somebody who is and stays calm; beside people in
            a hurry give `ThreatSettings()`. A sensor that is not exact needs its
            `noise`: else its errors look like a part that starts off, and the robot
            waits.
        seen_every_s: Largest time from one `StoryFrame.stamp` to when the next one is
            known, for a loop that is quicker than its tracker: by then somebody may
            have come as much nearer as in a loop so slow, and the robot keeps more room
            [s]. 0: each frame is new.
    """

    direction: str = "give"
    near: float = setting(0.25, 0.001, 2.0, "m")
    comes: float = setting(0.0, 0.0, 2.0, "m")
    gone: float = setting(0.40, 0.001, 2.0, "m")
    back: float = setting(0.10, 0.001, 2.0, "m")
    room: float = setting(0.02, 0.0, 1.0, "m")
    follow: float = setting(0.02, 0.001, 2.0, "m")
    still_speed: float = setting(0.10, 0.001, 10.0, "m/s")
    between: float = setting(0.02, 0.001, 2.0, "m")
    between_rad: float = setting(0.35, 0.001, np.pi, "rad")
    steady_s: float = setting(0.15, 0.001, 3600.0, "s")
    leave_s: float = setting(1.0, 0.001, 3600.0, "s")
    blocked_s: float = setting(1.5, 0.001, 3600.0, "s")
    tries: int = setting(4, 1, 1000)
    stuck_s: float = setting(0.4, 0.001, 3600.0, "s")
    grip_s: float = setting(0.6, 0.001, 3600.0, "s")
    wait_s: float = setting(15.0, 0.001, 3600.0, "s")
    fetch_s: float = setting(20.0, 0.001, 3600.0, "s")
    place_s: float = setting(6.0, 0.001, 3600.0, "s")
    again_s: float = setting(3.0, 0.001, 3600.0, "s")
    put_down_s: float = setting(45.0, 0.001, 3600.0, "s")
    slow: bool = True
    pull: PullSettings = field(default_factory=PullSettings)
    speed: SpeedSettings = field(default_factory=SpeedSettings)
    comfort: ComfortSettings = field(default_factory=ComfortSettings)
    threat: ThreatSettings = PARTNER
    seen_every_s: float = setting(0.0, 0.0, 1.0, "s")

    @classmethod
    def for_robot(cls, robot: Robot, **settings: object) -> "StorySettings":
        """Return settings that give a slow robot more time for its own ways.

        Args:
            robot: The robot; see `patience_with`.
            settings: By name; these stay as they are given.

        Raises:
            BadInput: No robot, or one that does not say how fast its joints are.
        """
        check_robot(robot, "max_velocity")
        times, own = patience_with(robot), cls()
        names = ("wait_s", "fetch_s", "place_s", "put_down_s")
        longer = {name: times * getattr(own, name) for name in names}
        return cls(**(longer | settings))

    def __post_init__(self) -> None:
        super().__post_init__()
        asked = self.direction
        if not isinstance(asked, str) or asked not in DIRECTIONS:
            raise BadInput(
                f"direction is {told(asked)}; choose {' or '.join(DIRECTIONS)}"
            )
        for name, kind in _PARTS.items():
            check_kind(name, getattr(self, name), kind, f"give {kind.__name__}(...)")
        if self.gone < self.near:
            raise BadInput(
                f"gone is {self.gone} m, nearer than near, {self.near} m; give more"
            )
