"""`odm bench handover`: the tables of [Huaman2014] beside ours, every motion checked.

For each scene of the paper and each seed: a plan with all motions, timed as a whole; H
made whole (`whole_choice.py`), to count it and to compare the chosen tuple's dexterity
with the best of H whose motions were not looked for in vain; all motions checked by
`check.py`, which shares no code with the planner. A draw without a plan is planned
again without a time limit and without motions: where no tuple exists after every grasp,
voxel and rotation of the grids was tried, the draw is unsolvable and listed; else it is
a failure. Ctrl-C ends the runs; what was done is told. With `--out DIR` draws are kept
there, so that runs go on where they ended.
"""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from handover import load_object, load_scene
from handover.grasps.hands import hand_spec
from handover.plans.plan_record import record_of
from handover.plans.planner import HandoverPlan, plan_handover
from handover.plans.settings import PlanSettings
from handover.scenes.scene import Scene
from roadmap.errors import BadInput
from sim.bench.handover.check import check_plan
from sim.bench.handover.whole_choice import (
    Whole,
    best_of,
    key_of,
    pair_of,
    whole_choice,
)
from sim.tables.header import header
from sim.tables.table import value_row
from sim.terminal.output import write_text

# [Huaman2014], Tables I to IV; times [s] on a Core i7 of 1.6 GHz
PAPER = {
    "butler": {"time": 2.31, "giver": 32.36, "receiver": 39.77, "poses": 16.64},
    "stool": {"time": 4.62, "giver": 56.87, "receiver": 143.28, "poses": 89.49},
    "kneeling": {"time": 3.1845, "giver": 30.45, "receiver": 72.91, "poses": 39.89},
}
ASKED_S = {"butler": 0.15, "stool": 0.25, "kneeling": 0.20}
CHOOSING_MS, TAIL, UNSOLVABLE = 50.0, 3.0, 5
VARIED, VARIED_SHARE = (
    200,
    97.0,
)  # other scenes than the paper's; percent of solvable ones
TABLE_I = {
    "cup": (316, 368, 368),
    "hammer": (445, 590, 644),
    "food_jar": (448, 448, 448),
}
_HANDS = ("sdh_left", "hubo_left", "hubo_right")
_LIMIT_S, _LONG_S = 10.0, 300.0
PATIENCE_S = 10.0  # after Ctrl-C: what was done is told, see `sim.bench.command`


