"""`odm bench interrupts`: Ctrl-C at many moments of commands that take long.

Each command runs in a process and a folder of its own, as from a terminal: SIGINT is
not ignored. After the signal the process must end within 2 s with exit code 130 and
leave nothing: no process of its group, nothing in its folder but a whole map, no file
in the system's temporary folder, no unfinished file in numba's cache. With a cold cache
the compiler is at work for most of it.

The moments count from the start of the process, but none lies before our first line:
in the 20 to 50 ms until then Python itself starts, and Ctrl-C is told as a fatal error
of the interpreter (code 1) or ends it as a signal.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sim.tables.header import header
from sim.tables.table import value_row
from sim.terminal.interrupt import EXIT_CODE

MOMENTS = 40
FIRST_S, LAST_S = 0.02, 10.0  # the moments lie between these, denser at the beginning
LIMIT_S = 2.0
LOST_S = 30.0  # who has not ended by then is killed, and counted as lost
ROOT = Path(__file__).resolve().parents[3]
_ARM = ROOT / "maps" / "plain_arm.urdf"


@dataclass(frozen=True)
class Command:
    """A command that takes longer than any moment asked.

    Attributes:
        name: In the table.
        words: Of `odm`.
        cold: Whether numba's cache is empty.
    """

    name: str
    words: tuple[str, ...]
    cold: bool = False


@dataclass(frozen=True)
class Ending:
    """How one process ended.

    Attributes:
        moment: Of the signal, after the start of the process [s].
        code: Exit code; minus the signal's number where that ended it.
        seconds: From the signal to the end.
        left: What was left behind.
        text: What it said on stderr.
    """

    moment: float
    code: int
    seconds: float
    left: tuple[str, ...]
    text: str

    @property
    def clean(self) -> bool:
        """Return whether it ended by itself, told so, and left nothing."""
        return self.code == EXIT_CODE and not self.left

    @property
    def good(self) -> bool:
        """Return whether it ended as it should, and in time."""
        return self.clean and self.seconds <= LIMIT_S


def run(
    map_dir: Path | None = None,
    *,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Interrupt `odm build`, `odm run` and `odm workspace build` at many moments.

    Args:
        map_dir: Map for `odm run`; a small one is built where it is None.
        short: A few moments only.
        tell: Called with what is about to be done.

    Returns:
        Plain data for JSON: "header", "setup", "rows" and "tables".
    """
    tell, tables, rows = tell or (lambda text: None), [], []
    n = 4 if short else MOMENTS
    with tempfile.TemporaryDirectory() as folder:
        if map_dir is None:
            tell("a small map")
            map_dir = _small_map(Path(folder))
        warm(tell)
        for command in commands(map_dir):
            endings = []
            for moment in moments(n):
                tell(f"{command.name}, Ctrl-C after {moment:.2f} s")
                endings.append(interrupted(command, moment, Path(folder)))
            rows += _rows(command.name, endings)
            tables.append(_table(command.name, endings))
    setup = {"moments": n, "first and last": [FIRST_S, LAST_S], "limit": LIMIT_S}
    found = {"bench": "interrupts", "header": header(), "setup": setup}
    return found | {"rows": rows, "tables": tables}


def moments(n: int) -> list[float]:
    """Return n moments [s], denser at the beginning, where the imports are."""
    steps = [k / max(1, n - 1) for k in range(n)]
    return [FIRST_S + (LAST_S - FIRST_S) * step**1.5 for step in steps]


def commands(map_dir: Path) -> list[Command]:
    """Return what is interrupted."""
    arm = ("build", "--robot", str(_ARM), "--tip", "tool", "--nodes", "40000")
    build = (*arm, "--out", "map")
    run = ("run", "--map", str(map_dir.absolute()), "--seconds", "3000")
    reach = ("workspace", "build", "kawasaki_fs003n", "--samples", "2000000000")
    reach = (*reach, "--out", "reach")
    return [
        Command("odm build", build),
        Command("odm run", run),
        Command("odm workspace build", reach),
        Command("odm build, cold cache", build, cold=True),
    ]


