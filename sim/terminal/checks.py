"""What a flag is given is looked at before any work: numbers, choices, files to write.

A file that cannot be written, or a picture whose library is missing, is told at once,
not after the run whose figures it was to hold.
"""

import difflib
import math
import os
import tempfile
from dataclasses import dataclass
from importlib import util
from pathlib import Path

# modules that come with an extra of the package only
EXTRAS = {
    "pybullet": "sim",
    "pybullet_data": "sim",
    "matplotlib": "sim",
    "PIL": "sim",
    "viser": "view",
    "ompl": "bench",
    "pinocchio": "bench",
    "example_robot_data": "robots",
    "sphinx": "docs",
}


class Refused(ValueError):
    """What was typed cannot be done: one sentence with value, limit and remedy.

    Not one of the planner's own errors, which bring its compiler along: a slip of the
    keyboard is told at once.
    """


@dataclass(frozen=True)
class Limits:
    """The numbers that a flag takes."""

    # least and largest; infinity: none
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""  # of the numbers, for the sentence
    above: bool = False  # `low` itself is not taken
    hint: str = ""  # what else to say: why, or a value that works

    def holds(self, value: float) -> bool:
        """Return whether a number is taken."""
        over = value > self.low if self.above else value >= self.low
        return math.isfinite(value) and over and value <= self.high

    def words(self) -> str:
        """Return the limits for people: "a number above 0 s, up to 100"."""
        unit = f" {self.unit}" if self.unit else ""
        high = f" up to {_plain(self.high)}" if math.isfinite(self.high) else ""
        if not math.isfinite(self.low):
            return f"a finite number{high}{unit}"
        if self.above:
            return f"a number above {_plain(self.low)}{high and ',' + high}{unit}"
        low = f" {'from' if high else 'of at least'} {_plain(self.low)}"
        return f"a number{low}{high.replace(' up', '')}{unit}"


@dataclass(frozen=True)
class Writes:
    """What a flag has written."""

    endings: tuple[str, ...] = ()  # endings that the file may have; empty: any
    what: str = "file"  # the kind of file, for the sentence
    needs: tuple[str, ...] = ()  # modules without which it cannot be made
    folder: bool = False  # a folder is named, not a file
    always: bool = False  # it is written where the flag is left out, too

    @property
    def metavar(self) -> str:
        """What stands in the help for the file or folder: PNG, DIR, ..."""
        file = self.endings[0][1:].upper() if self.endings else "FILE"
        return "DIR" if self.folder else file


PICTURE = Writes((".png",), "picture", ("matplotlib",))
FILM = Writes((".gif",), "film", ("matplotlib", "PIL"))
PICTURES = Writes(what="pictures", needs=("matplotlib", "PIL"), folder=True)
FOLDER = Writes(folder=True)
RECORDING = Writes((".npz",), "recording")
_OF_FILES = {".csv", ".gif", ".jpg", ".json", ".mp4", ".npz", ".pdf", ".png", ".toml"}
FINITE = Limits()
SECONDS = Limits(0.0, 86_400.0, "s", above=True)
RATE = Limits(1.0, 10_000.0, "Hz", hint="100 is a frame every 10 ms")
PIXELS = Limits(0.0, 1e6, "pixels", above=True)
ROTATIONS = Limits(1, 1_000_000, hint="such as 72 or 576")
PLACE = Limits(-100.0, 100.0, "m")
TURN = Limits(-360.0, 360.0, "degrees")
MOST_SEED = 2**31 - 1  # where maps and sets keep it
MOST_WORKERS = 4096  # threads or processes
HEIGHT = Limits(1.2, 2.2, "m", hint="a height of 175 cm is 1.75")


