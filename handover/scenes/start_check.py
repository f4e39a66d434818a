"""Whether a scene can begin: exact distances between all that is there at the start."""

from collections.abc import Iterable, Iterator
from itertools import combinations, product

import numpy as np

from handover.grasps.hand import make_hand
from handover.scenes.scene import PlacedAgent, Scene
from odm.exact import _distances as kernels
from odm.exact.distances import ExactObstacles, obstacles_of
from odm.obstacles.shapes import Shape
from roadmap.errors import BadInput

_CAP = 0.05  # [m] distances beyond are not resolved


def start_distances(scene: Scene) -> list[tuple[float, str, str]]:
    """Return (distance, one, other) of all that is nearer than 5 cm, nearest first.

    Both agents as they wait, with themselves and each other, the object at its start,
    and furniture; pairs of furniture, neighbouring links and links of a hand that meet
    where it stands open are left out. 0 is contact.
    """
    giver, receiver = _links(scene.giver), _links(scene.receiver)
    thing = {scene.obj.name: obstacles_of(scene.object_shapes(scene.T_world_start))}
    fixed = _by_name((f.name, f.shape) for f in scene.scenery)
    both = [*giver.items(), *receiver.items()]  # who may have the same name
    pairs = list(product(giver.items(), receiver.items()))
    pairs += product([*both, *thing.items()], fixed.items())
    pairs += product(both, thing.items())
    for agent, group in ((scene.giver, giver), (scene.receiver, receiver)):
        pairs += _within(agent, group)
    far = [(_distance(a, b), one, other) for (one, a), (other, b) in pairs]
    return sorted(row for row in far if row[0] < _CAP)


def check_start(scene: Scene) -> None:
    """Refuse a scene that begins in collision; name both and a remedy."""
    found = start_distances(scene)
    if found and found[0][0] <= 0.0:
        _, one, other = found[0]
        raise BadInput(
            f"the start of {scene.name} (seed {scene.seed}) is in collision: {one} "
            f"meets {other}; move one of them by more than their overlap, or give the "
            "agent another posture, or joints, as in [giver.joints]"
        )


def _links(placed: PlacedAgent) -> dict[str, ExactObstacles]:
    name = placed.agent.name
    return _by_name((f"{name}/{link}", shape) for link, shape in placed.shapes())


def _by_name(named: Iterable[tuple[str, Shape]]) -> dict[str, ExactObstacles]:
    """Return all shapes of one name together; a table's legs may have the same."""
    groups: dict[str, list[Shape]] = {}
    for name, shape in named:
        groups.setdefault(name, []).append(shape)
    return {name: obstacles_of(shapes) for name, shapes in groups.items()}


def _within(
    placed: PlacedAgent, group: dict[str, ExactObstacles]
) -> Iterator[tuple[tuple[str, ExactObstacles], tuple[str, ExactObstacles]]]:
    """Yield the pairs of an agent's links that must not touch."""
    linked = _linkages(placed)
    for one, other in combinations(group.items(), 2):
        links = one[0].partition("/")[2], other[0].partition("/")[2]
        if links not in placed.body.neighbours and frozenset(links) not in linked:
            yield one, other


def _linkages(placed: PlacedAgent) -> set[frozenset[str]]:
    """Return pairs of links of a hand that meet where it stands open.

    So do the bars of a gripper whose jaws move on parallel bars: the URDF's tree has no
    joint where the loop closes.
    """
    found = set()
    for arm in placed.agent.arms.values():
        hand = make_hand(arm.spec)
        apart = {frozenset(hand.links[k] for k in pair) for pair in hand.pairs.tolist()}
        every = map(frozenset, combinations(hand.links, 2))
        found |= {pair for pair in every if pair not in apart}
    return found


def _distance(a: ExactObstacles, b: ExactObstacles) -> float:
    use = np.ones(len(a.frames), bool)
    found = np.empty(2, np.int64)
    best, _ = kernels.nearest_pair(
        a.convexes, use, a.frames, b.convexes, b.frames, _CAP, found
    )
    return float(best)
