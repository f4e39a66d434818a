"""Golden items by the command line: `python -m sim`, which is `odm`, in this process.

A part of `golden_work.py`, which runs in any checkout: nothing of `sim` is imported.
What a clock or the machine tells is left out of what the commands say.
"""

import contextlib
import hashlib
import importlib
import io
import json
import math
import os
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

import golden_scenes as scenes
import numpy as np
from golden_scenes import digest, flat

import odm

Lines = Iterator[str]
_CLOCK = frozenset((
    "timing", "setting", "header", "versions", "latency_us", "latency_s", "loop_cpu_s",
    "loop_wall_s", "seconds", "robot_seconds", "roadmap_seconds", "cpu_seconds",
    "cpu_ms", "folder_bytes", "figures", "sha256", "free_memory",
))  # fmt: skip
_HELP = (
    "", "build", "info", "audit", "run", "demo", "replay", "run-two", "camera",
    "warmup", "human", "human info", "workspace", "workspace build", "workspace info",
    "workspace meet", "workspace human",
)  # fmt: skip
_PLAIN = ("sweep", "reach", "jitter", "hover", "intrusion", "tremble", "crowding")
_STAGED = ("hold", "backoff", "escape")
_COLUMNS = {"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"}


class Shop:
    """The folder in which the work is done, and the maps in it.

    Args:
        folder: Empty at first; commands run in it.
    """

    def __init__(self, folder: Path) -> None:
        """Write the recipes."""
        self.folder = folder.absolute()
        self.folder.mkdir(parents=True, exist_ok=True)
        os.chdir(self.folder)
        os.environ.update(_COLUMNS)
        for name, recipe in scenes.RECIPES.items():
            Path(f"{name}.toml").write_text(f'name = "{name}"\n{recipe}')
        Path("wedge.stl").write_bytes(scenes.wedge_stl())
        Path("pairs.srdf").write_text(scenes.SRDF)
        self._loaded: dict[str, odm.CellMap] = {}
        self._built: dict[str, list[str]] = {}

    def map(self, name: str) -> str:
        """Return the folder of a map, built by the command once."""
        self.built(name)
        return f"maps/{name}"

    def built(self, name: str) -> list[str]:
        """Return what `odm build` said of a map."""
        if name not in self._built:
            words = ("build", f"{name}.toml", "--out", f"maps/{name}", "--threads", 2)
            self._built[name] = list(told_by(*words))
        return self._built[name]

    def loaded(self, name: str) -> odm.CellMap:
        """Return a map, loaded once."""
        if name not in self._loaded:
            self._loaded[name] = odm.load_map(self.map(name))
        return self._loaded[name]

    def reach(self) -> str:
        """Return the folder of the Kawasaki's reach map, built if it is not there."""
        if not Path("reach").exists():
            import handover

            robot = self.loaded("kawasaki").robot
            settings = handover.ReachSettings(
                cell=0.1, rotations=72, samples=60_000, seed=3
            )
            chain = handover.chain_of(robot)
            handover.build_reach_map(chain, settings, threads=2).save("reach")
        return "reach"


def command(*words: object) -> tuple[int, str, str]:
    """Run a command line as `odm` would; return exit code, output and errors."""
    said, complained, code = io.StringIO(), io.StringIO(), 0
    before, sys.argv = sys.argv, ["odm", *map(str, words)]
    with contextlib.suppress(ImportError):  # no signs of life: they follow the clock
        importlib.import_module("sim.terminal.progress").FIRST_S = math.inf
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
            runpy.run_module("sim", run_name="__main__")
    except SystemExit as stop:
        code = stop.code or 0
    finally:
        sys.argv = before
    return code, said.getvalue(), complained.getvalue()


def told_by(*words: object) -> Lines:
    """Yield what a command says with --json, without what a clock told."""
    words = tuple(map(str, words))
    code, said, complained = command(*words, "--json=-")
    at = " ".join(words[:2])
    yield f"{at}: exit code {code}"
    yield from _sentences(at, complained)
    if said.strip():
        for line in flat(json.loads(said), _CLOCK):
            yield f"{at}: {line}"


