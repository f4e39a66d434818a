"""Parts that a tracker shows no more are kept for a while, where they were."""

import re

import numpy as np
import pytest

from odm.execution import MissingParts
from roadmap.errors import BadInput

HAND, FOREARM, TRUNK = 3, 4, 7


def rods(*x):
    """Return a capsule (k, 7) along z at each x [m]."""
    return np.array([[a, 0.0, 0.0, a, 0.0, 0.2, 0.05] for a in x]).reshape(-1, 7)


def complete(parts, x, names, now):
    """Return all capsules, their names, and how much wider each may be [m]."""
    told = parts.complete(rods(*x), np.array(names, int), now)
    rows, names, may_be, missing, _ = told
    wider = may_be - rows
    assert not wider[:, :6].any()
    assert (wider[:, 6] > 0.0).tolist() == (
        [False] * len(rows) if missing is None else missing.tolist()
    )
    return rows, names, None if missing is None else wider[:, 6]


def test_all_that_are_seen_are_told_as_they_are():
    parts = MissingParts(1.0, 2.0)
    for now in (0.0, 0.01, 0.5, 9.0):
        given = rods(now, 1.0), np.array([HAND, FOREARM])
        rows, names, may_be, missing, _ = parts.complete(*given, now)
        assert np.array_equal(rows, given[0]) and np.array_equal(names, given[1])
        assert missing is None and may_be is rows and names.dtype == given[1].dtype


def test_a_part_that_is_not_seen_stays_and_may_have_come_nearer():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0, 2.0), (HAND, FOREARM, TRUNK), 0.0)
    for now in (0.1, 0.5, 0.99):
        rows, names, grown = complete(parts, (1.1, 2.2), (FOREARM, TRUNK), now)
        assert names.tolist() == [HAND, FOREARM, TRUNK]  # in their order
        assert np.array_equal(rows, rods(0.0, 1.1, 2.2))
        assert np.allclose(grown, [2.0 * now, 0.0, 0.0])
    rows, names, grown = complete(parts, (1.1, 2.2), (FOREARM, TRUNK), 1.01)
    assert names.tolist() == [FOREARM, TRUNK] and grown is None


def test_what_a_loop_writes_into_its_arrays_afterwards_does_not_count():
    parts, rows, names = MissingParts(1.0, 2.0), rods(0.0, 1.0), np.array([3, 4])
    for now in (0.0, 0.1):
        parts.complete(rows, names, now)
    rows[:], names[:] = 9.0, FOREARM
    kept, told, *_ = parts.complete(rods(1.0), np.array([FOREARM]), 0.2)
    assert np.array_equal(kept, rods(0.0, 1.0)) and told.tolist() == [HAND, FOREARM]


def test_a_part_that_is_seen_again_is_where_it_is_seen():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0), (HAND, FOREARM), 0.0)
    complete(parts, (1.0,), (FOREARM,), 0.5)
    rows, names, grown = complete(parts, (0.3, 1.0), (HAND, FOREARM), 0.9)
    assert np.array_equal(rows, rods(0.3, 1.0)) and grown is None
    grown = complete(parts, (1.0,), (FOREARM,), 1.8)[2]
    assert np.allclose(grown, [1.8, 0.0])  # its second counts from there


def test_everybody_may_be_missing():
    parts = MissingParts(1.0, 2.0)
    assert complete(parts, (), (), 0.0)[2] is None
    complete(parts, (0.0, 1.0), (HAND, FOREARM), 0.1)
    rows, names, grown = complete(parts, (), (), 0.6)
    assert np.array_equal(rows, rods(0.0, 1.0)) and np.allclose(grown, 1.0)
    assert len(complete(parts, (), (), 1.2)[0]) == 0


def test_of_two_people_the_one_who_is_not_seen_is_missing():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0, 5.0, 6.0), (HAND, TRUNK, HAND, TRUNK), 0.0)
    rows, names, grown = complete(parts, (5.1, 6.1), (HAND, TRUNK), 0.1)
    assert names.tolist() == [HAND, TRUNK, HAND, TRUNK]
    assert np.array_equal(rows, rods(0.0, 1.0, 5.1, 6.1))
    assert np.allclose(grown, [0.2, 0.2, 0.0, 0.0])


