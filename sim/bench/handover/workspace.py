"""`odm bench workspace`: the interaction workspace, the paper's Table I beside ours.

ARMAR-III's left arm with hip holds a wrench before a standing person of 1.75 m, whose
left arm takes it. Distances are from the platform's front to the middle of the
person's pelvis; the platform's frame is half its depth, 0.33 m, behind its front.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from handover import (
    Human,
    InteractionWorkspace,
    MeetSettings,
    ReachMap,
    load_reach_map,
    wrench,
)
from roadmap.errors import BadInput
from sim.bench.clock import Clock
from sim.bench.handover.workspace_cases import equal_cases
from sim.tables.header import header
from sim.tables.table import value_row

# [Vahrenkamp2016, Table I]: distance [m] -> potential targets
TABLE_I = {0.7: 3576, 0.9: 2290, 1.1: 1110, 1.3: 373, 1.5: 78}
FRONT = 0.33  # [m] from the platform's frame to its front
NEAR = 0.7  # [m] where times are measured
STEP = 0.02  # [m] that the person moves
PAPER = (0.15, 72, 4)
CURVES = (PAPER, (0.15, 72, 8), (0.10, 72, 4), (0.10, 576, 4))
# grid and grasps -> asked [us]: after 2 cm p50, p99; cold p50; all else p99
TIMES = {(0.15, 72, 8): (1e3, 3e3, 2e3, 5e3), (0.10, 576, 8): (8e3, 25e3, None, None)}


def run(
    map_dir: str | Path,
    *,
    seed: int = 0,
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure the interaction workspace of ARMAR-III and a person.

    Args:
        map_dir: Folder of ARMAR-III's reach map.
        seed: Of the person's steps and of the random cases.
        short: Few cases: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup", "rows" and "tables".

    Raises:
        BadMap: No reach map.
        BadInput: A reach map of another robot, or one too coarse.
    """
    tell = tell or (lambda text: None)
    reach = _paper_reach(map_dir)
    tell("Table I")
    counts = {c: _counts(reach, *c) for c in CURVES if _fits(reach, *c[:2])}
    rows = [_count_row(d, counts[PAPER][d]) for d in TABLE_I]
    tell("full build")
    rows += _build_rows(reach, 3 if short else 20)
    for grid in TIMES:
        if _fits(reach, *grid[:2]):
            tell(f"times at {_name(*grid)}")
            rows += _time_rows(reach, grid, 10 if short else 300, seed)
    tell("random cases")
    cases = 20 if short else 1000
    wrong = equal_cases(reach, cases, seed, tell)
    name = "best-first top 10 that differ from the full grid's"
    note = f"of {cases} random cases: person, posture, gaze, arms, grasps, removed"
    rows.append(value_row(name, wrong, "", note, most=0))
    setup = {
        "reach map": f"{reach.hash[:12]}, {reach.grid.cell:g} m / "
        f"{reach.grid.rotations.n_cells}, {reach.n_marked} cells",
        "target": "a cell any part of which the robot reaches, with a grasp that the "
        "person's IK solves at its centre",
        "seed": seed,
    }
    setup |= {"times": "at 70 cm, CPU time of the thread beside; update and best(10)"}
    result = {"bench": "workspace", "header": header(), "setup": setup, "rows": rows}
    return result | {"tables": [_curves(counts)]}


def _paper_reach(map_dir: str | Path) -> ReachMap:
    """Return ARMAR-III's reach map; refuse another one."""
    reach = load_reach_map(map_dir)
    if reach.chain.name != "armar3":
        raise BadInput(
            f"{map_dir} is a reach map of {reach.chain.name}; this bench is of the "
            "paper's robot: `odm workspace build armar3`"
        )
    if not _fits(reach, *PAPER[:2]):
        raise BadInput(
            f"the cells of {map_dir} are larger than 0.15 m; build a finer map"
        )
    return reach


def workspace(
    reach: ReachMap, human: Human, cell: float, rotations: int, grasps: int
) -> InteractionWorkspace:
    """Return the workspace of Table I on a grid."""
    settings = MeetSettings(side="left", cell=cell, rotations=rotations)
    return InteractionWorkspace(reach, human, wrench(), grasps, settings)


def person_at(distance: float) -> Human:
    """Return the mean person, facing the robot, before the platform's front [m]."""
    return Human(1.75).placed(FRONT + distance, 0.0, np.pi)