def _sentences(at: str, text: str, whole: bool = False) -> Lines:
    """Yield the errors that a command told, or all it said."""
    for line in text.splitlines():
        if line.startswith("odm:") or (whole and line.strip()):
            yield f"{at}: {' '.join(line.split())}"


def _masked(text: str) -> Lines:
    """Yield lines without numbers, borders and gaps, which follow the clock."""
    for line in text.splitlines():
        words = re.sub(r"[0-9][0-9.,]*", "#", re.sub(r"[^\x00-\x7f]+", " ", line))
        if words.strip():
            yield " ".join(words.split())


# --- words only -----------------------------------------------------------------------


def help_texts(shop: Shop) -> Lines:  # noqa: ARG001
    """Tell what every command says of itself; benches are no product."""
    for name in _HELP:
        code, said, complained = command(*name.split(), "--help")
        yield f"odm {name}: exit code {code}"
        for line in (said + complained).splitlines():
            if line.strip():
                yield f"odm {name}: {' '.join(line.split())}"


def refusals(shop: Shop) -> Lines:
    """Tell with which sentences bad input is refused."""
    arm = shop.map("arm")
    Path("bad.toml").write_text("[robot]\nsource = 'panda'\nnods = 3\n")
    Path("text.npz").write_text("no archive")
    for words in (
        "build bad.toml", "build nothing.toml", "build --robot none.urdf",
        "build arm.toml --nodes -3", "build arm.toml --out maps",
        "info nothing", "info .", f"audit {arm} --sabotage all", "audit nothing",
        f"run --map {arm} --motion none", f"run --map {arm} --motion mocap",
        f"run --map {arm} --targets nowhere", f"run --map {arm} --between 1 2",
        f"run --map {arm} --execution fast", f"run --map {arm} --carry 0.1",
        f"run --map {arm} --record run.txt", f"run --map {arm} --seconds -1",
        f"run --map {arm} --file text.npz", "replay text.npz", "replay none.npz",
        f"replay --frames text.npz --map {arm}", f"run-two --map {arm} --other none",
        f"camera text.npz --map {arm}", "human info --height 9",
        "human info --posture flying", "workspace build none",
        "workspace meet --robot none", "workspace human --rotations 5", "bench none",
    ):  # fmt: skip
        code, _, complained = command(*words.split())
        yield f"odm {words}: exit code {code}"
        yield from _sentences(f"odm {words}", complained, whole=code == 2)


def tables(shop: Shop) -> Lines:
    """Tell what commands print for people, numbers left out."""
    arm = shop.map("arm")
    np.savez("short.npz", **_short_clip(shop.loaded("arm")))
    _depth_png()
    for words in (
        f"info {arm}", f"audit {arm} --pairs 100 --threads 1", "human info",
        f"run --map {arm} --motion hover --seconds 1 --record short_run.npz",
        f"run --map {arm} --motion sweep --seconds 1 --execution timed",
        f"run-two --map {shop.map('gross')} --seconds 0.5",
        f"run --map {shop.map('kawasaki')} --targets meet --reach {shop.reach()} "
        "--motion reach --seconds 1",
        f"replay short_run.npz --map {arm}", "replay short_run.npz --holds",
        f"replay --frames short.npz --map {arm}",
        "build gross.toml --out once_more", f"workspace info {shop.reach()}",
        f"workspace meet --robot kawasaki_fs003n --reach {shop.reach()} --k 3",
        f"camera depth.png --map {arm}",
        "workspace human --spacing 0.1 --rotations 72",
    ):  # fmt: skip
        code, said, complained = command(*words.split())
        yield f"odm {words}: exit code {code}"
        for line in _masked(said):
            yield f"odm {words}: {line}"
        yield from _sentences(f"odm {words}", complained)