def test_other_names_and_another_order_make_nobody_missing():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0), (HAND, FOREARM), 0.0)
    rows, names, grown = complete(parts, (1.0, 0.0), (FOREARM, HAND), 0.1)
    assert np.array_equal(rows, rods(0.0, 1.0)) and grown is None
    rows, names, grown = complete(parts, (1.0, 0.0), (-1, -1), 0.2)
    assert np.array_equal(rows, rods(0.0, 1.0)) and grown is None
    assert names.tolist() == [-1, -1]
    rows, names, grown = complete(parts, (0.0, 1.0, 8.0), (-1, -1, TRUNK), 0.3)
    assert np.array_equal(rows, rods(0.0, 1.0, 8.0)) and grown is None


def test_a_hand_that_is_lost_is_not_its_forearm():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 0.1), (HAND, FOREARM), 0.0)
    rows, names, grown = complete(parts, (0.02,), (FOREARM,), 0.1)
    assert np.array_equal(rows, rods(0.0, 0.02)) and np.allclose(grown, [0.2, 0.0])


def test_none_is_kept_for_no_time_and_a_clock_set_back_makes_none_older():
    parts = MissingParts(0.0, 2.0)
    complete(parts, (0.0,), (HAND,), 0.0)
    assert len(complete(parts, (), (), 0.01)[0]) == 0
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0,), (HAND,), 10.0)
    complete(parts, (0.0,), (HAND,), 2.0)
    for now, far in ((2.001, 0.002), (2.9, 1.8)):
        grown = complete(parts, (), (), now)[2]
        assert np.allclose(grown, far)
    assert len(complete(parts, (), (), 3.1)[0]) == 0


def test_a_clock_that_was_set_back_while_a_part_is_missing_begins_its_time_anew():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0,), (HAND,), 10.0)
    rows, _, may_be, missing, _ = parts.complete(rods(), np.zeros(0, int), 3.0)
    assert len(rows) == 1 and missing.all() and np.array_equal(may_be, rows)
    assert len(complete(parts, (), (), 3.9)[0]) == 1
    assert len(complete(parts, (), (), 4.1)[0]) == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_frame_that_is_not_finite_is_told_as_it_is(bad):
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0), (HAND, FOREARM), 0.0)
    rows = np.full((1, 7), bad)
    told = parts.complete(rows, np.array([FOREARM]), 0.1)
    assert told.capsules is rows and told.may_be is rows and told.missing is None
    told = parts.complete(rods(1.0), np.array([FOREARM]), bad)
    assert len(told.capsules) == 1 and told.missing is None
    assert len(complete(parts, (1.0,), (FOREARM,), 0.2)[0]) == 2  # still missing


def test_what_is_no_list_of_parts_is_refused():
    parts = MissingParts()
    with pytest.raises(BadInput, match=r"shape \(2, 6\) and 2 names; give \(k, 7\)"):
        parts.complete(np.zeros((2, 6)), np.zeros(2), 0.0)
    with pytest.raises(BadInput, match=r"and 1 names; give \(k, 7\)"):
        parts.complete(np.zeros((2, 7)), np.zeros(1), 0.0)
    for wrong, told in (
        ((-1.0, 2.0), r"kept_s \[s\] is -1.0, but must be a number from 0"),
        ((1.0, np.nan), r"speed \[m/s\] is nan"),
        ((np.inf, 2.0), r"kept_s \[s\] is inf"),
        ((1.0, 2.0, -0.1), r"noise \[m\] is -0.1"),
    ):
        with pytest.raises(BadInput, match=told):
            MissingParts(*wrong)


def test_a_part_that_jumps_may_be_where_it_was_too():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0), (HAND, TRUNK), 0.0)
    assert complete(parts, (0.115, 1.0), (HAND, TRUNK), 0.01)[2] is None  # 2 cm, 10 cm
    rows, names, wider = complete(parts, (0.6, 1.0), (HAND, TRUNK), 0.02)
    assert np.array_equal(rows, rods(0.115, 1.0, 0.6))
    assert names.tolist() == [HAND, TRUNK, HAND] and np.allclose(wider, [0.02, 0, 0])
    # it goes on there, and comes back: where it was in between is kept, too
    rows, _, wider = complete(parts, (0.61, 1.0), (HAND, TRUNK), 0.03)
    assert np.array_equal(rows, rods(0.115, 1.0, 0.61))
    rows, _, wider = complete(parts, (0.12, 1.0), (HAND, TRUNK), 0.04)
    assert np.array_equal(rows, rods(0.12, 1.0, 0.61))
    assert np.allclose(wider, [0.0, 0.0, 0.02])
    assert complete(parts, (0.12, 1.0), (HAND, TRUNK), 1.04)[2] is None


