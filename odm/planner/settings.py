"""What a user of the reactive planner may turn."""

from dataclasses import dataclass, fields

from odm.obstacles.unit import MAX_RANGE_M
from odm.search.state import MAX_ATTACHMENTS
from roadmap.errors import BadInput
from roadmap.ranges import check_row, check_settings

MOST_EXTRA = 0.5  # [m] largest extra clearance
_RANGES = {
    "goal_connections": (1, MAX_ATTACHMENTS, ""),
    "start_connections": (1, MAX_ATTACHMENTS, ""),
    "close_test_connections": (0, 1000, ""),
    "hysteresis": (0.0, 1.0, ""),
    "confirmations": (1, 1000, ""),
    "history_s": (0.0, 60.0, "s"),
    "history_clearance": (0.0, 0.5, "m"),
    "smoothing_clearance": (0.0, 0.5, "m"),
    "persistence_frames": (0, 1_000_000, ""),
    "extra_clearance": (0.0, MOST_EXTRA, "m"),
    "max_age_s": (0.0, 60.0, "s"),
    "point_capacity": (1, 100_000_000, ""),
    "cached_goals": (0, 10_000, ""),
    "search": (0, 10_000_000, ""),
    "max_range_m": (0.1, 1e6, "m"),
}


@dataclass(frozen=True)
class PlannerSettings:
    """Settings of the reactive planner.

    Attributes:
        goal_connections: Number of certified motions that connect a goal to near
            nodes. More find a path to a goal in a narrow place, and cost milliseconds
            when the goal is set.
        start_connections: The same for a start configuration that is new.
        close_test_connections: Where the cells block every connection of a goal or a
            start, the close test is tried on twice this many of them.
        hysteresis: A path that is still free is replaced only by one that is shorter by
            this fraction of its length.
        confirmations: Number of consecutive searches, eight frames apart, that must
            find a better path before it replaces a free one. More: fewer changes.
        history_s: Length of the obstacle history [s]: a new path avoids what was
            occupied within it, if there is such a path. 0: no history. It should
            exceed the period of a trembling hand.
        history_clearance: Extra clearance that a new path keeps from the obstacles, if
            there is such a path [m].
        smoothing_clearance: Extra clearance of smoothed segments [m]; ignored by a
            change that saves three tenths of the time for the rest of the path.
        persistence_frames: If no path avoids the history, and the last path taken in
            spite of that got blocked, the next one of that kind must be found in this
            many consecutive frames before it is taken.
        extra_clearance: Distance kept beyond the map's clearance m [m]; it can be
            changed between frames by `set_extra_clearance`.
        finger_pads: Links that may touch what is about to be grasped.
        max_age_s: Older obstacle data hold the robot [s].
        point_capacity: Points of a frame that memory is laid out for at first; it
            grows when a frame has more.
        cached_goals: Number of goals, set or prepared, whose connections are kept, so
            that to set them again costs little; 0: only of those that are set.
        search: Where the roadmap has no path, a frame looks for one beyond it, by a
            tree search that looks at so many configurations (about 3 us each): an
            eighth of them in a frame until all are spent, then a sixteenth in every
            eighth frame (in each, of a robot on its way). It goes on in `improve`; 0:
            never. More answers sooner in narrow places, and makes frames longer that
            would hold.
        max_range_m: Where most points of a frame are farther than this from the
            robot's base along an axis, their unit is wrong: the frame holds [m].
    """

    goal_connections: int = 18
    start_connections: int = 8
    close_test_connections: int = 3
    hysteresis: float = 0.15
    confirmations: int = 3
    history_s: float = 0.25
    history_clearance: float = 0.03
    smoothing_clearance: float = 0.03
    persistence_frames: int = 12
    extra_clearance: float = 0.0
    finger_pads: tuple[str, ...] = ()
    max_age_s: float = 0.1
    point_capacity: int = 32768
    cached_goals: int = 0
    search: int = 1000
    max_range_m: float = MAX_RANGE_M

    def __post_init__(self) -> None:
        check_settings(self, _RANGES)
        named = isinstance(self.finger_pads, tuple | list)
        if not named or not all(isinstance(link, str) for link in self.finger_pads):
            raise BadInput(
                f"finger_pads is {self.finger_pads!r}, but must be a tuple of link "
                "names; change it in PlannerSettings"
            )


@dataclass(frozen=True)
class AttachSettings:
    """How and when goals and starts are joined to the roadmap (`attaching.Attacher`).

    Attributes:
        looked_at: Near nodes that may be tested for each connection wanted.
        goal_at_once: Motions that a goal gets at once; `improve` adds the others.
        pose_at_once: The same for a goal by pose, whose inverse kinematics take time.
        start_at_once: The same for a start.
        start_rounds: Rounds of `start_at_once` nodes that a new start tries at most.
        nearer: Factor on the length of the motion to a node, where nodes are ranked by
            the length of the whole path through them.
        moving_nodes: Near nodes that a moving robot may be joined to,
        moving_connections: ... and how many of them it is joined to at most.
        looks: Waiting nodes that a frame without a path tests, of start and goals.
        path_first: Tests of `improve` spent on a new start's path before its motions.
        stays: Frames at one place without a path, after which a start is joined anew,
        lingers: ... or, between frames, with a path that could be followed.
        passes: A robot that moved farther than this in a frame has jumped [rad or m].
    """

    looked_at: int = 4
    goal_at_once: int = 6
    pose_at_once: int = 4
    start_at_once: int = 4
    start_rounds: int = 2
    nearer: float = 1.5
    moving_nodes: int = 6
    moving_connections: int = 3
    looks: int = 8
    path_first: int = 8
    stays: int = 3
    lingers: int = 12
    passes: float = 0.2

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        ranges = dict.fromkeys(names, (1, 10_000, "")) | {"nearer": (1.0, 100.0, "")}
        ranges["passes"] = (0.0, 10.0, "rad or m")
        check_settings(self, ranges)