def pictures(shop: Shop) -> Lines:
    """Draw what shows no time; tell the bytes of the pixels."""
    from PIL import Image

    arm = shop.map("arm")
    _depth_png()
    for words in (
        "human info --posture sitting --plot",
        f"info {arm} --plot",
        "workspace human --spacing 0.1 --rotations 72 --plot",
        f"workspace meet --robot kawasaki_fs003n --reach {shop.reach()} --plot",
        f"workspace info {shop.reach()} --plot",
        f"camera depth.png --map {arm} --plot",
        f"run-two --map {shop.map('gross')} --seconds 1 --plot",
    ):
        code, _, complained = command(*words.split(), "picture.png")
        yield f"odm {words}: exit code {code}"
        yield from _sentences(f"odm {words}", complained)
        if Path("picture.png").exists():
            with Image.open("picture.png") as image:
                yield f"odm {words}: {digest(np.array(image))}"
            Path("picture.png").unlink()
    film = ("--motion", "sweep", "--seconds", 1, "--animation", "film.gif")
    code, _, complained = command("run", "--map", arm, *film)
    yield f"film: exit code {code}"
    yield from _sentences("film", complained)
    if Path("film.gif").exists():
        with Image.open("film.gif") as image:
            yield f"film: {image.n_frames} pictures, {image.size}"  # they tell times


def _short_clip(cell_map: odm.CellMap) -> dict[str, np.ndarray]:
    """Return 20 recorded obstacle frames."""
    rng, nodes = np.random.default_rng(800), cell_map.roadmap.nodes
    clip = np.array([c[:2] for c in scenes.clip(rng, 40) if len(c) >= 2][:20])
    ends = {"q_start": nodes[3], "q_goal": nodes[-5], "rate_hz": np.float64(50.0)}
    return {"capsules": clip, **ends}


# --- maps -----------------------------------------------------------------------------


def maps(shop: Shop) -> Lines:
    """Build every map by the command; tell all bytes of it."""
    for name in scenes.RECIPES:
        if name == scenes.LARGE:
            continue
        yield from shop.built(name)
        for file in sorted(Path(shop.map(name)).glob("*.npy")):
            code = hashlib.sha256(file.read_bytes()).hexdigest()[:16]
            yield f"{name}: {file.name} {code}"
        yield f"{name}: {shop.loaded(name).hash}"
    for name in ("arm", "carry"):
        yield from told_by("info", shop.map(name))
    again = odm.build_map("arm.toml", threads=1).save("again")
    yield f"one thread: {odm.load_map(again).hash}"
    yield from told_by("build", "gross.toml", "--suggest")


def audits(shop: Shop) -> Lines:
    """Try to falsify maps; with sabotage it must be found."""
    arm, carry = shop.map("arm"), shop.map("carry")
    for words in (
        f"audit {arm} --pairs 1500 --seed 3 --threads 2",
        f"audit {arm} --pairs 400 --seed 4 --close --threads 1",
        f"audit {carry} --pairs 600 --payload --threads 1",
        f"audit {arm} --pairs 1500 --sabotage sphere --threads 1",
        f"audit {arm} --sequences 500 --seed 2 --threads 1",
    ):
        yield from told_by(*words.split())


# --- runs -----------------------------------------------------------------------------


def _run(shop: Shop, name: str, seconds: float, *words: object) -> Lines:
    """Run a motion, tell its figures and every frame of its recording."""
    file = shop.folder / "run.npz"
    file.unlink(missing_ok=True)
    asked = ("--seconds", seconds, "--record", file, *words)
    for line in told_by("run", "--map", shop.map(name), *asked):
        yield f"{name} {' '.join(map(str, words))}: {line}"
    if not file.exists():
        return
    yield from _recording(f"{name} {' '.join(map(str, words))}", file)


def _recording(name: str, file: Path) -> Lines:
    """Tell a recording: its head but for versions, and all arrays, frame by frame."""
    with np.load(file) as stored:
        head = json.loads(bytes(stored["recording.json"]))
        names = [key for key in stored.files if key != "recording.json"]
        arrays = {key: stored[key] for key in names}
    for line in flat(head, _CLOCK):
        yield f"{name}: {line}"
    n = head["frames"]
    whole = {k: a for k, a in arrays.items() if not k.startswith("robot.")}
    rows = {k: a for k, a in whole.items() if len(a) == n}
    for key in sorted(arrays.keys() - rows.keys()):
        yield f"{name}: {key} {digest(arrays[key])}"
    for i in range(n):
        values = ", ".join(f"{k} {digest(a[i])}" for k, a in sorted(rows.items()))
        yield f"{name}, frame {i}: {values}"


