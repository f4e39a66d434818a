"""Which targets are offered: nothing changes but by a margin, and nothing is stuck."""

from dataclasses import replace

import pytest
from rows import each

from handover.targets.settings import ChoiceSettings
from handover.targets.target_choice import TargetChoice
from handover.targets.target_offers import Offer
from roadmap.errors import BadInput

SETTINGS = ChoiceSettings(
    quality_hysteresis=0.05,
    max_quality_loss=0.2,
    goals=3,
    max_untried=2,
    untried_frames=10,
    retry_frames=50,
    fallbacks=1,
)


def made(key):
    return Offer.MADE


def coming(key):
    return Offer.COMING


def anything(key):
    return True


def nothing(key):
    return False


def decide(choice, ranked, pursued=None, offer=made, is_cheap=nothing):
    ranked = sorted(ranked.items(), key=lambda item: (-item[1], item[0]))
    worth = {key: quality for key, quality in ranked if key in choice.keys}
    return choice.decide(ranked, worth, pursued, offer, is_cheap)


@pytest.fixture
def pursuing():
    """A choice that pursues target 1 of quality 0.5."""
    choice = TargetChoice(SETTINGS)
    decide(choice, {1: 0.5, 2: 0.45})
    assert choice.keys == (1,)
    return choice


def test_the_best_target_is_offered_first():
    assert decide(TargetChoice(SETTINGS), {7: 0.4, 3: 0.6, 5: 0.6}) == (3,)


def test_a_better_one_within_the_margin_changes_nothing(pursuing):
    for _ in range(100):
        assert decide(pursuing, {1: 0.5, 2: 0.549}, pursued=1) == (1,)


def test_one_better_by_the_margin_goes_before_the_pursued_which_stays(pursuing):
    for _ in range(SETTINGS.untried_frames + 1):
        keys = decide(pursuing, {1: 0.5, 2: 0.56}, pursued=1)
    assert keys == (2, 1)


def test_the_pursued_keeps_its_lead_after_the_change(pursuing):
    for _ in range(SETTINGS.untried_frames + 1):
        decide(pursuing, {1: 0.5, 2: 0.56}, pursued=1)
    for quality in (0.51, 0.56, 0.6):  # a hand that trembles
        assert decide(pursuing, {1: quality, 2: 0.56}, pursued=2)[0] == 2


def test_a_pursued_target_that_is_none_any_more_is_dropped_at_once(pursuing):
    assert decide(pursuing, {2: 0.45}, pursued=1) == (2,)


def test_one_put_off_makes_room_for_others_and_comes_again(pursuing):
    pursuing.put_off(1)
    assert decide(pursuing, {1: 0.5, 2: 0.45}, pursued=None) == (2,)
    seen = []
    for _ in range(SETTINGS.retry_frames + SETTINGS.untried_frames):
        keys = decide(pursuing, {1: 0.5, 2: 0.45}, 2, is_cheap=anything)
        seen.append(1 in keys)
    assert not any(seen[: SETTINGS.retry_frames - 1])  # no spare, either
    assert seen[-1]


def test_without_any_target_nothing_is_offered(pursuing):
    assert decide(pursuing, {}, pursued=1) == ()


def test_one_that_is_never_reached_makes_room_for_the_next_and_comes_again():
    choice, offered = TargetChoice(SETTINGS), []
    ranked = {1: 0.5, 2: 0.9, 3: 0.85, 4: 0.8, 5: 0.75}
    for _ in range(6 * SETTINGS.untried_frames + SETTINGS.retry_frames):
        offered += [k for k in decide(choice, ranked, pursued=1)]
    first = {key: offered.index(key) for key in (2, 3, 4, 5)}
    assert first[2] < first[3] < first[4] < first[5]  # all had their turn, best first
    away = [k for k, key in enumerate(offered) if key == 2]
    assert any(
        b - a > SETTINGS.retry_frames for a, b in zip(away, away[1:], strict=False)
    )


def test_standing_it_tries_all_that_fit_and_then_the_others():
    choice, seen = TargetChoice(SETTINGS), set()
    ranked = {key: 0.9 - 0.01 * key for key in range(8)}
    for _ in range(60):
        keys = decide(choice, ranked)
        assert len(keys) <= SETTINGS.goals
        seen |= set(keys)
    assert seen == set(ranked)


