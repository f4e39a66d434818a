"""Random cases in which best-first search must agree with the full grid."""

from collections.abc import Callable

import numpy as np

from handover import (
    POSTURES,
    Human,
    InteractionWorkspace,
    MeetSettings,
    QualitySettings,
    ReachMap,
    mallet,
    wrench,
)

PEOPLE = 50  # in front of each workspace
K = 10


def equal_cases(
    reach: ReachMap, n: int, seed: int, tell: Callable[[str], None]
) -> float:
    """Return in how many of n random cases the two top tens differ.

    Keys and qualities have to be the same; equal qualities are ordered by key. Every
    workspace has its own object, grasps, side and settings, every person another
    place, height, posture, gaze and arms; a few of the last best are removed.
    """
    rng = np.random.default_rng(seed)
    wrong = 0
    for done in range(0, n, PEOPLE):
        tell(f"random cases: {done} of {n}")
        meet = _workspace(reach, rng)
        for _ in range(min(PEOPLE, n - done)):
            meet.restore()
            meet.update(somebody(rng))
            for target in meet.best(3)[: rng.integers(4)]:
                meet.remove(target)
            wrong += not agrees(meet)
    return float(wrong)


def agrees(meet: InteractionWorkspace) -> bool:
    """Return whether the best 10 are those of the full grid, removed ones left out."""
    targets = meet.best(K)
    value = meet.build().copy()
    value[np.isin(meet.keys, meet.removed)] = -1.0
    order = np.lexsort((meet.keys, -value))[:K]
    order = order[value[order] >= 0]
    found = [(t.key, t.quality) for t in targets]
    return found == list(
        zip(meet.keys[order].tolist(), value[order].tolist(), strict=True)
    )


def _workspace(reach: ReachMap, rng: np.random.Generator) -> InteractionWorkspace:
    weights = rng.dirichlet(np.ones(5))
    weights[-1] = 1.0 - weights[:-1].sum()
    quality = QualitySettings(
        weights=tuple(weights.tolist()), online_weight=rng.choice([0.0, 0.3, 0.5, 1.0])
    )
    settings = MeetSettings(
        side=("left", "right")[rng.integers(2)],
        cell=max(0.15, reach.grid.cell),
        rotations=72,
        marked_share=rng.choice([0.0, 0.5]),
        quality=quality,
    )
    obj = (wrench, mallet)[rng.integers(2)]()
    return InteractionWorkspace(
        reach, somebody(rng), obj, int(rng.integers(1, 13)), settings
    )


def somebody(rng: np.random.Generator) -> Human:
    """Return a person of any height and posture around the origin."""
    human = Human(rng.uniform(1.4, 2.0), tuple(POSTURES)[rng.integers(len(POSTURES))])
    angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.5, 2.2)
    x, y = away * np.cos(angle), away * np.sin(angle)
    human = human.placed(x, y, angle + np.pi + rng.normal(0.0, 0.5))
    for side in ("left", "right"):
        arm = human.arm(side)
        human = human.with_arm(side, rng.uniform(arm.lower, arm.upper))
    return human if rng.random() < 0.3 else human.looking(rng.normal(size=3))