def runs(shop: Shop) -> Lines:
    """Run the scripted motions with a robot that moves at once."""
    for k, motion in enumerate(_PLAIN):
        yield from _run(shop, "arm", 3.0, "--motion", motion, "--seed", k)
    yield from _run(shop, "rail", 3.0, "--motion", "reach", "--seed", 2)


def scenes_played(shop: Shop) -> Lines:
    """Run the scenes in which a robot holds, backs off and escapes, both ways."""
    for motion in _STAGED:
        for execution in ("kinematic", "timed"):
            words = ("--motion", motion, "--execution", execution)
            yield from _run(shop, "arm", 6.0, *words)


def timed(shop: Shop) -> Lines:
    """Run motions with a robot of limited acceleration that brakes for the person."""
    for k, motion in enumerate(("sweep", "reach", "hover", "intrusion", "tremble")):
        words = ("--motion", motion, "--seed", k + 3, "--execution", "timed")
        yield from _run(shop, "arm", 5.0, *words)
    yield from _run(shop, "rail", 5.0, "--motion", "sweep", "--execution", "timed")


def replays(shop: Shop) -> Lines:
    """Record a run and replay it; make its recipe again and tell its holds."""
    arm = shop.map("arm")
    asked = ("run", "--map", arm, "--motion", "reach", "--seconds", 3, "--seed", 4)
    yield from told_by(*asked, "--execution", "timed", "--record", "first.npz")
    yield from told_by("replay", "first.npz", "--map", arm, "--record", "again.npz")
    same = Path("first.npz").read_bytes() == Path("again.npz").read_bytes()
    yield f"the same bytes: {same}"
    code, said, complained = command("replay", "first.npz", "--holds")
    yield f"holds: {code} {said} {complained}"
    code, *_ = command("replay", "first.npz", "--recipe-out", "recipe.toml")
    yield f"recipe: {code} {Path('recipe.toml').read_text()}"
    code, said, complained = command("replay", "first.npz", "--build", "rebuilt")
    yield f"build: {code} {said}"
    yield from _sentences("build", complained)
    yield f"rebuilt: {odm.load_map('rebuilt').hash}"
    yield from told_by("replay", "first.npz", "--map", shop.map("rail"))


def obstacle_frames(shop: Shop) -> Lines:
    """Play obstacle frames, capsules and points, by the command."""
    for k, name in enumerate(("arm", "rail")):
        rng = np.random.default_rng(700 + k)
        nodes = shop.loaded(name).roadmap.nodes
        ends = {"q_start": nodes[3], "q_goal": nodes[-5], "rate_hz": np.float64(50.0)}
        clip = [c[:2] for c in scenes.clip(rng, 150) if len(c) >= 2]
        np.savez("capsules.npz", capsules=np.array(clip), **ends)
        points = [scenes.points_of(c) for c in clip]
        offsets = np.r_[0, np.cumsum([len(p) for p in points])]
        np.savez("points.npz", points=np.vstack(points), offsets=offsets, **ends)
        for file in ("capsules.npz", "points.npz"):
            for more in ((), ("--always-replan",)):
                words = ("--frames", file, "--map", shop.map(name), "--paths", *more)
                yield from told_by("replay", *words)


def pushed(shop: Shop) -> Lines:
    """Push the robot meanwhile, as `odm bench motions --pushed` does."""
    words = ("--pushed", "--seconds", 6, "--seeds", 1, "--processes", 1)
    words += ("--motion", "sweep", "--motion", "reach", "--execution")
    for execution in ("kinematic", "timed"):
        asked = ("bench", "motions", "--map", shop.map("arm"), *words, execution)
        yield from told_by(*asked)


def carried(shop: Shop) -> Lines:
    """Run with a ball in the hand."""
    for execution in ("kinematic", "timed"):
        words = ("--motion", "sweep", "--carry", 0.08, "--execution", execution)
        yield from _run(shop, "carry", 3.0, *words)
    yield from told_by("replay", "run.npz", "--map", shop.map("carry"))


