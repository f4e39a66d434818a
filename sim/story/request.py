"""What `odm demo` is asked for, and the hand-over as it plays it."""

from dataclasses import dataclass, replace
from pathlib import Path

from sim.run.request import file_trouble, page_trouble
from sim.terminal.checks import FILM, PICTURES, RECORDING, SECONDS, Limits
from sim.terminal.flags import (
    Host,
    JointNames,
    Json,
    MocapFile,
    Port,
    Seed,
    Threads,
    Token,
    argument,
    flag,
    goes_with,
    optional,
    switch,
)

WORK, HANDOVER, MAINTENANCE = "work", "handover", "maintenance"
PANDA, ARMAR3 = "panda", "armar3"  # robots of the maintenance demo
MOCAP, KEYBOARD = "mocap", "keyboard"
MOST_CYCLES = 10_000
LASTS_S = 30.0  # of a demo [s]


@dataclass(frozen=True)
class DemoRequest:
    """What `odm demo` is asked for."""

    story: str = argument(
        WORK,
        "work: between two places beside an arm; handover: gives or takes a wrench; "
        "maintenance: three tools up to a person on a ladder, and back.",
        metavar="work|handover|maintenance",
    )
    out: Path = flag(
        Path("out"),
        "Folder for pictures and figures.",
        writes=replace(PICTURES, always=True),
    )
    seconds: float | None = optional(
        "Simulated time in s; 30 if left, up to 4 times that for a slow robot.",
        limits=SECONDS,
    )
    threads: Threads = 0
    direction: str | None = optional(
        "Who gives: the robot (give) or the person.", metavar="give|receive"
    )
    human: str | None = optional(
        "Who moves the person (handover): a script that reaches and pulls, a "
        "recording (--file), or keys, which move the arm that takes.",
        metavar="scripted|mocap|keyboard",
    )
    file: MocapFile = None
    mapping: JointNames = None
    accept_defects: bool = switch(
        "Play a recording even where it shows what no person does (--file)."
    )
    seed: Seed = 0
    reach: Path | None = optional(
        "Reach map of the robot (handover); built if left.", metavar="DIR"
    )
    map_dir: Path | None = optional(
        "A map's folder (handover); built if left.", "--map", metavar="MAP"
    )
    pads: list[str] | None = optional(
        "A link that may touch an object (handover, maintenance); again for more; "
        "those with 'finger', 'thumb' or 'pad' in their name if left.",
        metavar="LINK",
    )
    object: str | None = optional(
        "What is handed over (handover): a closed mesh (STL, OBJ, ...) that the hand "
        "can hold, or an object by name; a wrench if left.",
        metavar="FILE",
    )
    mass: float | None = optional(
        "Mass of the mesh in kg (--object); 500 kg/m3 times its volume if left.",
        limits=Limits(0.0, 100.0, "kg", above=True, hint="such as 0.3"),
    )
    scale: float | None = optional(
        "Unit of the mesh in m (--object): 0.001 for millimetres; metres if left.",
        limits=Limits(0.0, 1000.0, "m", above=True, hint="such as 0.001"),
    )
    record: Path | None = optional(
        "Write the hand-over; `odm replay` repeats it, `odm view` shows it.",
        writes=RECORDING,
    )
    film: Path | None = optional("Write the hand-over as a film.", writes=FILM)
    robot: str | None = optional(
        "Who gives and takes the tools (maintenance); panda if left.",
        metavar="panda|armar3",
    )
    cycles: int = flag(1, "Cycles, a seed each (maintenance).", min=1, max=MOST_CYCLES)
    view: bool = switch("Watch the hand-over on a page in the browser, as it goes.")
    port: Port = None
    host: Host = None
    token: Token = None
    json: Json = None

    def __post_init__(self) -> None:
        from roadmap.errors import BadInput

        trouble = self._trouble()
        if trouble:
            raise BadInput(trouble)

    def _trouble(self) -> str:
        if self.story not in (WORK, HANDOVER, MAINTENANCE):
            return (
                f"there is no demo {self.story!r}; choose {WORK}, {HANDOVER} or "
                f"{MAINTENANCE}"
            )
        if self.story == MAINTENANCE:
            return self._trouble_of_the_cycle()
        what = "`odm demo maintenance`"
        if told := goes_with(self, ("robot", "cycles"), what, "leave it out"):
            return told
        only = ("direction", "human", "file", "mapping", "reach", "map_dir")
        only = (*only, "pads", "record", "film", "object", "mass", "scale")
        if self.story == WORK:
            only = (*only, "accept_defects", "view")
            what = "`odm demo handover`"
            return goes_with(self, only, what, "leave it out") or page_trouble(self)
        if self.object is None:
            names = ("mass", "scale")
            if told := goes_with(self, names, "--object FILE", "leave it out"):
                return told
        if self.direction not in (None, "give", "receive"):
            return f"--direction is {self.direction!r}: choose give or receive"
        if self.human not in (None, "scripted", MOCAP, KEYBOARD):
            return f"--human is {self.human!r}: choose scripted, mocap or keyboard"
        if self.human == KEYBOARD and self.direction == "receive":
            return "the keys' person takes, and cannot give: leave --direction out"
        if (self.human == "mocap") != (self.file is not None):
            return "--human mocap and --file F go together; give both or neither"
        if self.file is None:
            names, what = ("mapping", "accept_defects"), "--human mocap --file F"
            if told := goes_with(self, names, what, "leave it out"):
                return told
        if self.human == "mocap" and self.direction == "receive":
            return "a recorded person takes, and cannot give: leave --direction out"
        return file_trouble(self.file, self.mapping) or page_trouble(self)

    def lasts(self, patience: float = 1.0) -> float:
        """Return the simulated time [s].

        Args:
            patience: Times as long, where none is asked for.
        """
        return patience * LASTS_S if self.seconds is None else self.seconds

    def _trouble_of_the_cycle(self) -> str:
        person = ("direction", "human", "file", "mapping", "accept_defects")
        person = (*person, "object", "mass", "scale")
        what = "`odm demo handover`, a maintenance cycle gives and takes"
        names = (*person, "view", "port", "host", "token")
        if told := goes_with(self, names, what, "leave it out"):
            return told
        if self.robot not in (None, PANDA, ARMAR3):
            return (
                f"--robot is {self.robot!r}: choose {PANDA} or {ARMAR3}, or give --map "
                "MAP"
            )
        return ""