def test_a_noisy_part_has_not_jumped():
    parts = MissingParts(1.0, 2.0, noise=0.05)
    complete(parts, (0.0,), (HAND,), 0.0)
    assert complete(parts, (0.215,), (HAND,), 0.01)[2] is None
    assert len(complete(parts, (0.445,), (HAND,), 0.02)[0]) == 2


def test_hands_that_exchange_their_names_have_not_jumped():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0, 1.0), (HAND, FOREARM), 0.0)
    rows, names, grown = complete(parts, (1.01, 0.01), (HAND, FOREARM), 0.01)
    assert grown is None and np.array_equal(rows, rods(0.01, 1.01))
    assert names.tolist() == [FOREARM, HAND]


def test_parts_that_jump_all_the_time_are_nowhere():
    parts = MissingParts(1.0, 2.0, most=5)
    for k in range(5):
        assert np.isfinite(complete(parts, (k, 9.0), (HAND, TRUNK), 0.01 * k)[0]).all()
        assert len(complete(parts, (k, 9.0), (HAND, TRUNK), 0.01 * k)[0]) == 2 + k
    rows = np.array(rods(5.0, 9.0))
    complete(parts, (5.0, 9.0), (HAND, TRUNK), 0.05)
    told = parts.complete(rods(6.0, 9.0), np.array([HAND, TRUNK]), 0.06)
    assert np.isnan(told.capsules).all() and len(told.capsules) > len(rows)


def test_what_is_found_is_remembered_once_it_is_kept():
    parts = MissingParts(1.0, 2.0)
    complete(parts, (0.0,), (HAND,), 0.0)
    found = parts.find(rods(3.0), np.array([HAND]), 0.01)
    assert found.missing.tolist() == [True, False]
    assert parts.find(rods(0.0), np.array([HAND]), 0.02).missing is None
    parts.keep(found)
    assert parts.find(rods(3.0), np.array([HAND]), 0.02).missing.tolist() == [1, 0]


def test_lists_and_words_are_names_too():
    """They were taken in the first frame, and ended the loop when somebody was lost."""
    told = [[1.0, 0, 0, 1.2, 0, 0, 0.05], [2.0, 0, 0, 2.2, 0, 0, 0.1]]
    by_number, by_word = MissingParts(1.0, 2.0), MissingParts(1.0, 2.0)
    for rows, numbers, words in (
        (told, [HAND, TRUNK], ["hand", "torso"]),
        (told[1:], [TRUNK], ["torso"]),
    ):
        now = 0.1 * (2 - len(rows))
        one, other = (
            parts.complete(rows, names, now)
            for parts, names in ((by_number, numbers), (by_word, words))
        )
        assert np.array_equal(one.may_be, other.may_be)
        assert one.names.tolist() == [HAND, TRUNK]
        assert other.names.tolist() == ["hand", "torso"]
    assert other.missing.tolist() == [True, False]
    # a tracker that begins to number what it named loses nobody
    mixed = by_word.complete(told[1:], [TRUNK], 0.2)
    assert len(mixed.capsules) == 2 and mixed.missing.sum() == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((np.zeros((1, 7)), [[1]], 0.0), "names are [[1]]; give a list with a whole"),
        ((np.zeros((1, 7)), [object()], 0.0), "names are [<object"),
        ((np.zeros((1, 7)), 3, 0.0), "names are 3; give a list"),
        ((np.zeros((1, 7)), [1], None), "now is None"),
        (("hand", [1], 0.0), "the person's capsules must be an array of real"),
        ((np.zeros(7), [1], 0.0), "capsules of shape (7,) and 1 names"),
    ],
)
def test_what_is_no_frame_of_parts_is_told(words, told):
    with pytest.raises(BadInput, match=re.escape(told)):
        MissingParts(1.0, 2.0).complete(*words)