def recorded(shop: Shop) -> Lines:
    """Run beside a person of a .bvh and a .csv file made up here."""
    Path("clip.bvh").write_text(_bvh(300))
    Path("clip.csv").write_text(_csv(200))
    words = ("--motion", "mocap", "--file")
    for execution in ("kinematic", "timed"):
        asked = ("--execution", execution)
        yield from _run(shop, "arm", 3.0, *words, "clip.bvh", *asked)
    yield from _run(shop, "arm", 2.0, *words, "clip.csv")
    names = "\n".join(f'{joint} = "{name}"' for joint, name in _NAMES.items())
    Path("names.toml").write_text(f"{names}\n")
    asked = ("--mapping", "names.toml", "--stand", 0.8, 0.2, 200)
    yield from _run(shop, "arm", 1.0, *words, "clip.bvh", *asked)


def targets(shop: Shop) -> Lines:
    """Let the robot go where the person can best take what it holds."""
    robot = shop.map("kawasaki")
    words = ("run", "--map", robot, "--targets", "meet", "--reach", shop.reach())
    for k, (motion, thing) in enumerate((("reach", "wrench"), ("sweep", "mallet"))):
        asked = ("--motion", motion, "--object", thing, "--seed", k, "--rate", 50)
        for line in told_by(*words, *asked, "--seconds", 4, "--between", 0.7, 1.0):
            yield f"{motion}: {line}"
    asked = ("--motion", "reach", "--seconds", 3, "--execution", "timed", "--rate", 50)
    yield from told_by(*words, *asked)
    Path("clip.bvh").write_text(_bvh(100))
    asked = ("--motion", "mocap", "--file", "clip.bvh", "--side", "left", "--rate", 50)
    yield from told_by(*words, *asked)


def two(shop: Shop) -> Lines:
    """Let two robots share a space, the second planned or scripted."""
    for other in ("planned", "scripted"):
        words = ("--map", shop.map("gross"), "--seconds", 5, "--other", other)
        for line in told_by("run-two", *words):
            yield f"{other}: {line}"


def _depth_png() -> None:
    from PIL import Image

    lens = (320, 240, 240.0, 240.0, 159.5, 119.5)
    T = scenes.look_at([0.0, -0.45, 0.75], [0.65, 0.0, 0.5])
    balls = np.array([[0.5, 0.0, 0.5, 0.1], [0.6, 0.3, 0.3, 0.07]])
    image = scenes.depth_image(T, lens, balls, 1.8)
    Image.fromarray(image).save("depth.png")


def camera(shop: Shop) -> Lines:
    """Tell which cells of a map depth images show."""
    _depth_png()
    words = ("--map", shop.map("arm"), "--fx", 240, "--cx", 159.5, "--cy", 119.5)
    for more in (
        (), ("--d-self", 0.01, "--flying", 0.05), ("--no-shadow",),
        ("--policy", "occupied", "--q", "0.1,0.2,0,-1.5,0,1.5,0"),
        ("--q", "10,20,0,-90,0,90,0"), ("--q", "1,2"), ("--scale", 0.1),
    ):  # fmt: skip
        yield from told_by("camera", "depth.png", *words, "--scale", 0.001, *more)


def person(shop: Shop) -> Lines:  # noqa: ARG001
    """Tell what `odm human info` and `odm workspace human` say."""
    for words in (("--height", 1.6), ("--posture", "sitting", "--thickness", "mean")):
        yield from told_by("human", "info", *words)
    for side in ("right", "left"):
        words = ("--side", side, "--spacing", 0.1, "--rotations", 72)
        yield from told_by("workspace", "human", *words)


def workspace(shop: Shop) -> Lines:
    """Build reach maps by the command, and tell where to meet."""
    quick = ("--cell", 0.15, "--rotations", 72, "--samples", 20_000, "--recall", 200)
    for robot in ("kawasaki_fs003n", "human"):
        where = Path("reaches", robot)
        yield from told_by("workspace", "build", robot, "--out", where, *quick)
        yield from told_by("workspace", "info", where, "--recall", 100)
    words = ("--robot", "kawasaki_fs003n", "--reach", shop.reach(), "--distance", 0.8)
    yield from told_by("workspace", "meet", *words, "--human-reach", "reaches/human")
    yield from told_by("workspace", "meet", *words, "--posture", "sitting", "--k", 4)