def _fits(reach: ReachMap, cell: float, rotations: int) -> bool:
    fine = reach.grid
    return cell >= fine.cell - 1e-9 and rotations <= fine.rotations.n_cells


def _name(cell: float, rotations: int, grasps: int) -> str:
    return f"{100 * cell:.0f} cm / {rotations}, {grasps} grasps"


def _counts(
    reach: ReachMap, cell: float, rotations: int, grasps: int
) -> dict[float, int]:
    meet = workspace(reach, person_at(NEAR), cell, rotations, grasps)
    counts = {}
    for distance in TABLE_I:
        meet.update(person_at(distance))
        counts[distance] = len(meet)
    return counts


def _count_row(distance: float, count: int) -> dict:
    paper = TABLE_I[distance]
    off = f"the paper's {paper}, ours {100 * (count / paper - 1):+.0f} %"
    name = f"Table I, {100 * distance:.0f} cm: targets"
    return value_row(name, count, "", off, least=0.75 * paper, most=1.25 * paper)


def _curves(counts: dict[tuple, dict[float, int]]) -> dict:
    rows = [
        [f"{100 * d:.0f} cm", str(TABLE_I[d]), *(str(c[d]) for c in counts.values())]
        for d in TABLE_I
    ]
    head = ["distance", "paper", *(_name(*grid) for grid in counts)]
    return {"title": "Targets by distance from the front", "head": head, "rows": rows}


def _build_rows(reach: ReachMap, n: int) -> list[dict]:
    """Return what the full grid of Table I costs."""
    clock = Clock()
    meet = workspace(reach, person_at(NEAR), *PAPER)
    meet.build()
    for _ in range(n):
        meet.update(person_at(NEAR))
        clock(meet.build)
    ms = 1e-6 * float(np.median(clock.cpu))
    count = len(meet)
    note = f"{count} targets, CPU time, median of {n}; the paper 2.87 s at 3576"
    return [
        value_row("full build, one core", ms, "ms", note, most=20),
        value_row("full build, a target", 1e3 * ms / count, "us", note, most=6),
    ]


def _time_rows(reach: ReachMap, grid: tuple, n: int, seed: int) -> list[dict]:
    """Return what the first and the following top 10 cost."""
    p50, p99, cold, change = TIMES[grid]
    rng, name = np.random.default_rng(seed), _name(*grid)
    human = person_at(NEAR)
    meet = workspace(reach, human, *grid)
    meet.best(10)
    jobs = {
        "moved 2 cm": (lambda h: _stepped(h, rng), {"p50": p50, "p99": p99}),
        "turned": (lambda h: _turned(h, rng), {"p99": change}),
        "new gaze": (lambda h: h.looking(rng.normal(size=3)), {"p99": change}),
        "new arm posture": (lambda h: _other_arm(h, rng), {"p99": change}),
    }
    clock = Clock()
    for _ in range(n):
        meet.update(_stepped(human, rng))
        meet.forget()
        clock(meet.best, 10)
    rows = [clock.row(f"{name}: cold top 10", **_asked({"p50": cold}))]
    for what, (change_of, asked) in jobs.items():
        clock, now = Clock(), human
        for _ in range(n):
            now = change_of(now)
            clock(_answer, meet, now)
        rows.append(clock.row(f"{name}: {what}", **_asked(asked)))
    return rows


def _asked(limits: dict[str, float | None]) -> dict[str, float]:
    return {k: v for k, v in limits.items() if v is not None}


def _answer(meet: InteractionWorkspace, human: Human) -> None:
    meet.update(human)
    meet.best(10)


def _stepped(human: Human, rng: np.random.Generator) -> Human:
    """Return the person 2 cm away, drawn back to where times are measured."""
    home = person_at(NEAR).T_world_pelvis[:3, 3]
    T = human.T_world_pelvis.copy()
    way = rng.normal(size=3) + 20.0 * (home - T[:3, 3])
    T[:3, 3] += STEP * way / np.linalg.norm(way)
    return human.moved(T)


def _turned(human: Human, rng: np.random.Generator) -> Human:
    x, y, _ = human.T_world_pelvis[:3, 3]
    return human.placed(x, y, np.pi + rng.normal(0.0, 0.2))


def _other_arm(human: Human, rng: np.random.Generator) -> Human:
    arm = human.arm("left")
    return human.with_arm("left", rng.uniform(arm.lower, arm.upper))
