"""`odm bench peers`: us and the peers on the same robot, pairs and frames, in one run.

Everyone gets the same starts, goals and obstacles, one after the other in one thread:
sweep, reach, jitter, hover, a fast intrusion, two arms at once, and furniture; then the
motions again as a camera's cloud of 20 000 points. Latency is wall time from the
obstacles' numbers to a path; building each library's world counts. Every path that
comes back is looked at again by exact geometry, densely. A frame is *solved* where a
path came; nobody else keeps a clearance, so their paths may be shorter.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from odm import load_map
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from roadmap.kinematics.forward import motion_per_joint
from sim.bench.core.frame_rows import CHANGED, difference_of
from sim.bench.rivals.ompl import OmplMissing, length
from sim.bench.rivals.peer_cases import ALL, CLUTTER, Case, Frame, make_cases
from sim.bench.rivals.peer_planners import (
    OUR_MODES,
    BruteForce,
    Ompl,
    Ours,
    Peer,
    StopOnly,
)
from sim.bench.rivals.peer_vamp import Vamp, VampMissing
from sim.tables.header import header
from sim.tables.table import us_text, value_row

STEP = 0.002  # [m] what the judge may be wrong by
FAR = 0.1  # [m] clearance beyond which nobody asks
BESIDE = 1e-7  # [rad or m] to a configuration that tells whether a contact is one
FASTER = 1000.0  # than OMPL with python-fcl, p50
CLOUD = "camera cloud"
_HEAD = ("who", "n", "p50", "p99", "max", "solved", "rad", "changed", "hit", "cm")
_COLUMNS = (
    "n frames; obstacles to path; frames with a path; length p50; frames whose path "
    f"differs by more than {CHANGED:g} rad from the frame before; paths in exact "
    "contact; smallest exact clearance, 10 and more as 10"
)


def run(
    map_dir: str | Path,
    *,
    seed: int = 1,
    quick: bool = False,
    short: bool = False,
    plot: str | Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Ask everyone, and judge every path.

    Args:
        map_dir: Folder of a built map.
        seed: Of starts, goals and frames.
        quick: Fewer frames: within 5 minutes.
        short: A handful: to see that it runs.
        plot: PNG of latencies and validity.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables" and "peers".
    """
    tell = tell or (lambda text: None)
    cell_map = load_map(map_dir, verify=False)
    pairs, frames, each, scenes = (4, 100, 12, 60)
    if quick:
        pairs, frames, each, scenes = (1, 60, 5, 10)
    if short:
        pairs, frames, each, scenes = (1, 6, 1, 1)
    tell("pairs and scenes")
    cases = list(make_cases(cell_map, pairs, frames, each, scenes, seed))
    peers, missing = _peers(cell_map, seed)
    judge = Judge(cell_map)
    found = _all_asked(peers, cases, judge, seed, (quick, short), tell)
    result = {
        "bench": "peers",
        "header": header(cell_map),
        "setup": _setup(seed, pairs, frames, scenes, cell_map, peers, missing),
        "rows": _rows(found, judge),
        "tables": _tables(found, missing),
        "peers": [_plain(one) for one in found],
    }
    if plot is not None:
        from sim.bench.rivals.peer_plot import write_plot

        result["plot"] = str(write_plot(result, plot))
    return result


def _all_asked(
    peers: list[Peer],
    cases: list[Case],
    judge: "Judge",
    seed: int,
    few: tuple[bool, bool],
    tell: Callable[[str], None],
) -> list["Asked"]:
    """Ask everyone all they can be asked, by shapes, then by clouds."""
    rng, found = np.random.default_rng(seed), []
    clouds = [c.with_clouds(rng) for c in cases if c.kind != CLUTTER]
    for peer in peers:
        if peer.cost < 0.1:  # so that nobody's first call is counted
            for case in (cases[-1], clouds[0]):
                peer.begin(case)
                peer.path(case.frames[0])
        for world, asked in (("shapes", cases), (CLOUD, clouds)):
            some = _affordable(peer, asked, world, *few)
            tell(f"{peer.name}, {world}: {sum(len(c.picked) for c in some)} frames")
            found += _asked(peer, some, judge, world)
    return found


def _peers(cell_map: CellMap, seed: int) -> tuple[list[Peer], dict[str, str]]:
    """Return who can be asked, and who is not there and why."""
    peers: list[Peer] = [Ours(cell_map, mode) for mode in OUR_MODES]
    missing = {}
    for simplified in (True, False):
        try:
            peers.append(Vamp(cell_map.recipe.robot.source, simplified))
        except VampMissing as error:
            how = "simplified" if simplified else "raw"
            missing[f"VAMP {how}"] = str(error)
    for planner in ("RRT-Connect", "PRM"):
        try:
            peers.append(Ompl(cell_map, seed, planner))
        except OmplMissing:
            missing[f"OMPL {planner}"] = "not installed"
    return [*peers, BruteForce(cell_map), StopOnly(cell_map)], missing