def check_value(
    word: str,
    value: object,
    limits: Limits | tuple[Limits, ...] | None = None,
    writes: Writes | None = None,
    choices: str = "",
) -> None:
    """Refuse what a flag `word` cannot be given, in one sentence with the remedy.

    `value` is text, a number, a path, or several. Without limits any finite number is
    taken; several limits are of each of its values, which `choices` then names. Else
    `choices` are words with "|" between them, and other text takes any.
    """
    values = value if isinstance(value, list | tuple) else [value]
    if isinstance(limits, tuple):
        for name, one, each in zip(choices.split(), values, limits, strict=True):
            _check_number(f"{word} {name}", one, each)
        return
    for one in values:
        if isinstance(one, float | int) and not isinstance(one, bool):
            _check_number(word, one, limits or FINITE)
        elif isinstance(one, str) and "|" in choices and choices.islower():
            check_choice(word, one, choices.split("|"))
    if writes is not None and value != "-" and value is not False:
        check_target(word, Path(str(value)), writes)


def _check_number(word: str, value: float, limits: Limits) -> None:
    if abs(value) > 1e300:  # a whole number may be too large for a float
        value = math.copysign(math.inf, value > 0 or -1)
    if not limits.holds(value):
        hint = f"; {limits.hint}" if limits.hint else ""
        raise Refused(f"{word} is {_plain(value)}: give {limits.words()}{hint}")


def _plain(value: float) -> str:
    """Return a number as a person writes it: 5000000, not 5e+06."""
    whole = isinstance(value, int) or (abs(value) < 1e10 and value == int(value))
    return str(int(value)) if whole else f"{value:g}"


def check_choice(word: str, value: str, choices: list[str]) -> None:
    """Refuse a word that is none of the choices, and name the nearest."""
    if value in choices:
        return
    near = difflib.get_close_matches(value.lower(), choices, 1, 0.6)
    told = f"did you mean {near[0]}? " if near else ""
    listed = f"{', '.join(choices[:-1])} or {choices[-1]}"
    raise Refused(f"{word} is {value!r}: {told}choose {listed}")


def check_target(word: str, path: Path, writes: Writes) -> None:
    """Refuse a file or folder that could not be written, before any work.

    A file is tried where it would lie, and leaves nothing behind.
    """
    endings = " or ".join(writes.endings)
    if writes.endings and path.suffix.lower() not in writes.endings:
        raise Refused(
            f"{word} {path}: a {writes.what} is written as {endings} only; name it "
            f"{path.with_suffix(writes.endings[0]).name}"
        )
    for module in writes.needs:
        if not is_there(module):
            instead = f", or leave {word} out"
            if writes.always:
                instead = "; `odm run` and docs/examples need none"
            raise Refused(
                f"{word} needs {module}, which is not installed; run: pip install "
                f"'odm-planner[{EXTRAS[module]}]'{instead}"
            )
    if not writes.folder and path.is_dir():
        raise Refused(f"{word} {path} is a folder; name a file in it")
    if writes.folder and path.suffix.lower() in _OF_FILES and not path.is_dir():
        raise Refused(
            f"{word} {path}: a folder is made there, and that is the name of a file; "
            f"name it {path.stem}"
        )
    if writes.folder and path.exists() and not path.is_dir():
        raise Refused(f"{word} {path} is a file; name a folder")
    if writes.endings and path.exists() and not (path.is_file() or path.is_dir()):
        raise Refused(f"{word} {path} is a device or a pipe; name a file")
    place = path if writes.folder else path.parent
    while not place.exists() and place != place.parent:
        place = place.parent
    if not place.is_dir():
        raise Refused(f"{word} {path}: {place} is no folder; choose another one")
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
        if place.stat().st_mode & 0o222 == 0:  # the superuser may, but did not mean to
            raise PermissionError(0, os.strerror(13))
    except OSError as error:
        raise Refused(
            f"{word} {path} cannot be written: {place}: {error.strerror}; choose "
            "another folder, or change its permissions"
        ) from error


def is_there(module: str) -> bool:
    """Return whether a module is installed, without importing it."""
    try:
        return util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False
