"""What a user of the reactive planner may turn."""

from dataclasses import dataclass

from odm.obstacles.unit import MAX_RANGE_M
from odm.search.state import MAX_ATTACHMENTS
from roadmap.errors import BadInput
from roadmap.ranges import CheckedSettings, setting

MOST_EXTRA = 0.5  # [m] largest extra clearance


@dataclass(frozen=True)
class PlannerSettings(CheckedSettings):
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
        tight_ends: Where a frame holds since the cover refuses start or goals,
            `improve` lets the links' own hulls decide about them and about the short
            motion from or to there; the next frames use it (`Answer.by_links`), and
            take a millisecond or several. For clutter that stands, not beside people.
    """

    goal_connections: int = setting(18, 1, MAX_ATTACHMENTS)
    start_connections: int = setting(8, 1, MAX_ATTACHMENTS)
    close_test_connections: int = setting(3, 0, 1000)
    hysteresis: float = setting(0.15, 0.0, 1.0)
    confirmations: int = setting(3, 1, 1000)
    history_s: float = setting(0.25, 0.0, 60.0, "s")
    history_clearance: float = setting(0.03, 0.0, 0.5, "m")
    smoothing_clearance: float = setting(0.03, 0.0, 0.5, "m")
    persistence_frames: int = setting(12, 0, 1_000_000)
    extra_clearance: float = setting(0.0, 0.0, MOST_EXTRA, "m")
    finger_pads: tuple[str, ...] = ()
    max_age_s: float = setting(0.1, 0.0, 60.0, "s")
    point_capacity: int = setting(32768, 1, 100_000_000)
    cached_goals: int = setting(0, 0, 10_000)
    search: int = setting(1000, 0, 10_000_000)
    max_range_m: float = setting(MAX_RANGE_M, 0.1, 1e6, "m")
    tight_ends: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        named = isinstance(self.finger_pads, tuple | list)
        if not named or not all(isinstance(link, str) for link in self.finger_pads):
            raise BadInput(
                f"finger_pads is {self.finger_pads!r}, but must be a tuple of link "
                "names; change it in PlannerSettings"
            )

    @property
    def wary_clearance(self) -> float:
        """What a new path keeps more where it can [m]; 0 without a history."""
        return self.history_clearance if self.history_s else 0.0


@dataclass(frozen=True)
class AttachSettings(CheckedSettings):
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
        waiting_tests: Waiting nodes of start and goals that a frame without a path
            tests.
        path_first: Tests of `improve` spent on a new start's path before its motions.
        rejoin_in: Frames at one place without a path, after which a start is joined
            anew,
        rejoin_idle_in: ... or, between frames, with a path that could be followed.
        jump: A robot that moved farther than this in a frame has jumped [rad or m].
        kept_tight: `PlannerSettings.cached_goals` at least, with tight ends: each time
            that one is used, or no more, the search gets other goals.
    """

    looked_at: int = setting(4, 1, 10_000)
    goal_at_once: int = setting(6, 1, 10_000)
    pose_at_once: int = setting(4, 1, 10_000)
    start_at_once: int = setting(4, 1, 10_000)
    start_rounds: int = setting(2, 1, 10_000)
    nearer: float = setting(1.5, 1.0, 100.0)
    moving_nodes: int = setting(6, 1, 10_000)
    moving_connections: int = setting(3, 1, 10_000)
    waiting_tests: int = setting(8, 1, 10_000)
    path_first: int = setting(8, 1, 10_000)
    rejoin_in: int = setting(3, 1, 10_000)
    rejoin_idle_in: int = setting(12, 1, 10_000)
    jump: float = setting(0.2, 0.0, 10.0, "rad or m")
    kept_tight: int = setting(8, 0, 10_000)


@dataclass(frozen=True)
class ConnectSettings(CheckedSettings):
    """How the search beyond the roadmap shares out its work (`connect.Connector`).

    Attributes:
        shorten: Configurations spent on shortening a path that was found.
        frames_at_first: `PlannerSettings.search` is spent in about so many frames.
        later_divisor: Then, and while the robot moves, a frame spends
            `PlannerSettings.search` over this.
        search_every: Once all is spent at one place, one frame in so many searches.
        join_every: Frames from joining a standing robot to corners of a found path to
            joining it again.
        joins: To how many corners.
        per_test: Configurations for each motion that `improve` may test.
    """

    shorten: int = setting(250, 1, 10_000)
    frames_at_first: int = setting(8, 1, 10_000)
    later_divisor: int = setting(16, 1, 10_000)
    search_every: int = setting(8, 1, 10_000)
    join_every: int = setting(4, 1, 10_000)
    joins: int = setting(3, 1, 10_000)
    per_test: int = setting(250, 1, 10_000)


