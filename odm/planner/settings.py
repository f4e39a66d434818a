"""What a user of the reactive planner may turn."""

from dataclasses import dataclass

from odm.search.state import MAX_ATTACHMENTS
from roadmap.errors import BadInput
from roadmap.ranges import check_settings

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
_COUNTS = (
    "goal_connections",
    "start_connections",
    "close_test_connections",
    "confirmations",
    "persistence_frames",
    "point_capacity",
    "cached_goals",
    "search",
)


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
    max_range_m: float = 20.0

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            BadInput: One out of range.
        """
        check_settings(self, _RANGES, _COUNTS)
        named = isinstance(self.finger_pads, tuple | list)
        if not named or not all(isinstance(link, str) for link in self.finger_pads):
            raise BadInput(
                f"finger_pads is {self.finger_pads!r}, but must be a tuple of link "
                "names; change it in PlannerSettings"
            )