def run(
    *,
    runs: int | None = None,
    varied: bool = False,
    seed: int = 0,
    short: bool = False,
    only: Sequence[str] | None = None,
    out: Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Plan and check hand-overs.

    Args:
        runs: Seeds of each scene; 100, or 200 with `varied`.
        varied: Other scenes than the paper's.
        seed: The first one.
        short: Two of each: to see that it runs, not to measure.
        only: These of the paper's scenes; all if left.
        out: Folder that keeps every draw: what is there is not done again.
        tell: Called with what is done.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables" and "runs".

    Raises:
        BadInput: `only` names another scene.
    """
    tell = tell or (lambda text: None)
    names = ["varied"] if varied else _of_the_paper(only)
    runs = 2 if short else runs or (VARIED if varied else 100)
    rows, found, tables, ended = [], {}, [], ""
    if not varied and not short:
        tell("grasps of Table I")
        tables.append(_table_one())
    for name in names:
        done = found.setdefault(name, [])
        try:
            tell(f"{name}: warming up")
            _plan(load_scene(name, seed + runs))
            for k in range(seed, seed + runs):
                done.append(_kept(name, k, out))
                tell(f"{name}: {k - seed + 1} of {runs}")
        except KeyboardInterrupt:
            ended = f"by Ctrl-C, in {name} after {len(done)} draws"
        rows += _rows(name, done) if done else []
        if ended:
            break
    if not varied:
        tables.append(_tables_two_to_four(found))
    tables += _unsolvable(found)
    return {
        "bench": "handover",
        "header": header(),
        "setup": _setup(runs, seed, out, ended),
        "rows": rows,
        "tables": tables,
        "runs": found,
    }


def _of_the_paper(only: Sequence[str] | None) -> list[str]:
    for name in only or ():
        if name not in PAPER:
            raise BadInput(
                f"the paper has no scene {name!r}; give one of {', '.join(PAPER)}"
            )
    return list(only or PAPER)


def _setup(runs: int, seed: int, out: Path | None, ended: str) -> dict:
    return {
        "runs of each scene": runs,
        "first seed": seed,
        "time limit": f"{_LIMIT_S:g} s",
        "paper": "Core i7 of 1.6 GHz",
        "ours": "seconds of one processor; wall clock beside them in the JSON",
        **({"draws kept in": str(out)} if out else {}),
        **({"ended": ended} if ended else {}),
    }


def _kept(name: str, seed: int, out: Path | None) -> dict:
    """Return a draw that was kept in a folder, or do it and keep it."""
    path = None if out is None else Path(out) / f"{name}-{seed}.json"
    if path is not None and path.is_file():
        return json.loads(path.read_text(encoding="utf-8"))
    row = one_run(name, seed)
    if path is not None:
        write_text(path, json.dumps(row))
    return row


def one_run(name: str, seed: int) -> dict:
    """Plan one draw, make all of H, check all motions; plain data."""
    scene = load_scene(name, seed)
    begun, cpu = time.perf_counter(), time.process_time()
    plan = _plan(scene)
    row = {
        "seed": seed,
        "found": bool(plan),
        "seconds": time.process_time() - cpu,
        "wall_s": time.perf_counter() - begun,
    }
    if not plan:
        row["reason"] = plan.reason
        whole = _plan(scene, motions=False, limit_s=_LONG_S)
        timeless = "time limit" not in whole.reason
        row["unsolvable"] = not whole and timeless
        row["proof"] = whole.reason if row["unsolvable"] else ""
        return row
    begun = time.process_time()
    _plan(scene, motions=False)
    choosing = time.process_time() - begun
    arms = plan.arm, plan.arm_receiver
    hands = (scene.giver.agent.arms[arms[0]], scene.receiver.agent.arms[arms[1]])
    sets = dict(
        zip(
            (hand.spec.name for hand in hands),
            (plan.grasps_giver, plan.grasps_receiver),
            strict=True,
        )
    )
    pair = pair_of(scene, arms, sets)
    wholes = whole_choice(scene, pair, PlanSettings(), plan.report.step)
    whole = next(w for w in wholes if w.tuples)  # what the paper's tables count
    tried = _tried(plan, wholes)
    checked = check_plan(json.loads(json.dumps(record_of(plan))))
    return row | {
        "choosing_s": choosing,
        "grasps_giver": whole.giver,
        "grasps_receiver": whole.receiver,
        "poses": whole.poses,
        "tuples": len(whole.tuples),
        "step": plan.report.step,
        "dexterity": plan.chosen.dexterity,
        "best_dexterity": best_of(wholes, tried),
        "best_of_all": best_of(wholes, set()),
        "tried": len(tried) + 1,
        "duration_s": checked["duration_s"],
        "collisions": checked["collisions"],
        "faults": checked["faults"],
        "distances": checked["distances"],
    }


def _tried(plan: HandoverPlan, wholes: Sequence[Whole]) -> set:
    """Return the keys of the tuples of H whose motions were shown not to exist."""
    hopeless = plan.report.unplaceable, plan.report.unpickable
    tried = {
        key_of(t.grasp_receiver, t.grasp_giver, t.T_world_handover)
        for t in plan.report.refused
    }
    return tried | {
        key
        for some in wholes
        for key in some.tuples
        if key[0] in hopeless[0] or key[1] in hopeless[1]
    }


def _plan(
    scene: Scene, motions: bool = True, limit_s: float = _LIMIT_S
) -> HandoverPlan:
    return plan_handover(scene, limit_s, motions=motions)


def _rows(name: str, runs: list[dict]) -> list[dict]:
    """Return the figures of one scene beside what is asked."""
    good = [r for r in runs if r["found"]]
    never = sum(r.get("unsolvable", False) for r in runs)
    solvable = len(runs) - never
    share = 100.0 * len(good) / max(solvable, 1)
    least = VARIED_SHARE if name == "varied" else 100.0
    most = UNSOLVABLE * len(runs) / 100.0
    label = f"{name}: planned, of {solvable} solvable draws"
    rows = [
        value_row(label, share, "%", least=least),
        value_row(f"{name}: unsolvable draws, of {len(runs)}", never, "", most=most),
    ]
    if not good:
        return rows
    seconds = np.array([r["seconds"] for r in good])
    choosing = float(1e3 * np.nanmean([r["choosing_s"] for r in good]))
    limit, tail = ASKED_S.get(name), float(np.percentile(seconds, 95))
    longest = None if limit is None else TAIL * limit
    met = sum(bool(r["collisions"]) for r in good)
    wrong = sum(bool(r["faults"]) for r in good)
    equal = sum(abs(r["dexterity"] - r["best_dexterity"]) <= 1e-12 for r in good)
    passed = sum(r["best_of_all"] > r["best_dexterity"] + 1e-12 for r in good)
    label = f"{name}: dexterity at the goal equals the best of H that has motions"
    rows += [
        value_row(
            f"{name}: average CPU time, all motions", seconds.mean(), "s", most=limit
        ),
        value_row(f"{name}: p50 of it", float(np.median(seconds)), "s"),
        value_row(f"{name}: p95 of it", tail, "s", most=longest),
        value_row(f"{name}: choosing from H", choosing, "ms", most=CHOOSING_MS),
        value_row(f"{name}: plans with a collision", met, "", most=0),
        value_row(f"{name}: plans with another fault", wrong, "", most=0),
        value_row(label, equal, f"of {len(good)}", least=len(good)),
        value_row(f"{name}: draws whose best of H had no motions", passed, ""),
    ]
    near = [d["distance_m"] for r in good for k, d in r["distances"].items()
            if "self" not in k and not k.startswith("object")]  # fmt: skip
    if near:
        rows.append(
            value_row(f"{name}: smallest distance of arms", 1e3 * min(near), "mm")
        )
    return rows


def _table_one() -> dict:
    from handover.plans.grasps import grasps_for

    rows = []
    for thing, paper in TABLE_I.items():
        ours = [len(grasps_for(load_object(thing), hand_spec(h))) for h in _HANDS]
        rows.append([thing, *(f"{p} / {n}" for p, n in zip(paper, ours, strict=True))])
    return {
        "title": "Table I: grasps per object, paper / ours",
        "head": ["object", "SDH", "Hubo left hand", "Hubo right hand"],
        "rows": rows,
    }


def _tables_two_to_four(found: dict) -> dict:
    rows = []
    for name, runs in found.items():
        good, paper = [r for r in runs if r["found"]], PAPER[name]
        if not good:
            continue

        def mean(key: str, good: list = good) -> str:
            return f"{np.mean([r[key] for r in good]):.2f}"

        rows.append(
            [
                name,
                f"100/100 / {len(good)}/{len(runs)}",
                f"{paper['time']:g} / {mean('seconds')}",
                f"{paper['giver']:g} / {mean('grasps_giver')}",
                f"{paper['receiver']:g} / {mean('grasps_receiver')}",
                f"{paper['poses']:g} / {mean('poses')}",
                mean("tuples"),
            ]
        )
    return {
        "title": "Tables II to IV: paper / ours, averages",
        "head": [
            "scene", "successful", "planning time [s]", "grasps of the giver",
            "grasps of the receiver", "hand-over poses", "tuples of H, ours",
        ],
        "rows": rows,
    }  # fmt: skip


def _unsolvable(found: dict) -> list[dict]:
    """Return the draws without a plan, and why, as a table; none: no table."""
    rows = [
        [name, str(r["seed"]), "unsolvable" if r["unsolvable"] else "failed",
         r["proof"] or r["reason"]]
        for name, runs in found.items() for r in runs if not r["found"]
    ]  # fmt: skip
    head = ["scene", "seed", "what", "why"]
    return (
        [{"title": "Draws without a plan", "head": head, "rows": rows}] if rows else []
    )