@dataclass(frozen=True)
class ImproveSettings(CheckedSettings):
    """How `improve` shares out its budget (`improve.Improver`, `improve.Cutter`).

    Attributes:
        look_every: Frames between two looks for a better path or goal.
        join_takes: Tests that the robot's join to the roadmap takes as long as.
        min_cut_saving: A cut must save this share of the length of what it replaces.
        items_per_test: Nodes and edges near what was added to the scene that are
            tested for each test in the budget.
        nodes_at_first: Near nodes that the first frame without a path at a place looks
            at; later ones look at one each.
    """

    look_every: int = setting(8, 1, 10_000)
    join_takes: int = setting(3, 1, 10_000)
    min_cut_saving: float = setting(0.02, 0.0, 1.0)
    items_per_test: int = setting(4, 1, 10_000)
    nodes_at_first: int = setting(4, 1, 10_000)


@dataclass(frozen=True)
class SmoothingSettings(CheckedSettings):
    """Which changes of a path are weighed, and made (`smooth.Smoother`).

    Attributes:
        min_saving: Share of the rest's time that a change must save.
        min_saving_near: The same for one that does not keep the smoothing clearance.
        speed_share: Share of the joints' speed limits that the robot will use.
        kept_s: The part of the path that is reached within this time stays [s].
        draws: Changes weighed for each one that is tested, which costs far more.
        min_cut: Share of the rest's length that one of the largest cuts must save.
        cut_looks: Of these so many that the frame blocks count as one test.
        min_detour: A rest that is shorter, over the straight motion to the goal, stays.
        retry_frames: Frames until a straight motion that was blocked is tested again.
        corners: Corners of the roadmap at which it is measured what rounding gains.
    """

    min_saving: float = setting(0.01, 0.0, 1.0)
    min_saving_near: float = setting(0.3, 0.0, 1.0)
    speed_share: float = setting(0.5, 0.01, 1.0)
    kept_s: float = setting(0.05, 0.0, 10.0, "s")
    draws: int = setting(40, 1, 10_000)
    min_cut: float = setting(0.02, 0.0, 1.0)
    cut_looks: int = setting(8, 1, 10_000)
    min_detour: float = setting(1.1, 1.0, 100.0)
    retry_frames: int = setting(8, 1, 10_000)
    corners: int = setting(128, 1, 10_000)


@dataclass(frozen=True)
class RetreatSettings(CheckedSettings):
    """When backing off and evasion are worth their motion (`retreat.Retreat`).

    Attributes:
        near: Points farther than this are no reason to back off [m].
        min_gain: Separation that backing off must gain [m].
        tried: Directions that are tried: towards this many of the nearest nodes.
        shares: Shares of the motion to such a node, the largest first.
        ample_margin: An evasion that keeps so much more than needed is taken at once
            [m].
        min_evasion_gain: Separation that an evasion must gain over standing still [m].
        directions: Directions that an evasion looks at.
        reaction_s: Time that the robot takes to begin to move [s].
    """

    near: float = setting(0.15, 0.0, 10.0, "m")
    min_gain: float = setting(0.01, 0.0, 10.0, "m")
    tried: int = setting(12, 1, 10_000)
    shares: tuple[float, ...] = setting((1.0, 0.5, 0.25), 0.001, 1.0)
    ample_margin: float = setting(0.12, 0.0, 10.0, "m")
    min_evasion_gain: float = setting(0.03, 0.0, 10.0, "m")
    directions: int = setting(24, 1, 10_000)
    reaction_s: float = setting(0.06, 0.0, 10.0, "s")


@dataclass(frozen=True)
class TightSettings(CheckedSettings):
    """How ends are left that the cover alone refuses (`tight_ends.TightEnds`).

    Attributes:
        retry_every: Frames after which it looks again where there was no way.
        most_goals: The first so many goals are looked at.
        spare: A goal that the cover refused is one as any other again when the cover is
            so much farther away than it must be [m].
        near: Start and goal that are no farther apart are joined straight, too
            [rad or m].
        rounds: Steps, each up the slope of the cover's distance, that lead out at most;
            a step counts as a test of `improve`.
        step: Length of the first; halved where it gains nothing [rad or m].
    """

    retry_every: int = setting(8, 1, 10_000)
    most_goals: int = setting(4, 1, 10_000)
    spare: float = setting(0.005, 0.0, 1.0, "m")
    near: float = setting(0.5, 0.0, 10.0, "rad or m")
    rounds: int = setting(24, 1, 10_000)
    step: float = setting(0.08, 1e-3, 10.0, "rad or m")


@dataclass(frozen=True)
class PoseSettings(CheckedSettings):
    """How configurations of a tool pose are looked for (`pose_goals.PoseGoals`).

    Attributes:
        seeds: Roadmap nodes, the nearest by tool pose, that descents start from.
        steps: Steps of a descent: from near it takes about 5.
        long_descents: Descents of more steps, where no quick one arrives.
        max_solutions: Solutions of a pose that are looked at.
        same_within: Solutions nearer than this in all joints are one [rad or m].
    """

    seeds: int = setting(24, 1, 10_000)
    steps: int = setting(16, 1, 10_000)
    long_descents: int = setting(4, 1, 10_000)
    max_solutions: int = setting(12, 1, 10_000)
    same_within: float = setting(0.15, 0.0, 10.0)
