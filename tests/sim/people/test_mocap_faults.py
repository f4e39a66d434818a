import numpy as np
import pytest

from sim.people.mocap.faults import fastest, find_faults, first_frame

HAND = fastest("right_hand")


def wave(rate=100.0, seconds=4.0, amplitude=0.4, hz=0.8):
    """Return a hand that swings at 2 m/s at its fastest, (F, 3) [m]."""
    t = np.arange(int(seconds * rate)) / rate
    zero = np.zeros_like(t)
    return np.c_[amplitude * np.sin(2 * np.pi * hz * t), 0.1 * np.cos(3 * t), zero]


def bad_frames(place, rate=100.0, limit=HAND):
    return find_faults(place, rate, limit).bad.nonzero()[0].tolist()


@pytest.mark.parametrize("rate", [25.0, 30.0, 60.0, 100.0, 120.0])
def test_a_motion_without_faults_is_believed(rate):
    assert bad_frames(wave(rate), rate) == []


def test_a_hand_stopped_by_an_impact_is_believed():
    t = np.arange(200) / 100
    hammer = np.c_[np.minimum(3.5 * t, 2.8), 0 * t, 0 * t]  # 3.5 m/s to rest at once
    assert bad_frames(hammer) == []


@pytest.mark.parametrize("rate", [30.0, 100.0, 120.0])
@pytest.mark.parametrize("shift", [0.7, 3.0])
def test_one_frame_elsewhere_is_dropped(rate, shift):
    hand = wave(rate)
    hand[50] += [0, shift, 0]
    assert bad_frames(hand, rate) == [50]
    assert find_faults(hand, rate, HAND).peak > HAND


def test_a_swapped_marker_that_comes_back_is_dropped_as_a_whole():
    hand = wave()
    hand[100:112] += [0.0, 0.06, 0.0]  # 6 cm in one frame: 6 m/s, under the limit
    assert bad_frames(hand) == list(range(100, 112))


def test_a_jump_next_to_a_gap_is_dropped():
    hand = wave()
    hand[100:103] += [0, 0, 0.3]
    hand[103:107] = np.nan
    assert bad_frames(hand) == [100, 101, 102]


def test_a_jump_that_stays_is_believed_after_a_while_on_both_sides():
    hand = wave()
    hand[200:] += [0, 0.4, 0]  # 40 m/s
    bad = bad_frames(hand)
    # crossed at 2 m/s: 0.2 s around the jump, the rest of both sides stays
    assert set(bad) < set(range(185, 216)) and 15 <= len(bad) <= 24
    hand[bad] = np.nan
    seen = np.isfinite(hand[:, 0]).nonzero()[0]
    steps = np.diff(hand[seen], axis=0) / (np.diff(seen) / 100)[:, None]
    assert np.linalg.norm(steps, axis=1).max() < 4.5


def test_many_jumps_are_all_found():
    hand, rng = wave(seconds=10), np.random.default_rng(3)
    wrong = rng.choice(np.arange(5, 990, 7), 40, replace=False)
    hand[wrong] += rng.choice([-1, 1], (40, 3)) * rng.uniform(0.2, 1.0, (40, 3))
    assert bad_frames(hand) == sorted(wrong.tolist())


def test_sensor_noise_is_no_fault():
    noise = np.random.default_rng(0).normal(scale=0.002, size=(400, 3))
    assert bad_frames(wave() + noise) == []


def test_pure_noise_is_counted_but_no_frame_is_better_than_another():
    noise = np.random.default_rng(0).normal(scale=0.5, size=(400, 3))
    fault = find_faults(noise, 100.0, HAND)
    assert fault.jumps > 300 and not fault.bad.any()


def test_a_swing_counts_three_impossible_steps_in_a_row():
    hand = wave()
    hand[100:] += [0, 1.0, 0]
    hand[100:110, 1] -= np.linspace(0.9, 0, 10)  # 10 m/s over ten frames
    assert find_faults(hand, 100.0, HAND).swings == 1
    assert find_faults(wave(), 100.0, HAND).swings == 0
    hand = wave()
    hand[100:104] += np.array([[0, 1, 0], [0, -1, 0], [0, 1, 0], [0, -1, 0]])
    assert find_faults(hand, 100.0, HAND).swings == 0  # fast, but to and fro: a fault


def test_the_trunk_is_slower_than_the_hand():
    assert fastest("hip") < fastest("left_elbow") < fastest("left_hand")
    assert fastest("right_shoulder") == fastest("neck")


def test_a_t_pose_at_the_start_is_skipped_with_the_way_out_of_it():
    hand = np.r_[np.zeros((1, 3)), wave() + [0.6, 0, 0]]
    hand[1:5] -= np.linspace(0.5, 0.1, 4)[:, None] * [1, 0, 0]
    start = first_frame({"right_hand": hand, "hip": 0 * hand}, 100.0)
    assert 5 <= start <= 15
    assert first_frame({"right_hand": wave()}, 100.0) == 0


def test_a_jump_in_the_middle_does_not_move_the_start():
    hand = wave()
    hand[200] += 1.0
    assert first_frame({"right_hand": hand}, 100.0) == 0


def test_a_track_seen_once_or_never_has_no_faults():
    hand = np.full((50, 3), np.nan)
    assert bad_frames(hand) == []
    hand[7] = 0
    assert bad_frames(hand) == []