def _affordable(
    peer: Peer, cases: list[Case], world: str, quick: bool, short: bool
) -> list[Case]:
    """Return the cases that a peer is asked: all, or fewer of the slow ones."""
    few = quick or short
    if peer.cost > 1.0:
        some = [c for c in cases if c.kind != CLUTTER]
        if few:
            return [_first_frames(c, 1) for c in some[:1] if world != CLOUD]
        return [_first_frames(c, 1) for c in some[:6]]
    if peer.cost > 0.1:
        return [_first_frames(c, 2 if few else 12) for c in cases]
    if world == CLOUD and isinstance(peer, StopOnly):
        return [_first_frames(c, 2 if few else 12) for c in cases]
    return cases


def _first_frames(case: Case, n: int) -> Case:
    return Case(case.kind, case.q_start, case.q_goal, case.frames, case.picked[:n])


class Asked:
    """What came of one peer in one kind of case."""

    def __init__(self, name: str, kind: str, world: str) -> None:
        """Begin with nothing."""
        self.name, self.kind, self.world = name, kind, world
        self.asked: list[tuple[int, int]] = []  # which case, which frame
        self.wall: list[float] = []
        self.cpu: list[float] = []
        self.solved: list[bool] = []
        self.lengths: list[float] = []
        self.changed: list[bool] = []
        self.touching, self.nearest = 0, np.inf


def _asked(peer: Peer, cases: list[Case], judge: "Judge", world: str) -> list[Asked]:
    kinds: dict[str, Asked] = {}
    for number, case in enumerate(cases):
        one = kinds.setdefault(case.kind, Asked(peer.name, case.kind, world))
        peer.begin(case)
        last: tuple[int, np.ndarray] | None = None
        frames = range(max(case.picked) + 1) if peer.cost < 0.1 else case.picked
        for k in frames:
            frame = case.frames[k]
            busy, begun = time.thread_time(), time.perf_counter()
            path = peer.path(frame)
            wall, cpu = time.perf_counter() - begun, time.thread_time() - busy
            peer.after()
            if k in case.picked:
                one.asked.append((number, k))
                one.wall.append(1e6 * wall)
                one.cpu.append(1e6 * cpu)
                one.solved.append(path is not None)
                if path is not None:
                    one.lengths.append(length(path))
                    touches, nearest = judge.look(path, frame)
                    one.touching += touches
                    one.nearest = min(one.nearest, nearest)
                if path is not None and last is not None and last[0] == k - 1:
                    one.changed.append(difference_of(last[1], path) > CHANGED)
            last = None if path is None else (k, path)
    return list(kinds.values())


class Judge:
    """Looks at paths again: contact by python-fcl, distance by exact geometry."""

    def __init__(self, cell_map: CellMap) -> None:
        """Make the exact solids."""
        robot, arm = cell_map.robot, cell_map.arm
        self.fcl, self.exact = FclRobot(robot), ExactRobot(robot)
        reach = arm.reach + arm.spheres[:, 3:]
        self.motion = motion_per_joint(arm.tree_i, arm.tree_f, reach, robot.dof)
        self.checks = 0

    def look(self, path: np.ndarray, frame: Frame) -> tuple[bool, float]:
        """Return whether a path (k, dof) is in contact, and its smallest distance.

        The exact distance says how far the robot may go until it can be nearer than
        at the nearest place so far; there it is looked at again, STEP later at the
        latest. So what is told is too large by STEP at most, and no contact deeper
        than STEP is passed over. What is farther than FAR counts as FAR.
        """
        solids = frame.solids()
        self.fcl.set_obstacles(solids)
        obstacles, touches, nearest = obstacles_of(solids), False, FAR
        for a, b in zip(path[:-1], path[1:], strict=True):
            moved, t = float(np.abs(b - a) @ self.motion), 0.0
            while True:
                q = a + (b - a) * t
                self.checks += 1
                near = self._distance(q, obstacles)
                touches |= near <= 0.0 or (near < 0.01 and self.fcl.collides(q))
                nearest = min(nearest, near)
                if t >= 1.0:
                    break
                t = min(1.0, t + (near - nearest + STEP) / max(moved, 1e-9))
        return touches, 0.0 if touches else nearest

    def _distance(self, q: np.ndarray, obstacles: list) -> float:
        """Return the exact distance at q.

        Where it is told as contact and python-fcl sees none, it is asked for beside
        q, too: it cannot be less at q by more than the robot moves on the way. The
        distance of two solids failed at single configurations, one in a million,
        until flat tetrahedra were told apart; a second opinion costs nothing here.
        """
        near = self.exact.distance(q, obstacles, cap=3 * FAR).distance
        if near <= 0.0 and not self.fcl.collides(q):
            beside = self.exact.distance(q + BESIDE, obstacles, cap=3 * FAR).distance
            near = max(near, beside - BESIDE * float(self.motion.sum()))
        return near


