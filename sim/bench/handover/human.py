"""`odm bench human`: inverse kinematics of an arm, quality, a frame's set-up."""

from collections.abc import Callable

import numpy as np

from handover import Arm, ArmState, Human, QualitySettings, human_from_joints
from handover.human._arm_ik import WORK_ROWS
from handover.human._arm_solve import solvable_poses
from handover.human._human_arm import arm_poses
from handover.human.human_arm import STEP
from sim.bench.clock import Clock
from sim.bench.handover._human_loops import qualities_of, solve_poses
from sim.tables.header import header
from sim.tables.table import value_row

A_SOLUTION, A_POSE, RESIDUAL = 0.5, 2.5, 1e-10  # asked [us], [us], [m and rad]
CHUNK = 5000  # poses between two looks at the clock


def run(
    *, seed: int = 0, short: bool = False, tell: Callable[[str], None] | None = None
) -> dict:
    """Measure the arm of a person of 1.75 m on poses of its own forward kinematics.

    Joints are drawn evenly from their ranges. All swivels of a pose are solved, with
    representatives every 15 degrees and at both ends of each interval.

    Args:
        seed: Of the poses.
        short: Few poses: to see that it runs, not to measure.
        tell: Called with what is measured.

    Returns:
        Plain data for JSON: "header", "setup" and "rows".
    """
    n = 20_000 if short else 1_000_000
    tell = tell or (lambda text: None)
    rng = np.random.default_rng(seed)
    human = Human(1.75)
    arm = human.arm("right")
    tell(f"inverse kinematics of {n} poses")
    found = _solved(arm, rng.uniform(arm.lower, arm.upper, (n, 7)))
    tell("residuals")
    worst = _worst_residual(arm, rng, 1000 if short else 20_000)
    ask = f"{found['solutions']:.2f} solutions a pose"
    rows = [
        value_row("IK: a pose, all swivels", found["pose_us"], "us", ask, most=A_POSE),
        value_row("IK: a solution", found["solution_us"], "us", ask, most=A_SOLUTION),
        value_row("IK: can it be reached", found["solvable_us"], "us"),
        value_row(
            "IK: poses missed",
            found["missed"],
            "",
            f"of {n} poses of its own forward kinematics",
            most=0,
        ),
        value_row("IK: largest residual", worst, "m, rad", most=RESIDUAL),
        value_row("quality of a posture", _quality_us(human, rng, n // 4), "us"),
        *_frame_rows(human, 100 if short else 1000),
    ]
    setup = {"poses": n, "step of the swivel": "15 deg", "seed": seed}
    setup["clock"] = f"CPU time of the thread, median over chunks of {CHUNK} poses"
    return {"bench": "human", "header": header(), "setup": setup, "rows": rows}


def _solved(arm: Arm, joints: np.ndarray) -> dict[str, float]:
    """Return times [us of CPU], how many solutions a pose has, and poses missed."""
    poses = np.empty((len(joints), 12))
    arm_poses(arm.packed, joints, poses)
    work, q, at = np.empty((WORK_ROWS, 3)), np.empty((200, 7)), np.empty((200, 2))
    counts, answer = np.empty((len(joints), 2), np.int64), np.empty(len(joints), bool)
    solve, ask = Clock(), Clock()
    solve_poses(arm.packed, poses[:1], STEP, work, q, at, counts[:1])
    solvable_poses(arm.packed, poses[:1], work, q[0], answer[:1])
    for i in range(0, len(poses), CHUNK):
        part = slice(i, i + CHUNK)
        solve(solve_poses, arm.packed, poses[part], STEP, work, q, at, counts[part])
        ask(solvable_poses, arm.packed, poses[part], work, q[0], answer[part])
    pose_us = 1e-3 * float(np.median(solve.cpu)) / CHUNK
    solutions = float(counts[:, 0].mean())
    return {
        "pose_us": pose_us,
        "solution_us": pose_us / solutions,
        "solutions": solutions,
        "solvable_us": 1e-3 * float(np.median(ask.cpu)) / CHUNK,
        "missed": float((counts[:, 0] == 0).sum()),
    }


def _worst_residual(arm: Arm, rng: np.random.Generator, n: int) -> float:
    """Return the largest error of any solution of n poses [m and rad]."""
    worst = 0.0
    for joints in rng.uniform(arm.lower, arm.upper, (n, 7)):
        T = arm.fk(joints)
        q = np.array(arm.ik(T).q)
        poses = np.empty((len(q), 12))
        arm_poses(arm.packed, q, poses)
        wanted = np.concatenate([T[:3, :3].ravel(), T[:3, 3]])
        worst = max(worst, float(np.abs(poses - wanted).max()))
    return worst


def _quality_us(human: Human, rng: np.random.Generator, n: int) -> float:
    """Return what the quality of one posture takes [us of CPU]."""
    state = ArmState.of(human, "right", QualitySettings())
    arm, clock = human.arm("right"), Clock()
    args = state.state, state.obstacles, state.settings
    joints = rng.uniform(arm.lower, arm.upper, (n, 7))
    parts, online = np.empty((n, 5)), np.empty(n)
    qualities_of(*args, joints[:1], parts[:1], online[:1])
    for i in range(0, n, CHUNK):
        part = slice(i, i + CHUNK)
        clock(qualities_of, *args, joints[part], parts[part], online[part])
    return 1e-3 * float(np.median(clock.cpu)) / CHUNK


def _frame_rows(human: Human, n: int) -> list[dict]:
    """Return what a frame costs in which the person has moved."""
    settings = QualitySettings()
    jobs = {
        "frame: person from measured joints": lambda: human_from_joints(
            human.places, 1.75
        ),
        "frame: the same person elsewhere": lambda: human.moved(human.T_world_pelvis),
        "frame: set-up of the quality": lambda: ArmState.of(human, "right", settings),
    }
    rows = []
    for name, job in jobs.items():
        clock = Clock()
        for _ in range(n):
            clock(job)
        rows.append(clock.row(name))
    return rows
