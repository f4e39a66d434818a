"""What `odm run` is asked for: one object, from which its flags are made."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.terminal.checks import (
    FILM,
    PICTURE,
    PICTURES,
    PLACE,
    RATE,
    RECORDING,
    SECONDS,
    TURN,
    Limits,
)
from sim.terminal.flags import (
    Host,
    JointNames,
    Json,
    MapOption,
    MocapFile,
    Port,
    Seed,
    Token,
    flag,
    goes_with,
    optional,
    switch,
)

if TYPE_CHECKING:
    from handover.meet.held_object import HeldObject

OBJECTS = ("wrench", "mallet")  # what a robot can hold for a hand-over
_MEET_ONLY = ("reach", "between", "held", "side", "dwell")


@dataclass(frozen=True)
class RunRequest:
    """What `odm run` is asked for; its fields are the flags, but for one.

    Raises:
        BadInput: Options that do not go together, or a value that is no choice.
    """

    map_dir: MapOption
    motion: str = flag(
        "sweep",
        "The person: scripted, recorded (--file) or moved by your keys; "
        "hold, backoff and escape are scenes in which the robot has to.",
        # the names that are taken, too: see sim/people/human_motion.py
        metavar="sweep|reach|jitter|hover|intrusion|tremble|crowding|hold|backoff"
        "|escape|mocap|keyboard",
    )
    seconds: float | None = optional(
        "Simulated time in s; default: 30, the clip's, or until q.", limits=SECONDS
    )
    seed: Seed = 0
    rate: float = flag(100.0, "Frames per second (Hz).", limits=RATE)
    out: Path | None = optional("Folder for all pictures.", writes=PICTURES)
    plot: Path | None = optional("Write the latency plot.", writes=PICTURE)
    animation: Path | None = optional("Write a short film.", writes=FILM)
    file: MocapFile = None
    mapping: JointNames = None
    stand: tuple[float, float, float] | None = optional(
        "Where the recorded person stands, and the way they face: m, m, degrees, in "
        "the robot's base frame.",
        metavar="X Y YAW",
        limits=(PLACE, PLACE, TURN),
    )
    base_height: float = flag(
        0.75,
        "Robot's base above the recorded floor, in m.",
        limits=Limits(-5.0, 5.0, "m"),
    )
    accept_defects: bool = switch("Play a recording that shows what no person does.")
    execution: str = flag(
        "kinematic", "How the robot moves.", metavar="kinematic|timed"
    )
    no_yield: bool = switch("Do not get out of the way of who comes (timed).")
    targets: str = flag(
        "places",
        "To and fro between work places, or to the best reachable hand-over "
        "target of the person.",
        metavar="places|meet",
    )
    reach: Path | None = optional(
        "Reach map of the robot (meet); built if left.", metavar="DIR"
    )
    between: tuple[float, float] | None = optional(
        "The scripted person walks between these, m (meet).  [0.6 1.3]",
        metavar="NEAR FAR",
        limits=Limits(0.1, 5.0, "m"),
    )
    held: str | None = optional(
        "Object that the robot holds (meet).", "--object", metavar="wrench|mallet"
    )
    side: str | None = optional("Hand of the person (meet).", metavar="right|left")
    dwell: float | None = optional(
        "At a target for so long, in s, the robot goes back to where it began, and "
        "comes again (meet); stays if left.",
        limits=Limits(0.0, 3600.0, "s"),
    )
    record: Path | None = optional(
        "Write the whole run, however it ends; `odm replay` repeats it.",
        writes=RECORDING,
    )
    carry: float | None = optional(
        "Radius of a ball that the robot carries, in m; see docs/layers.md.",
        metavar="R",
        limits=Limits(0.0, 0.5, "m", above=True, hint="6 cm are 0.06"),
    )
    plan: Path | None = optional(
        "Hand over as a plan says whose giver is the map's robot; its receiver moves "
        "as planned. See docs/plans.md.",
        metavar="JSON",
    )
    early: float | None = optional(
        "The receiver reaches so much sooner, in s (--plan); below 0: later.",
        limits=Limits(-600.0, 600.0, "s"),
    )
    elsewhere: float | None = optional(
        "The receiver stands up to so far from there, in m, and turned by up to a "
        "degree for each cm, drawn by --seed (--plan).",
        metavar="M",
        limits=Limits(0.0, 0.5, "m"),
    )
    scene: Path | None = optional(
        "What else stands around, besides the map's scenery: a MoveIt .scene or a "
        "URDF; see docs/scene.md.",
        metavar="FILE",
    )
    view: bool = switch("Watch it on a page in the browser, at the clock's pace.")
    port: Port = None
    host: Host = None
    token: Token = None
    json: Json = None
    # time from audit to audit of the target pursued [s]; 0: none; no flag
    audit_s: float = 1.0

    def __post_init__(self) -> None:
        from roadmap.errors import BadInput  # not above: --help should be quick

        trouble = (
            self._of_the_person()
            or self._of_the_targets()
            or self._of_the_plan()
            or page_trouble(self)
        )
        if trouble:
            raise BadInput(trouble)
        if self.scene is not None:
            from odm.obstacles.scene_files import read_scene

            read_scene(self.scene)  # or it is refused

    def _of_the_person(self) -> str:
        """Return what is wrong with the motion's options, "" for nothing."""
        if self.execution != "timed":
            told = goes_with(self, ("no_yield",), "--execution timed", "leave it out")
            if told:
                return told
        if self.motion == "mocap" and self.file is None:
            return "--motion mocap plays a recording; name it with --file F"
        if self.motion != "mocap" and self.file is not None:
            return f"--file goes with --motion mocap, not with {self.motion}"
        if self.motion != "mocap":
            names = ("mapping", "stand", "base_height", "accept_defects")
            if told := goes_with(self, names, "--motion mocap"):
                return told
        pictures = {"--out": self.out, "--plot": self.plot}
        pictures["--animation"] = self.animation
        asked = [name for name, path in pictures.items() if path is not None]
        if self.live and asked:
            return (
                f"{asked[0]} writes pictures of a run known beforehand; "
                "leave it out with --motion keyboard"
            )
        if self.carry is not None:
            if self.live:
                return "--carry does not go with --motion keyboard; leave one out"
            if not 0.0 < self.carry < math.inf:
                return f"--carry is {self.carry}: give metres above 0"
        return file_trouble(self.file, self.mapping)

    def _of_the_targets(self) -> str:
        """Return what is wrong with the targets' options, "" for nothing."""
        if self.targets not in ("places", "meet"):
            return f"--targets is {self.targets!r}: choose places or meet"
        if not self.meets:
            return goes_with(self, _MEET_ONLY, "--targets meet")
        if told := goes_with(self, ("carry",), "--targets places", "leave it out"):
            return told
        if self.motion == "mocap":
            told = "leave it out; --stand says where a recorded one is"
            if told := goes_with(self, ("between",), "a scripted person", told):
                return told
        check_object(self.obj)
        if self.side not in (None, "left", "right"):
            return f"--side is {self.side!r}: choose left or right"
        if not 0 <= self.audit_s < math.inf:
            return f"audit_s is {self.audit_s} s; give 0 or more"
        if self.live and self.side == "left":
            return "the keys move the right arm; leave --side out"
        return ""

    def _of_the_plan(self) -> str:
        """Return what is wrong with the plan's options, "" for nothing."""
        if self.plan is None:
            names = ("early", "elsewhere")
            return goes_with(self, names, "--plan JSON", "add that")
        if self.motion != "sweep" or self.meets or self.carry is not None:
            return (
                "with --plan the plan says who moves, where to and what is held; leave "
                "--motion, --targets and --carry out"
            )
        return ""

    @property
    def quiet(self) -> bool:
        """Whether the terminal is left to the JSON."""
        return self.json == "-"

    @property
    def live(self) -> bool:
        """Whether keys move the person."""
        return self.motion == "keyboard"

    @property
    def meets(self) -> bool:
        """Whether the robot goes to hand-over targets."""
        return self.targets == "meet"

    @property
    def obj(self) -> str:
        """Name of what the robot holds for the person."""
        return self.held or OBJECTS[0]

    @property
    def distances(self) -> tuple[float, float]:
        """Between which a scripted person walks to and fro [m]."""
        from sim.people.whole_person import FAR, NEAR

        return self.between or (NEAR, FAR)

    def picture(self, chosen: Path | None, ending: str) -> Path | None:
        """Return a file that was named itself, or by --out; None: neither."""
        if chosen is not None or self.out is None:
            return chosen
        return self.out / f"{'plan' if self.plan else self.motion}{ending}"


def check_object(name: str) -> None:
    """Refuse the name of no object."""
    from roadmap.errors import BadInput

    if name not in OBJECTS:
        raise BadInput(f"--object is {name!r}: choose {' or '.join(OBJECTS)}")


def held_object(name: str) -> "HeldObject":
    """Return the object of a name."""
    import handover

    check_object(name)
    return getattr(handover, name)()


def file_trouble(file: Path | None, mapping: Path | None) -> str:
    """Return which file of a recorded person is not there, "" for none."""
    for path, kind in ((file, "recording, .csv or .bvh"), (mapping, "mapping, .toml")):
        if path is not None and not path.exists():
            return f"there is no file {path}; give the path of a {kind}"
    return ""


def page_trouble(request: Any) -> str:
    """Return what is wrong with the page's options of a request, "" for nothing."""
    if not request.view:
        return goes_with(request, ("port", "host", "token"), "--view")
    from sim.view.gate import LOCAL, PORT, listening
    from sim.view.viewer import check_viewer

    check_viewer()
    port = PORT if request.port is None else request.port
    listening(request.host or LOCAL, port).close()
    return ""
