"""The interaction workspace: against a slow twin, and its short cuts against itself."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from meet_people import person
from numba import njit
from reach_chains import BASE
from scipy.spatial.transform import Rotation
from wrappers import with_wrapper

import handover
from handover import Above, Human, Inside, QualitySettings, Upright, mallet, wrench
from handover.human.body import ARM_LABELS
from handover.meet import _meet_bounds as bounds
from handover.meet._meet import NUDGE, UNREACHED, Candidate, hand_value
from handover.meet.constraints import ClearOf
from handover.reach.robot_cells import robot_cells
from odm.obstacles.scenery import parse_scenery
from roadmap.compiling.jit_options import FULL
from roadmap.errors import BadInput
from roadmap.geometry.gaps import moved_rods
from roadmap.transforms import pose_of

position_bounds = with_wrapper(bounds.position_bounds)
now_turn = with_wrapper(bounds.now_turn)
fill_spins = with_wrapper(bounds.fill_spins)
grip_bound = with_wrapper(bounds.grip_bound)
byte_passes = with_wrapper(bounds.byte_passes)


def somebody(rng, far=1.3):
    """Return a person of any size somewhere near the robot, looking anywhere."""
    posture = ("standing", "bending", "sitting", "lying")[rng.integers(4)]
    human = Human(rng.uniform(1.4, 2.0), posture)
    angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, far)
    x, y = BASE[:2, 3] + away * np.array([np.cos(angle), np.sin(angle)])
    human = human.placed(x, y, angle + np.pi + rng.normal(0, 0.5))
    for side in ("left", "right"):
        arm = human.arm(side)
        human = human.with_arm(side, rng.uniform(arm.lower, arm.upper))
    return human if rng.random() < 0.3 else human.looking(rng.normal(size=3))


def slow_value(meet, person_map, human, key):
    """Return q_total of one cell by poses, IK and quality of the public doors."""
    s = meet.settings
    T_tool = s.T_world_base @ meet.grid.centers([key])[0]
    state = handover.ArmState.of(human, s.side, s.quality, s.obstacles)
    best = -1.0
    for grasp in meet.grasps:
        T_hand = T_tool @ meet.obj.T_tool_object @ grasp
        arm = human.arm(s.side)
        T = arm.mirrored(np.linalg.inv(human.T_world_shoulder(s.side)) @ T_hand)
        near = T.copy()
        near[:3, :3] = Rotation.from_rotvec(NUDGE).as_matrix() @ T[:3, :3]
        near[:3, 3] /= arm.length
        dexterity = person_map.quality(near)
        for q in human.arm_ik(s.side, T_hand, s.swivel_step).q:
            online = handover.posture_quality(state, q).online
            best = max(best, handover.total_quality(online, dexterity, s.quality))
    return best


@pytest.mark.parametrize("side", ["left", "right"])
def test_every_cell_is_worth_what_the_slow_twin_says(side, meet_of, person_map, rng):
    seen = 0
    for _ in range(4):
        human = somebody(rng, 0.9)
        rods = np.array([[0.5, 0.1, 1.0, 0.6, 0.1, 1.3, 0.05]])
        meet = meet_of(human, side=side, obstacles=rods)
        value = meet.build()
        reached = np.flatnonzero(value >= 0)
        cells = np.concatenate([reached[::9], rng.integers(0, len(value), 60)])
        seen += len(reached[::9])
        for e in cells:
            slow = slow_value(meet, person_map, human, int(meet.keys[e]))
            assert value[e] == pytest.approx(slow, abs=2e-9)
    assert seen > 40


def best_of_all(meet, k, removed=()):
    """Return keys and qualities of the best k of the full grid."""
    value = meet.build().copy()
    value[np.isin(meet.keys, list(removed))] = -1.0
    order = np.lexsort((meet.keys, -value))[:k]
    order = order[value[order] >= 0]
    return meet.keys[order].tolist(), value[order].tolist()


def answer(targets):
    return [t.key for t in targets], [t.quality for t in targets]


@pytest.mark.parametrize("obj", [wrench(), mallet()], ids=["wrench", "mallet"])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_best_first_finds_the_best_of_the_full_grid(obj, share, meet_of, rng):
    quality = QualitySettings(
        online_weight=share, joint_weights=(1, 2, 0.5, 1, 0, 1, 1), absent_gaze="omit"
    )
    meet = meet_of(somebody(rng), obj, 8, quality=quality, side="left")
    found = 0
    for _ in range(25):
        meet.update(somebody(rng))
        targets = meet.best(10)
        assert answer(targets) == best_of_all(meet, 10)
        found += len(targets)
    assert found > 50


def test_a_ranking_over_many_frames_finds_the_same(meet_of, rng):
    meet = meet_of(somebody(rng), wrench(), 8)
    most = 0
    for k in range(4):
        meet.update(somebody(rng))
        meet.begin(10)
        calls = 1
        while not meet.go_on(5.0):
            calls += 1
            meet.rated(meet.keys[:3])  # in between
        assert answer(meet.ranked()) == best_of_all(meet, 10)
        most = max(most, calls)
        meet.begin(10)  # given up, half done, for somebody else
        meet.go_on(5.0)
    assert most > 5
    meet.update(somebody(rng))
    assert answer(meet.best(10)) == best_of_all(meet, 10)


def test_a_ranking_that_was_not_begun_or_is_not_over_is_refused(meet_of, rng):
    meet = meet_of(somebody(rng), wrench(), 8)
    with pytest.raises(BadInput, match="no ranking was begun"):
        meet.go_on(1.0)
    meet.begin(10)
    if not meet.go_on(0.0):
        with pytest.raises(BadInput, match="not over"):
            meet.ranked()


@njit(**FULL | {"cache": False})
def values_of(person, hands, cells, n_grasps, room):
    """Return q_total of every candidate, (cells, grasps); below 0: not reached."""
    value = np.empty((cells.rotation.shape[0], n_grasps))
    for p in range(cells.points.shape[0]):
        x, y, z = cells.points[p]
        for e in range(cells.first[p], cells.first[p + 1]):
            for g in range(n_grasps):
                one = Candidate(cells.rotation[e], g, x, y, z)
                value[e, g] = hand_value(person, hands, one, UNREACHED, room)
    return value


@pytest.mark.parametrize(("share", "slack"), [(0.5, 0.02), (5 / 6, 0.0333)])
def test_no_bound_is_below_what_it_bounds(meet_of, rng, share, slack):
    """A bound on q_online is off by as much more as q_online weighs more."""
    quality = QualitySettings(online_weight=share)
    closest = np.full(3, np.inf)
    n = 0
    for _ in range(6):
        meet = meet_of(somebody(rng, 0.8), grasps=6, quality=quality)
        (person, hands, cells), room = meet._scene, meet._scratch
        made = meet._tables.bounds(person, meet._bounds)
        position_bounds(person, hands, cells, made)
        now_turn(person, made.now)
        fill_spins(person, hands.pose, made)
        values = values_of(person, hands, cells, 6, room)
        for e, g in np.argwhere(values >= 0):
            p = int(np.searchsorted(cells.first, e, "right")) - 1
            one = Candidate(cells.rotation[e], int(g), *cells.points[p])
            n, true = n + 1, values[e, g]
            grip = grip_bound(person, hands, made, one, 0.0, room.parts)
            there = hands.pose[one.rotation, g, 9:] + cells.points[p]
            at = bounds.position_of(person.box, *there)
            place = made.place[at] if at >= 0 else np.inf
            for level in (true, np.nextafter(true, 0)):
                assert byte_passes(person, hands, made, p, one, level)
            gaps = np.array([made.whole[p], place, grip]) - true
            closest = np.minimum(closest, gaps)
    assert n > 2000 and (closest > 0).all()
    assert closest[2] < slack


def test_what_a_target_says_fits_together(meet_of, rng):
    human = somebody(rng, 0.7)
    meet = meet_of(human, mallet(), side="left")
    targets = meet.best(40)
    assert len(targets) > 5
    for t in targets:
        assert np.allclose(t.T_world_object, t.T_world_tool @ meet.obj.T_tool_object)
        T_hand = human.T_world_shoulder("left") @ human.arm("left").fk(t.arm_q)
        assert np.allclose(T_hand, t.T_world_hand, atol=1e-9)
        assert np.allclose(t.T_world_object @ meet.grasps[t.grasp], t.T_world_hand)
        assert t.quality == pytest.approx((5 * t.parts.online + t.dexterity) / 6)
        arm = human.arm("left")
        assert (t.arm_q >= arm.lower).all() and (t.arm_q <= arm.upper).all()


def test_cells_asked_by_key_are_worth_what_the_full_grid_says(meet_of, rng):
    meet = meet_of(somebody(rng, 0.7))
    best = meet.best(3)
    value = meet.build()
    keys = [best[2].key, -1, int(meet.keys[value.argmin()]), best[0].key, 10**9]
    meet.remove(best[1])
    rated = meet.rated([*keys, best[1].key])
    assert [t and t.key for t in rated] == [
        best[2].key,
        *2 * [None],
        best[0].key,
        None,
        None,
    ]
    assert np.allclose(rated[0].arm_q, best[2].arm_q)
    quality = meet.quality_of(keys)
    assert quality.tolist() == [best[2].quality, -1, -1, best[0].quality, -1]
    none = meet_of(meet.human, constraints=[Above(50.0)])
    assert none.rated([4]) == [None] and none.quality_of([4]).tolist() == [-1]


def test_removed_targets_stay_out_until_restored(meet_of, rng):
    meet = meet_of(somebody(rng, 0.7))
    before, n = answer(meet.best(12)), len(meet)
    first = meet.best(1)[0]
    out = []
    for _ in range(8):
        target = meet.best(1)[0]
        out.append(target.key)
        meet.remove(target)
        assert answer(meet.best(5)) == best_of_all(meet, 5, out)
    assert out == before[0][:8] and len(meet) == n - 8
    meet.update(meet.human.looking([1.0, 0.0, 0.0]))
    assert not set(out) & {t.key for t in meet.best(20)}
    meet.update(replace(meet.human, gaze=None))
    meet.restore([first])
    assert first.key in {t.key for t in meet.best(1)} and len(meet) == n - 7
    with pytest.raises(BadInput, match="no cell of this workspace has the key -3"):
        meet.restore([replace(first, key=-3)])
    meet.restore()
    assert len(meet) == n


def test_an_update_is_as_good_as_a_new_workspace(meet_of, rng):
    human = somebody(rng, 0.8)
    meet = meet_of(human)
    steps = [
        lambda h: h.moved(pose_of([0.02, 0.01, 0.0]) @ h.T_world_pelvis),
        lambda h: h.moved(h.T_world_pelvis @ pose_of([0, 0, 0], [0, 0, 0.1])),
        lambda h: h.looking(rng.normal(size=3)),
        lambda h: h.looking(None),
        lambda h: h.with_arm("right", rng.uniform(-0.4, 0.4, 7)),
        lambda h: h.with_arm("left", np.radians([60, 10, 0, 90, 0, 0, 0])),
        lambda h: replace(h, bend=[0.1, 0.3, -0.2]),
        lambda h: h.moved(h.T_world_pelvis @ pose_of([0, 0, 0], [0.3, 0.2, 0])),
        lambda h: h.resized(1.6),
    ]
    for step in steps:
        human = step(human)
        meet.update(human)
        new = meet_of(human)
        assert np.allclose(meet.build(), new.build(), atol=2e-9)
        assert [t.key for t in meet.best(10)] == [t.key for t in new.best(10)]


def _missing(meet):
    """Look at every wrist of every cell."""
    T = BASE @ meet.grid.centers(meet.keys) @ meet.obj.T_tool_object
    arm = meet.human.arm("right")
    shoulder = meet.human.T_world_shoulder("right")[:3, 3]
    gaps = []
    for grasp in meet.grasps:
        hands = T @ grasp
        wrist = hands[:, :3, 3] - arm.lengths[2] * hands[:, :3, 2]
        gaps.append(np.linalg.norm(wrist - shoulder, axis=1).min())
    return max(0.0, min(gaps) - arm.lengths[:2].sum())


def test_the_other_hand_is_expected_as_by_a_new_workspace(meet_of, rng):
    human = person(0.9).with_arm("left", np.radians([60, 10, 0, 90, 0, 0, 0]))
    meet = meet_of(human, T_world_base=np.eye(4))
    for side in ("left", "right"):
        meet.best(10)
        meet.expect(side)
        new = meet_of(human, side=side, T_world_base=np.eye(4))
        assert (new.build() > 0.0).any()
        assert np.allclose(meet.build(), new.build(), atol=2e-9)
        assert answer(meet.best(10))[0] == answer(new.best(10))[0]


def test_a_person_out_of_reach_is_told_how_far(meet_of, robot_map):
    human = Human(1.75).placed(4.0, 0.0, np.pi)
    meet = meet_of(human, grasps=1)
    assert len(meet) == 0 and meet.best(10) == []
    arm, shoulder = human.arm("right"), human.T_world_shoulder("right")[:3, 3]
    T = BASE @ meet.grid.centers(meet.keys) @ meet.obj.T_tool_object
    T = T @ meet.grasps[0]
    wrist = T[:, :3, 3] - arm.lengths[2] * T[:, :3, 2]
    gap = np.linalg.norm(wrist - shoulder, axis=1).min() - arm.lengths[:2].sum()
    assert meet.missing_m == pytest.approx(gap, abs=1e-5) and gap > 1.0
    # that much nearer along the shortest way, lengths no longer stand in the way
    near = wrist[np.linalg.norm(wrist - shoulder, axis=1).argmin()] - shoulder
    T_pelvis = human.T_world_pelvis.copy()
    T_pelvis[:3, 3] += (gap + 1e-4) * near / np.linalg.norm(near)
    meet.update(human.moved(T_pelvis))
    assert meet.missing_m == 0.0
    nobody = meet_of(human, constraints=[Above(50.0)])
    assert len(nobody) == 0 and nobody.best() == [] and nobody.missing_m == np.inf


class Few:
    """Allows a few poses, here and there."""

    def allows(self, T_world_object, obj):
        n = len(T_world_object)
        return np.random.default_rng(n).random(n) < 0.02


def test_how_far_is_found_without_looking_at_all_cells(meet_of, rng):
    meet = meet_of(Human(1.75), grasps=4, constraints=(Few(),))
    missing = []
    for _ in range(40):
        x, y, yaw = rng.uniform([-2.5, -2.5, -np.pi], [2.5, 2.5, np.pi])
        meet.update(Human(1.75).placed(x, y, yaw))
        missing.append(meet.missing_m)
        assert missing[-1] == pytest.approx(_missing(meet), abs=2e-6)
    assert min(missing) == 0.0 and max(missing) > 1.0


def test_constraints_are_those_of_the_object(meet_of, rng):
    human = somebody(rng, 0.7)
    free = meet_of(human)
    for constraint in (
        Upright(1.0, axis=(1, 0, 0), up=(0, 0, -1)),
        Above(0.9),
        Inside((-5, -5, 0.8), (5, 5, 1.2)),
        Inside((-5, -5, 0.8), (5, 5, 1.2), outside=True),
    ):
        meet = meet_of(human, constraints=[constraint])
        T = BASE @ free.grid.centers(free.keys) @ free.obj.T_tool_object
        wanted = []
        for pose in T:
            if isinstance(constraint, Upright):
                wanted.append(-pose[2, 0] >= np.cos(1.0))
            elif isinstance(constraint, Above):
                low = min(
                    min((pose[:3, :3] @ end + pose[:3, 3])[2] for end in (a, b))
                    - rod[6]
                    for rod in free.obj.capsules
                    for a, b in [(rod[:3], rod[3:6])]
                )
                wanted.append(low >= 0.9)
            else:
                wanted.append((0.8 <= pose[2, 3] <= 1.2) != constraint.outside)
        assert np.array_equal(meet.keys, free.keys[wanted])
        kept = np.isin(free.keys, meet.keys)
        assert 0 < kept.sum() < len(kept)
        assert np.array_equal(meet.build(), free.build()[kept])


STANDS = {
    "plane": {"type": "plane", "normal": [0.0, 0.6, 0.8], "offset": 0.1},
    "box": {"type": "box", "size": [0.5, 0.9, 0.6], "position": [0.4, 0.1, 0.2],
            "rpy": [0.3, 0.2, 0.1]},
    "board": {"type": "box", "size": [0.02, 0.9, 0.6], "position": [0.4, 0.1, 0.2],
              "rpy": [0.3, 0.2, 0.1]},
}  # fmt: skip


def off_of(table, p):
    """Return how far points (..., 3) are from a plane or a box of a recipe [m]."""
    if table["type"] == "plane":
        return p @ table["normal"] - table["offset"]
    turn = pose_of((0, 0, 0), table["rpy"])[:3, :3]
    out = np.abs((p - table["position"]) @ turn) - 0.5 * np.array(table["size"])
    return np.linalg.norm(np.maximum(out, 0.0), axis=-1)


def gaps_along(table, a, b, radius, n=200):
    """Return how far rods from a to b (..., 3) are from it, by places on their axis.

    Between two places the axis is nearer by half of their distance at most.
    """
    shares = np.linspace(0.0, 1.0, n).reshape(-1, *np.ones(a.ndim, int))
    parts = np.array_split(shares, 1 + n * a.size // 100_000)  # many places at once
    off = np.min([off_of(table, a + s * (b - a)).min(axis=0) for s in parts], axis=0)
    return off - radius, 0.5 * np.linalg.norm(b - a, axis=-1) / (n - 1)


@pytest.mark.parametrize("kind", STANDS)
def test_what_stands_still_is_no_place_to_hand_over_in(meet_of, rng, kind):
    scenery = parse_scenery((STANDS[kind],))
    human = somebody(rng, 0.7)
    free, meet = meet_of(human), meet_of(human, constraints=[ClearOf(scenery, BASE)])
    T, rods = free.grid.centers(free.keys) @ free.obj.T_tool_object, free.obj.capsules
    clear, sure, ends_clear = (np.ones(len(T), bool) for _ in range(3))
    for rod in rods:
        a, b = ((T[:, :3, :3] @ end) + T[:, :3, 3] for end in (rod[:3], rod[3:6]))
        gap, off = gaps_along(STANDS[kind], a, b, rod[6])
        clear &= gap > 0.0
        sure &= (gap <= 0.0) | (gap > off)
        for end in (a, b):
            ends_clear &= off_of(STANDS[kind], end) > rod[6]
    assert 0 < clear.sum() < len(clear) and sure.mean() > 0.99
    kept = np.isin(free.keys, meet.keys)
    assert np.array_equal(kept[sure], clear[sure])
    through = ends_clear & ~clear & sure  # with an end on either side
    assert kind != "board" or through.sum() > 0.1 * (~clear).sum()


@pytest.mark.parametrize("kind", STANDS)
def test_nobody_takes_an_object_with_an_arm_in_what_stands_still(meet_of, rng, kind):
    human, table = person(0.8), STANDS[kind]
    meet = meet_of(human, constraints=[ClearOf(parse_scenery((table,)), BASE)])
    ranked = meet.best(300)
    kept = meet.takeable(ranked)
    assert [t.key for t in kept] == [t.key for t in ranked if t in kept]
    if kind == "plane":  # who stands beside a table has its half-space about them
        assert kept == ranked
        assert [t.key for t in meet.best_takeable(5)] == [t.key for t in ranked[:5]]
        return
    checked = 0
    for target in ranked:
        bent = human.with_arm("right", target.arm_q)
        rows = bent.capsules()[np.isin(bent.labels, ARM_LABELS["right"][:2])]
        rows = moved_rods(rows, np.linalg.inv(BASE))
        gap, off = gaps_along(table, rows[:, :3], rows[:, 3:6], 0.0)  # their axes
        if (gap <= 0.0).any() or (gap > off).all():
            assert (target in kept) == (gap > 0.0).all()
            checked += 1
    assert 0 < len(kept) < len(ranked) and checked > 0.9 * len(ranked)
    assert meet_of(human).takeable(ranked) == ranked  # nothing stands about
    few = meet.best_takeable(5)  # among as many as it takes to find them
    assert [t.key for t in few] == [t.key for t in kept[:5]]
    assert len(meet.best_takeable(100_000)) < len(meet.best(100_000))


@pytest.mark.parametrize("kind", ["box", "board"])
def test_where_everything_is_blocked_nothing_is_left_to_the_next_that_is_asked(
    meet_of, kind
):
    around = {"type": "box", "size": [9.0, 9.0, 9.0], "position": [0.0, 0.0, 0.0]}
    every, one = (ClearOf(parse_scenery((t,)), BASE) for t in (around, STANDS[kind]))
    for constraints, scene in (([one], every), ([ClearOf(one.scenery)], every)):
        meet = meet_of(person(0.8), constraints=constraints)
        ranked = meet.best(100)
        assert ranked and meet.takeable(ranked, scene) == []
        assert meet.takeable([], scene) == []
    bare = meet_of(person(0.8)).best(100)
    assert meet_of(person(0.8), constraints=[every, one]).takeable(bare) == []


def test_the_cells_of_a_map_are_found_once_while_it_is_in_memory(robot_map):
    known = robot_cells(robot_map, 0.3, 72, 0.25)
    assert robot_cells(robot_map, 0.3, 72, 0.25) is known
    assert robot_cells(robot_map, 0.3, 72, 0.0) is not known
    copy = replace(robot_map)
    assert robot_cells(copy, 0.3, 72, 0.25) is not known
    there = weakref.ref(copy)
    del copy
    gc.collect()
    assert there() is None  # nothing keeps a map that nobody uses


def test_coarse_cells_hold_their_share_of_fine_ones(robot_map):
    fine = robot_map.grid
    poses = fine.centers(robot_map.marked_cells())
    for share in (0.0, 0.5):
        coarse = robot_cells(robot_map, 0.3, 72, share)
        p = np.floor(poses[:, :3, 3] / 0.3 + 1e-6)
        counted: dict = {}
        for place, cell in zip(p, robot_map.marked_cells() % 72, strict=True):
            at = (*place, cell)
            counted[at] = counted.get(at, 0) + 1
        wanted = {at for at, n in counted.items() if n > share * 27}
        centers = coarse.grid.centers(coarse.keys())
        at = np.floor(centers[:, :3, 3] / 0.3)
        got = {(*a, r) for a, r in zip(at, coarse.rotation, strict=True)}
        assert got == wanted
    same = robot_cells(robot_map, 0.1, 72)
    assert len(same) == robot_map.n_marked
    assert np.allclose(
        same.grid.centers(same.keys()), fine.centers(robot_map.marked_cells())
    )


def test_tools_of_our_own_are_whole():
    for obj in (wrench(), mallet()):
        assert len(obj.hand_grasps) >= 12
        for T in obj.hand_grasps:
            assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
            # a fist round the handle: the handle's axis is the hand's y, in its grip
            assert abs(T[0, 1]) == pytest.approx(1.0) and np.allclose(T[1:3, 3], 0)
            rod = obj.capsules[0]
            assert rod[0] <= T[0, 3] <= rod[3]
        turns = {tuple(T[:3, :3].round(6).ravel()) for T in obj.hand_grasps}
        assert len(turns) == len(obj.hand_grasps)