def warm(tell: Callable[[str], None]) -> None:
    """Compile what the commands need, so that only the cold ones compile."""
    tell("compiling")
    words = [sys.executable, "-m", "sim", "warmup"]
    subprocess.run(words, cwd=ROOT, env=_environment(), capture_output=True, check=True)


def interrupted(command: Command, moment: float, folder: Path) -> Ending:
    """Run a command, interrupt it after `moment` seconds, and see what is left.

    Args:
        command: The command.
        moment: When SIGINT is sent, after the start of the process or, where that is
            later, at our first line [s].
        folder: Where its own folders are made; they are removed.
    """
    own = Path(tempfile.mkdtemp(dir=folder))
    work, temporary, cache = own / "work", own / "tmp", own / "cache"
    for path in (work, temporary, cache):
        path.mkdir()
    env = _environment() | {"TMPDIR": str(temporary)}
    if command.cold:
        env["NUMBA_CACHE_DIR"] = str(cache)
    process = subprocess.Popen(
        [sys.executable, "-m", "sim", *command.words],
        cwd=work,
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=_hear,
    )
    try:
        begun = time.perf_counter()
        time.sleep(moment)
        while process.poll() is None and not _listens(process.pid):
            time.sleep(0.001)
        moment, early = time.perf_counter() - begun, process.poll() is not None
        process.send_signal(signal.SIGINT)
        begun = time.perf_counter()
        with suppress(subprocess.TimeoutExpired):
            process.wait(LOST_S)
        seconds = time.perf_counter() - begun
        left = (*_left(process, work, temporary, cache), *["ended before"] * early)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        text = process.communicate()[1].decode(errors="replace")
        shutil.rmtree(own, ignore_errors=True)
    return Ending(moment, process.returncode, seconds, left, text)


def _listens(pid: int) -> bool:
    """Return whether the process runs its second thread, the one that hears Ctrl-C."""
    threads = Path(f"/proc/{pid}/task")
    return not threads.is_dir() or len(list(threads.iterdir())) > 1


def _hear() -> None:
    """Hear SIGINT as from a terminal, though the parent may ignore it (nohup)."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _environment() -> dict[str, str]:
    told = {"PYTHONPATH": str(ROOT), "PYTHONFAULTHANDLER": "1"}  # where it crashed
    return os.environ | told


def _left(
    process: subprocess.Popen, work: Path, temporary: Path, cache: Path
) -> list[str]:
    """Return what a process left behind: processes of its group, files, folders."""
    left = []
    with suppress(ProcessLookupError):
        os.killpg(process.pid, 0)
        left.append("a process")
    whole = [path for path in work.iterdir() if (path / "manifest.json").is_file()]
    files = [path for path in work.iterdir() if path not in whole]
    files += [*temporary.iterdir(), *cache.rglob("*.tmp.*")]
    return left + [path.name for path in files]


def _rows(name: str, endings: list[Ending]) -> list[dict]:
    good = sum(ending.good for ending in endings)
    longest = max(ending.seconds for ending in endings)
    return [
        value_row(f"{name}: ended well", good, "", least=len(endings)),
        value_row(f"{name}: longest", longest, "s", most=LIMIT_S),
    ]


def _table(name: str, endings: list[Ending]) -> dict:
    rows = [
        (f"{e.moment:.2f} s", str(e.code), f"{e.seconds:.2f} s",
         ", ".join(e.left) or "nothing")
        for e in endings
    ]  # fmt: skip
    return {"title": name, "head": ("Ctrl-C at", "code", "after", "left"), "rows": rows}


def _small_map(folder: Path) -> Path:
    from odm import build_map
    from odm.cell_map.recipe import Recipe, RobotRecipe
    from roadmap.graph.connecting import RoadmapSettings

    robot = RobotRecipe(source=str(_ARM), tip="tool", cover_excess=0.05)
    recipe = Recipe("plain_arm", robot, RoadmapSettings(nodes=1500))
    return build_map(recipe).save(folder / "map")