def _joined(found: list[Asked], name: str, world: str) -> Asked:
    whole = Asked(name, "all", world)
    for one in found:
        if one.name == name and one.world == world:
            for part in ("asked", "wall", "cpu", "solved", "lengths", "changed"):
                getattr(whole, part).extend(getattr(one, part))
            whole.touching += one.touching
            whole.nearest = min(whole.nearest, one.nearest)
    return whole


def _tables(found: list[Asked], missing: dict[str, str]) -> list[dict]:
    tables = []
    names = list(dict.fromkeys(one.name for one in found))
    for world in ("shapes", CLOUD):
        rows = [_row(_joined(found, name, world)) for name in names]
        rows += [(name, why, *[""] * 8) for name, why in missing.items()]
        title = f"all motions{' and clutter' if world == 'shapes' else ''}, {world}"
        tables.append({"title": title, "head": _HEAD, "rows": rows})
    for kind in (*ALL, CLUTTER):
        rows = [_row(o) for o in found if o.kind == kind and o.world == "shapes"]
        tables.append({"title": f"{kind}, shapes", "head": _HEAD, "rows": rows})
    return tables


def _row(one: Asked) -> tuple[str, ...]:
    if not one.wall:
        return one.name, "0", *[""] * 8
    wall = [us_text(np.percentile(one.wall, p)) for p in (50, 99, 100)]
    share = f"{100 * np.mean(one.solved):.0f} %"
    some = f"{np.median(one.lengths):.2f}" if one.lengths else "-"
    turns = f"{100 * np.mean(one.changed):.0f} %" if one.changed else "-"
    near = f"{100 * min(one.nearest, FAR):.2f}" if one.lengths else "-"
    contact = f"{one.touching}/{len(one.lengths)}"
    return one.name, str(len(one.wall)), *wall, share, some, turns, contact, near


def _rows(found: list[Asked], judge: Judge) -> list[dict]:
    """Return the rows that are asked for."""
    ours = [one for one in found if one.name.startswith("odm")]
    rows = [
        value_row("configurations checked by exact geometry", judge.checks, ""),
        value_row("our paths in exact collision", sum(o.touching for o in ours), "",
                  most=0),
    ]  # fmt: skip
    first = f"odm, {OUR_MODES[0]}"
    theirs = "OMPL RRT-Connect"
    for world in ("shapes", CLOUD):
        mine, other = (_joined(found, name, world) for name in (first, theirs))
        if mine.cpu and other.cpu:
            note = "CPU time of odm, replanned, and of OMPL, in frames both have a path"
            both = _solved_by(mine) & _solved_by(other)
            ratio = np.nan
            if both:
                ratio = _median_in(other, both) / _median_in(mine, both)
            name = f"times faster than OMPL RRT-Connect with python-fcl, p50, {world}"
            least = {"least": FASTER} if world == "shapes" else {}
            rows.append(value_row(name, ratio, "", note, **least))
    return rows


def _solved_by(one: Asked) -> set[tuple[int, int]]:
    """Return the frames in which there was a path, by case and number."""
    return {at for at, got in zip(one.asked, one.solved, strict=True) if got}


def _median_in(one: Asked, frames: set[tuple[int, int]]) -> float:
    times = [t for at, t in zip(one.asked, one.cpu, strict=True) if at in frames]
    return float(np.median(times))


def _setup(seed, pairs, frames, scenes, cell_map, peers, missing) -> dict:  # noqa: ANN001
    setup = {
        "seed": seed,
        "starts and goals": f"{pairs} for each of {', '.join(ALL)}; {frames} frames "
        f"at 100 Hz; {scenes} cluttered scenes",
        "clearance of ours": f"{100 * cell_map.safety.m:g} cm; the peers keep none",
        "columns": _COLUMNS,
        "judge": f"exact distance along the whole path, to {1e3 * STEP:g} mm",
        "one thread": "everyone, one after the other; slow ones get fewer frames",
    }
    setup |= {peer.name: peer.setting for peer in peers}
    return setup | missing


def _plain(one: Asked) -> dict:
    return {
        "name": one.name,
        "kind": one.kind,
        "world": one.world,
        "wall_us": [round(x, 1) for x in one.wall],
        "cpu_us": [round(x, 1) for x in one.cpu],
        "solved": [bool(x) for x in one.solved],
        "lengths": [round(x, 4) for x in one.lengths],
        "changed": [bool(x) for x in one.changed],
        "in_contact": int(one.touching),
        "smallest_clearance_m": None if one.nearest == np.inf else float(one.nearest),
    }