# --- a person made up -----------------------------------------------------------------

_JOINTS = {  # parent, and where it stands: x to the right, y up, z back [cm]
    "hip": (None, (0.0, 95.0, 0.0)),
    "neck": ("hip", (0.0, 145.0, 0.0)),
    "head": ("neck", (0.0, 155.0, -3.0)),
    "lShldr": ("neck", (-19.0, 142.0, 0.0)),
    "lForeArm": ("lShldr", (-22.0, 113.0, 0.0)),
    "lHand": ("lForeArm", (-22.0, 88.0, -5.0)),
    "rShldr": ("neck", (19.0, 142.0, 0.0)),
    "rForeArm": ("rShldr", (22.0, 115.0, -10.0)),
    "rHand": ("rForeArm", (10.0, 115.0, -35.0)),
}


def _bvh(frames: int) -> str:
    """Return a .bvh in which the right hand swings; each joint has its position."""
    lines, order = ["HIERARCHY"], []

    def add(name: str) -> None:
        parent, place = _JOINTS[name]
        order.append(name)
        offset = np.subtract(place, _JOINTS[parent][1] if parent else 0.0)
        lines.append(f"{'JOINT' if parent else 'ROOT'} {name}\n{{")
        lines.append("OFFSET " + " ".join(f"{v:.4f}" for v in offset))
        lines.append("CHANNELS 3 Xposition Yposition Zposition")
        children = [k for k, (p, _) in _JOINTS.items() if p == name]
        for child in children:
            add(child)
        lines.append("}" if children else "End Site\n{\nOFFSET 0 0 0\n}\n}")

    add("hip")
    lines += ["MOTION", f"Frames: {frames}", "Frame Time: 0.01"]
    for k in range(frames):
        swing = 25.0 * np.sin(2 * np.pi * 0.5 * 0.01 * k)
        row = []
        for name in order:
            parent, place = _JOINTS[name]
            offset = np.subtract(place, _JOINTS[parent][1] if parent else 0.0)
            row += (offset - [0, 0, swing if name == "rHand" else 0]).tolist()
        lines.append(" ".join(f"{v:.6f}" for v in row))
    return "\n".join(lines) + "\n"


_NAMES = dict(zip(
    ("hip", "neck", "head", "left_shoulder", "left_elbow", "left_hand",
     "right_shoulder", "right_elbow", "right_hand"), _JOINTS, strict=True,
))  # fmt: skip


def _csv(frames: int) -> str:
    """Return Vicon tracks of the same person, in millimetres."""
    tracks = {"collar" if j == "neck" else j: _JOINTS[n][1] for j, n in _NAMES.items()}
    heads = ",".join(f"Global Angle {name}:{name},,,,," for name in tracks)
    axes = ",".join("RX,RY,RZ,TX,TY,TZ" for _ in tracks)
    units = ",".join("rad,rad,rad,mm,mm,mm" for _ in tracks)
    lines = ["Objects", "100", f",,{heads},", f"Frame,Sub Frame,{axes}", f",,{units}"]
    for k in range(frames):
        swing = 25.0 * np.sin(2 * np.pi * 0.5 * 0.01 * k)
        row = [k + 1, 0]
        for name, (x, y, z) in tracks.items():
            ahead = -z + (swing if name == "right_hand" else 0.0)
            row += [0, 0, 0, 10.0 * x, round(10.0 * ahead, 6), 10.0 * y - 900.0]
        lines.append(",".join(map(str, row)))
    return "\n".join(lines) + "\n"


ITEMS = {
    "help": help_texts,
    "refusals": refusals,
    "tables": tables,
    "pictures": pictures,
    "maps": maps,
    "audits": audits,
    "runs": runs,
    "scenes": scenes_played,
    "timed": timed,
    "replays": replays,
    "obstacle frames": obstacle_frames,
    "pushed": pushed,
    "carried": carried,
    "recorded": recorded,
    "targets": targets,
    "two": two,
    "camera": camera,
    "person": person,
    "workspace": workspace,
}
