"""What a user of the reactive planner may turn."""

from dataclasses import dataclass

from odm.search.state import MAX_ATTACHMENTS
from roadmap.errors import BadInput
from roadmap.ranges import check_settings

MOST_EXTRA = 0.5  # [m] largest extra clearance
_RANGES = {
    "attachments": (1, MAX_ATTACHMENTS, ""),
    "start_attachments": (1, MAX_ATTACHMENTS, ""),
    "close_tests": (0, 1000, ""),
    "margin": (0.0, 1.0, ""),
    "looks": (1, 1000, ""),
    "memory_s": (0.0, 60.0, "s"),
    "calm": (0.0, 0.5, "m"),
    "comfort": (0.0, 0.5, "m"),
    "patience": (0, 1_000_000, ""),
    "extra_clearance": (0.0, MOST_EXTRA, "m"),
    "max_age_s": (0.0, 60.0, "s"),
    "max_points": (1, 100_000_000, ""),
    "kept_goals": (0, 10_000, ""),
    "search": (0, 10_000_000, ""),
    "max_range_m": (0.1, 1e6, "m"),
}
_COUNTS = (
    "attachments",
    "start_attachments",
    "close_tests",
    "looks",
    "patience",
    "max_points",
    "kept_goals",
    "search",
)


@dataclass(frozen=True)
class PlannerSettings:
    """What a user may turn.

    Attributes:
        attachments: Motions that join a goal to near nodes. More find a path to a goal
            in a narrow place, and cost milliseconds when it is set.
        start_attachments: The same for a start never seen before.
        close_tests: Where all motions of a goal or a start are blocked by their cells,
            the close test looks for so many free ones.
        margin: A free path is given up only for one shorter by this share.
        looks: So many looks in a row, eight frames apart, must find a better path. More
            changes the path less often.
        memory_s: A new path keeps clear of where the obstacles were so long ago, if
            there is such a path [s]; 0 looks at the present frame only. Longer than
            the period of a trembling hand is long enough.
        calm: A new path keeps so much more distance than it must, if there is such a
            path [m].
        comfort: New legs of smoothing keep so much more distance than they must [m],
            but for a change that saves three tenths of the rest of the path.
        patience: After a path that was only just free was blocked, the next one of that
            kind must be there for so many frames before it is taken.
        extra_clearance: Distance kept beyond the map's clearance m [m]; it can be
            changed between frames by `set_extra_clearance`.
        pads: Links that may touch what is about to be grasped: the finger pads.
        max_age_s: Older obstacle data hold the robot [s].
        max_points: Room for points of a frame; grows when a frame has more.
        kept_goals: So many goals that were set or prepared stay attached, so that to
            set them again costs little; 0: those that are set, and no others.
        search: Where the roadmap has no path, a frame looks for one beyond it, by a
            tree search that looks at so many configurations (about 2 us each), and
            goes on in the next frames and in `polish`; 0: never. More answers sooner
            in narrow places, and makes frames longer that would hold.
        max_range_m: Where most points of a frame are farther than this from the
            robot's base along an axis, their unit is wrong: the frame holds [m].
    """

    attachments: int = 18
    start_attachments: int = 8
    close_tests: int = 3
    margin: float = 0.15
    looks: int = 3
    memory_s: float = 0.25
    calm: float = 0.03
    comfort: float = 0.06
    patience: int = 25
    extra_clearance: float = 0.0
    pads: tuple[str, ...] = ()
    max_age_s: float = 0.1
    max_points: int = 32768
    kept_goals: int = 0
    search: int = 1000
    max_range_m: float = 20.0

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            BadInput: One out of range.
        """
        check_settings(self, _RANGES, _COUNTS)
        named = isinstance(self.pads, tuple | list)
        if not named or not all(isinstance(link, str) for link in self.pads):
            raise BadInput(
                f"pads is {self.pads!r}, but must be a tuple of link names; change it "
                "in PlannerSettings"
            )