@dataclass(frozen=True)
class ConnectSettings:
    """How the search beyond the roadmap shares out its work (`connect.Connector`).

    Attributes:
        shorten: Configurations spent on shortening a path that was found.
        part: A frame spends this part of `PlannerSettings.search` until all is spent,
        again: ... then, and where the robot moves, this part,
        rest: ... and once all is spent in one place, only every `rest`-th frame
            searches.
        joins_in: Every so many frames a standing robot is joined to a found path's
            corners,
        joins: ... to so many of them.
        per_test: Configurations for each motion that `improve` may test.
    """

    shorten: int = 250
    part: int = 8
    again: int = 16
    rest: int = 8
    joins_in: int = 4
    joins: int = 3
    per_test: int = 250

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        check_settings(self, dict.fromkeys(names, (1, 10_000, "")))


@dataclass(frozen=True)
class ImproveSettings:
    """How `improve` shares out its budget (`improve.Improver`, `shortcuts.Cutter`).

    Attributes:
        look_every: Frames between two looks for a better path or goal.
        join_takes: Tests that the robot's join to the roadmap takes as long as.
        cut_saves: A cut must save this share of the length of what it replaces.
        items_per_test: Nodes and edges near what was added to the scene that are
            tested for each test in the budget.
        nodes_at_first: Near nodes that the first frame without a path at a place looks
            at; later ones look at one each.
    """

    look_every: int = 8
    join_takes: int = 3
    cut_saves: float = 0.02
    items_per_test: int = 4
    nodes_at_first: int = 4

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        ranges = dict.fromkeys(names, (1, 10_000, "")) | {"cut_saves": (0.0, 1.0, "")}
        check_settings(self, ranges)


@dataclass(frozen=True)
class SmoothingSettings:
    """Which changes of a path are weighed, and made (`smooth.Smoother`).

    Attributes:
        worth: Share of the rest's time that a change must save.
        much: The same for a change that does not keep the smoothing clearance.
        pace: Share of the joints' speed limits that the robot is expected to use.
        lead_s: The part of the path that is reached within this time stays [s].
        draws: Changes weighed for each one that is tested, which costs far more.
        detour: A rest shorter than this times the straight way to the goal stays.
        wait: Frames until a straight way that was blocked is tested again.
        corners: Corners of the roadmap at which it is measured what rounding gains.
    """

    worth: float = 0.01
    much: float = 0.3
    pace: float = 0.5
    lead_s: float = 0.05
    draws: int = 40
    detour: float = 1.1
    wait: int = 8
    corners: int = 128

    def __post_init__(self) -> None:
        ranges = dict.fromkeys(("worth", "much"), (0.0, 1.0, ""))
        ranges |= {"pace": (0.01, 1.0, ""), "lead_s": (0.0, 10.0, "s")}
        ranges |= {"detour": (1.0, 100.0, "")}
        ranges |= dict.fromkeys(("draws", "wait", "corners"), (1, 10_000, ""))
        check_settings(self, ranges)


@dataclass(frozen=True)
class RetreatSettings:
    """When backing off and evasion are worth their motion (`retreat.Retreat`).

    Attributes:
        near: Points farther than this are no reason to back off [m].
        gain: Separation that backing off must gain [m].
        tried: Directions that are tried: towards this many of the nearest nodes.
        shares: Shares of the motion to such a node, the largest first.
        ample: An evasion that keeps this much more than needed is taken at once [m].
        worth: Separation that an evasion must gain over standing still [m].
        directions: Directions that an evasion looks at.
        sets_off_s: Time that the robot takes to begin to move [s].
    """

    near: float = 0.15
    gain: float = 0.01
    tried: int = 12
    shares: tuple[float, ...] = (1.0, 0.5, 0.25)
    ample: float = 0.12
    worth: float = 0.03
    directions: int = 24
    sets_off_s: float = 0.06

    def __post_init__(self) -> None:
        ranges = dict.fromkeys(("near", "gain", "ample", "worth"), (0.0, 10.0, "m"))
        ranges |= dict.fromkeys(("tried", "directions"), (1, 10_000, ""))
        ranges["sets_off_s"] = (0.0, 10.0, "s")
        check_settings(self, ranges)
        check_row(self, "shares", 1e-3, 1.0)


@dataclass(frozen=True)
class PoseSettings:
    """How configurations of a tool pose are looked for (`pose_goals.PoseGoals`).

    Attributes:
        seeds: Roadmap nodes, the nearest by tool pose, that descents start from.
        steps: Steps of a descent: from near it takes about 5.
        long: Descents of more steps, where no quick one arrives.
        enough: Solutions of a pose that are looked at.
        same: Solutions nearer than this in all joints are one [rad or m].
    """

    seeds: int = 24
    steps: int = 16
    long: int = 4
    enough: int = 12
    same: float = 0.15

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        ranges = dict.fromkeys(names, (1, 10_000, "")) | {"same": (0.0, 10.0, "")}
        check_settings(self, ranges)
