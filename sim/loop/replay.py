"""`odm replay`: recorded obstacle frames through the planner, without a simulator."""

import numpy as np

from odm import Answer, CellMap, ReactivePlanner
from odm.execution.kinematic import Follower
from odm.frame.freedom import check_valid
from roadmap.builds.chunks import Progress
from roadmap.kinematics.forward import difference
from sim.loop.loop import ARRIVED
from sim.loop.recording import Recording
from sim.loop.run_result import percentiles
from sim.loop.warmup import exercise


def play(
    cell_map: CellMap,
    recording: Recording,
    always_replan: bool = False,
    paths: bool = False,
    progress: Progress | None = None,
) -> dict:
    """Play a recording; between frames the robot follows the answer's path.

    It moves at its joints' speed limits; while the planner holds it stands still, and
    does not retreat as in `odm run`. With `always_replan` each frame searches from
    scratch, with `paths` the path of each frame is kept.

    Returns:
        Plain data: "map_hash", "summary", "frames" (the same for the same input) and
        "latency_s" (the clock's figures).

    Raises:
        BadConfiguration: Start or goal can never be taken: self-collision, scenery.
    """
    planner = ReactivePlanner(cell_map, always_replan=always_replan)
    check_valid(planner.static, recording.q_start, "q_start")
    check_valid(planner.static, recording.q_goal, "q_goal")
    planner.set_goals([recording.q_goal])
    exercise(cell_map)
    follower = Follower(cell_map.robot)
    q, period = recording.q_start.copy(), 1.0 / recording.rate_hz
    rows, latency = [], []
    for i in range(recording.n_frames):
        answer = _step(planner, recording, i, q)
        latency.append(answer.latency_s)
        rows.append(_row(cell_map, answer, q, paths))
        if answer.status != "holding":
            q = follower.advance(q, answer.path, period)
        if progress is not None and (i % 50 == 49 or i + 1 == recording.n_frames):
            progress("frames", i + 1, recording.n_frames)
    arrived = np.abs(difference(cell_map.robot, q, recording.q_goal)).max() <= ARRIVED
    return {
        "map_hash": cell_map.hash,
        "always_replan": always_replan,
        "summary": _summary(recording, rows, bool(arrived)),
        "frames": rows,
        "latency_s": _latency(latency),
    }


def _step(
    planner: ReactivePlanner, recording: Recording, i: int, q: np.ndarray
) -> Answer:
    now = i / recording.rate_hz
    return planner.step(
        recording.frame(i),
        q=q,
        stamp=now,
        now=now,
        covering_radius=recording.covering_radius,
        rounding=recording.rounding_of(i),
        closed=recording.covering_radius is None,
    )


def _row(cell_map: CellMap, answer: Answer, q: np.ndarray, paths: bool) -> dict:
    row = {
        "status": answer.status,
        "goal": answer.goal,
        "path_length": path_length(cell_map, answer.path),
        "reason": answer.reason,
        "certified": answer.certified,
        "points_outside": int(answer.work.outside),
        "q": q.tolist(),
    }
    return row | {"path": answer.path.tolist()} if paths else row


def path_length(cell_map: CellMap, path: np.ndarray) -> float | None:
    """Return the length of a path (k, dof) in joint space, None where there is none."""
    if len(path) == 0:
        return None
    steps = difference(cell_map.robot, path[:-1], path[1:])
    return float(np.linalg.norm(steps, axis=1).sum())


def _summary(recording: Recording, rows: list[dict], arrived: bool) -> dict:
    statuses = [row["status"] for row in rows]
    lengths = [row["path_length"] for row in rows if row["path_length"] is not None]
    there = [i for i, row in enumerate(rows) if row["path_length"] == 0.0]
    return {
        "n_frames": len(rows),
        "rate_hz": recording.rate_hz,
        "points": len(recording.points),
        "points_outside": sum(row["points_outside"] for row in rows),
        **{
            name: statuses.count(name) for name in ("following", "replanned", "holding")
        },
        "path_length": percentiles(np.array(lengths)),
        "arrived": arrived,
        "arrived_at_frame": there[0] if there else None,
    }


def _latency(latency: list[dict[str, float]]) -> dict:
    stages = {name: np.array([row[name] for row in latency]) for name in latency[0]}
    return {
        "summary": {name: percentiles(values) for name, values in stages.items()},
        "frames": stages["total"].tolist(),
    }


def show(record: dict) -> None:
    """Print the summary of what `play` returned."""
    summary, total = record["summary"], record["latency_s"]["summary"]["total"]
    counts = ", ".join(
        f"{summary[name]} {name}" for name in ("following", "replanned", "holding")
    )
    figures = ", ".join(f"{k} {1e6 * v:.1f} µs" for k, v in total.items())
    at = summary["arrived_at_frame"]
    end = "the goal was not reached"
    if summary["arrived"]:
        end = "goal reached" + ("" if at is None else f" at frame {at}")
    print(f"{summary['n_frames']} frames: {counts}; {end}")
    print(f"latency {figures}; map {record['map_hash'][:12]}")
    if summary["points_outside"]:
        print(f"{summary['points_outside']} points lay outside the map's grid")