def test_what_has_no_configuration_yet_is_not_offered(pursuing):
    ranked = {1: 0.5, 2: 0.9}
    for _ in range(SETTINGS.untried_frames + 1):
        assert decide(pursuing, ranked, pursued=1, offer=coming) == (1,)


def test_what_is_blocked_now_does_not_keep_the_next_from_its_turn(pursuing):
    ranked, asked = {1: 0.5, 2: 0.9, 3: 0.8, 4: 0.7}, []

    def offer(key):
        asked.append(key)
        return {2: Offer.NOT_NOW, 3: Offer.COMING, 4: Offer.MADE}[key]

    assert decide(pursuing, ranked, pursued=1, offer=offer) == (4, 1)
    assert asked == [2, 3, 4]


def test_one_that_was_reached_may_come_again_at_once():
    choice = TargetChoice(SETTINGS)
    decide(choice, {1: 0.5})
    decide(choice, {1: 0.5, 2: 0.9}, pursued=1)
    decide(choice, {1: 0.5, 2: 0.9}, pursued=2)  # reached, then blocked
    ranked = {1: 0.5, 2: 0.9, 3: 0.85, 4: 0.8}
    offered = []
    for _ in range(SETTINGS.retry_frames - 2):
        offered.append(decide(choice, ranked, pursued=1))
    left = next(k for k, keys in enumerate(offered) if 2 not in keys)
    assert any(2 in keys for keys in offered[left:])
    assert any(3 in keys for keys in offered)
    # 3 was offered, too, and never reached: it waits
    gone = [3 in keys for keys in offered]
    assert True not in gone[len(gone) - gone[::-1].index(True) :]


def test_spares_are_cheap_and_not_much_worse(pursuing):
    ranked = {1: 0.5, 2: 0.45, 3: 0.1}
    for _ in range(3 * SETTINGS.untried_frames):
        keys = decide(pursuing, ranked, pursued=1, is_cheap=anything)
    assert keys == (1, 2)
    # the person came nearer: what is far below the best now is no spare any more
    keys = decide(pursuing, {1: 0.5, 2: 0.25}, pursued=1)
    assert keys == (1,)


def test_the_same_input_gives_the_same_offers():
    runs = []
    for _ in range(2):
        choice = TargetChoice(SETTINGS)
        runs.append(
            [
                decide(choice, {k: (k * 37 + t * 11) % 100 / 100 for k in range(9)}, 4)
                for t in range(200)
            ]
        )
    assert runs[0] == runs[1]


@each(
    ("wrong", "words"),
    [
        ({"quality_hysteresis": -0.1}, "quality_hysteresis"),
        ({"quality_hysteresis": float("nan")}, "quality_hysteresis"),
        ({"max_quality_loss": 0.01}, "max_quality_loss"),
        ({"goals": 0}, "goals"),
        ({"untried_frames": 0}, "untried_frames"),
        ({"untried_frames": 1.5}, "untried_frames"),
        ({"fallbacks": 4}, "fallbacks"),
        ({"max_untried": 9}, "max_untried"),
    ],
)
def test_settings_that_are_none_are_refused(wrong, words):
    with pytest.raises(BadInput, match=words):
        ChoiceSettings(**wrong)


def test_a_blocked_target_is_waited_for_before_worse_ones_are_offered():
    choice = TargetChoice(replace(SETTINGS, patience_frames=5))
    ranked = {1: 0.5, 2: 0.45}
    decide(choice, ranked)
    for _ in range(20):  # worse ones are no spares
        assert decide(choice, ranked, pursued=1, is_cheap=anything) == (1,)
    for _ in range(5):
        assert decide(choice, ranked) == (1,)
    assert decide(choice, ranked) == (1, 2)


def test_a_better_one_is_not_waited_with():
    choice = TargetChoice(replace(SETTINGS, patience_frames=5))
    decide(choice, {1: 0.5})
    decide(choice, {1: 0.5}, pursued=1)
    assert decide(choice, {1: 0.5, 2: 0.6}) == (2, 1)


def test_one_that_was_put_off_is_not_waited_for():
    choice = TargetChoice(replace(SETTINGS, patience_frames=50))
    decide(choice, {1: 0.5, 2: 0.45})
    decide(choice, {1: 0.5, 2: 0.45}, pursued=1)
    choice.put_off(1)
    assert decide(choice, {1: 0.5, 2: 0.45}) == (2,)
