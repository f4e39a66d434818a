import numpy as np
import pytest
from mocap_files import person, write_bvh, write_csv

from handover.human.body import Part
from odm import sample_capsules
from roadmap.errors import BadInput
from sim.draw.human_picture import write_strip
from sim.people.mocap import BadMocap, MocapSettings, load_mocap

HAND = Part.RIGHT_HAND
LEGS = {Part.LEFT_LEG, Part.RIGHT_LEG}


def load(tmp_path, joints, **settings):
    path = write_csv(tmp_path / "clip.csv", joints)
    return load_mocap(path, settings=MocapSettings(**settings))


def hole(first, last, joint="right_hand", n_frames=300):
    joints = person(n_frames)
    joints[joint][first:last] = np.nan
    return joints


def hand_of(motion, t, grown=True):
    k = motion.labels.tolist().index(HAND)
    return (motion.capsules(t) if grown else motion.guess(t))[k]


def assert_never_faster_than_it_says(motion, run_s):
    dt = 0.3 / motion.rate_hz
    frames = np.array([motion.capsules(t) for t in np.arange(0, run_s, dt)])
    a = np.linalg.norm(np.diff(frames[:, :, :3], axis=0), axis=2)
    b = np.linalg.norm(np.diff(frames[:, :, 3:6], axis=0), axis=2)
    advance = np.maximum(a, b) + np.diff(frames[:, :, 6], axis=0)
    assert advance.max() <= motion.max_speed * dt * (1 + 1e-9) + 1e-12


def test_it_is_a_motion_of_labelled_closed_capsules(tmp_path):
    motion = load(tmp_path, person())
    assert motion.name == "clip.csv" and motion.rate_hz == 100
    assert motion.duration_s == pytest.approx(2.99)
    assert set(motion.labels) == set(Part) - LEGS
    for t in (0, 0.1234, 2.99, 17.0, 3600.0):
        capsules = motion.capsules(t)
        assert capsules.shape == (9, 7) and np.isfinite(capsules).all()
        assert len(sample_capsules(capsules))


def test_the_speed_of_a_clean_clip_is_the_persons(tmp_path):
    motion = load(tmp_path, person(swing=0.15, hz=0.5))
    hand = 0.15 * 2 * np.pi * 0.5
    assert hand * 0.98 < motion.max_speed < 1.6 * hand  # finger tips beyond the wrist
    assert_never_faster_than_it_says(motion, 7.0)


def test_between_frames_it_is_interpolated(tmp_path):
    motion = load(tmp_path, person())
    middle = (motion.capsules(0.50) + motion.capsules(0.51)) / 2
    np.testing.assert_allclose(motion.capsules(0.505), middle, atol=1e-12)


def test_the_same_file_gives_the_same_bytes(tmp_path):
    first, second = (load(tmp_path, hole(100, 130)) for _ in range(2))
    assert first.frames.tobytes() == second.frames.tobytes()


# gaps and faults


def test_a_short_gap_is_bridged(tmp_path):
    whole, holed = load(tmp_path, person()), load(tmp_path, hole(100, 110))
    for t in (1.0, 1.05, 1.09):
        assert holed.state(t).reason is None and holed.state(t).unseen == {}
        off = np.abs(holed.capsules(t) - whole.capsules(t))
        assert off.max() < 0.01


def test_in_a_longer_gap_the_part_stays_and_grows_and_says_so(tmp_path):
    motion = load(tmp_path, hole(100, 150))
    before, during = hand_of(motion, 0.99), hand_of(motion, 1.23)
    np.testing.assert_allclose(during[:3], before[:3], atol=0.003)
    assert during[6] == pytest.approx(before[6] + min(1.6 * 0.24, 0.3), abs=0.02)
    state = motion.state(1.23)
    assert state.reason == "right hand not seen for 0.24 s"
    assert state.unseen == {"right_hand": pytest.approx(0.24)}
    assert motion.state(0.99).reason is None and motion.state(1.5).reason is None
    assert hand_of(motion, 1.5)[6] == hand_of(motion, 0.5)[6] == 0.06
    assert hand_of(motion, 1.05)[6] < during[6] <= hand_of(motion, 1.45)[6]


def test_only_what_the_unseen_joint_places_is_grown(tmp_path):
    motion = load(tmp_path, hole(100, 150, "left_elbow"))
    grown = motion.capsules(1.3)[:, 6] > motion.guess(1.3)[:, 6]
    parts = {Part(label) for label in motion.labels[grown]}
    assert parts == {Part.LEFT_HAND, Part.LEFT_FOREARM, Part.LEFT_UPPER_ARM}


@pytest.mark.parametrize("gap", [(100, 115), (100, 150), (0, 60), (250, 300)])
def test_the_person_stays_inside_what_is_remembered(tmp_path, gap):
    whole, holed = load(tmp_path, person(hz=1.0)), load(tmp_path, hole_fast(*gap))
    for t in np.arange(gap[0], gap[1]) / 100:
        true, known = hand_of(whole, t), hand_of(holed, t)
        off = max(
            np.linalg.norm(true[:3] - known[:3]), np.linalg.norm(true[3:6] - known[3:6])
        )
        assert off + true[6] <= known[6] + 0.012, t


def hole_fast(first, last):
    joints = person(hz=1.0)
    joints["right_hand"][first:last] = np.nan
    return joints


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("gap", [(100, 112), (100, 180), (0, 40), (280, 300)])
def test_no_surface_is_faster_than_it_says_through_gaps(tmp_path, loop, gap):
    motion = load(tmp_path, hole_fast(*gap), loop=loop)
    assert_never_faster_than_it_says(motion, 7.0)
    assert motion.max_speed < 2.5


def test_it_is_back_far_away_after_a_gap_and_still_no_faster_than_it_says(tmp_path):
    joints = hole(100, 120)
    for place in joints.values():
        place[120:] += [0.0, 0.9, 0.0]
    joints["hip"][95:120] = np.nan
    assert_never_faster_than_it_says(load(tmp_path, joints), 7.0)


@pytest.mark.parametrize("frames", [1, 4, 30])
def test_a_jump_of_twenty_metres_a_second_is_a_fault_and_no_motion(tmp_path, frames):
    joints = person()
    joints["right_hand"][120 : 120 + frames] += [0.2, 0.0, 0.0]
    clean, motion = load(tmp_path, person()), load(tmp_path, joints)
    assert motion.max_speed <= 1.7
    assert any("right hand: 2 jumps of up to 20.0 m/s" in n for n in motion.notes)
    for t in np.arange(0, 3, 0.05):
        off = np.abs(motion.guess(t) - clean.guess(t)).max()
        assert off < (0.1 if frames > 4 else 0.01)
    if frames > 10:
        assert motion.state(1.3).reason == "right hand jumped, not believed for 0.11 s"


def test_a_person_who_is_tracked_elsewhere_from_then_on_is_followed(tmp_path):
    joints = person()
    for place in joints.values():
        place[150:] += [0.5, 0.0, 0.0]  # 50 m/s, and it stays
    motion = load(tmp_path, joints)
    assert_never_faster_than_it_says(motion, 7.0)
    assert motion.max_speed < 2.5
    moved = hand_of(motion, 2.9)[:2] - hand_of(motion, 0.9)[:2]
    assert np.linalg.norm(moved) == pytest.approx(0.5, abs=0.1)


def test_noise_of_the_tracker_is_no_speed(tmp_path):
    joints, rng = person(), np.random.default_rng(1)
    for place in joints.values():
        place += rng.normal(scale=0.002, size=place.shape)
    raw = load(tmp_path, joints, smooth_s=0.0)
    assert load(tmp_path, joints).max_speed < 0.65 * raw.max_speed


# the end of the clip


def test_a_loop_goes_to_and_fro_without_a_jump(tmp_path):
    motion = load(tmp_path, person())
    for t in (0.0, 0.7, 2.99):
        there = motion.capsules(t)
        np.testing.assert_allclose(motion.capsules(5.98 - t), there, atol=1e-9)
        np.testing.assert_allclose(motion.capsules(5.98 + t), there, atol=1e-9)
    assert motion.ending(60.0) == (
        "the clip clip.csv of 3.0 s is shorter than the run of 60.0 s and is played to "
        "and fro"
    )
    assert motion.ending(2.0) is None


def test_without_loop_the_person_stays_in_the_last_pose(tmp_path):
    motion = load(tmp_path, person(), loop=False)
    np.testing.assert_array_equal(motion.capsules(2.99), motion.capsules(99.0))
    assert "ends in its last pose" in motion.ending(60.0)


def test_a_part_not_seen_at_the_end_is_unseen_ever_after(tmp_path):
    motion = load(tmp_path, hole(260, 300), loop=False)
    assert motion.state(50.0).unseen["right_hand"] == pytest.approx(0.40)


@pytest.mark.parametrize("t", [-0.1, np.nan, np.inf])
def test_a_time_that_is_none_is_refused(tmp_path, t):
    motion = load(tmp_path, person(20))
    with pytest.raises(BadInput, match="give a time from 0 on"):
        motion.capsules(t)


# the place


def test_by_default_the_person_faces_the_robot_and_reaches_into_its_work_place(
    tmp_path,
):
    motion = load(tmp_path, person())
    hands = np.array([hand_of(motion, t)[:3] for t in np.arange(0, 3, 0.05)])
    assert np.linalg.norm(hands[:, :2] - [0.5, 0], axis=1).min() < 0.12
    hip = motion.capsules(1.0)[motion.labels == Part.TORSO][0, :3]
    assert 0.75 <= hip[0] < 1.1 and abs(hip[1]) < 0.4
    # floor 1.43 m under the shoulders, base 0.75 m above it
    assert hands[:, 2] == pytest.approx(1.15 - 0.75, abs=0.02)


@pytest.mark.parametrize("yaw", [0.0, 1.0, 2.5, -2.0])
def test_where_the_recording_stood_and_looked_does_not_matter(tmp_path, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    R, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), [3.0, -2.0, 0.0]
    turned = {name: place @ R.T + shift for name, place in person().items()}
    here, there = load(tmp_path, person()), load(tmp_path, turned)
    np.testing.assert_allclose(here.frames, there.frames, atol=0.003)


def test_a_place_can_be_given(tmp_path):
    motion = load(tmp_path, person(), stand=(0.2, 1.1, -np.pi / 2), base_height=0.9)
    hip = motion.capsules(1.0)[motion.labels == Part.TORSO][0, :3]
    np.testing.assert_allclose(hip[:2], [0.2, 1.1], atol=0.01)
    hand = hand_of(motion, 0.5)[:3]
    assert hand[1] < hip[1] - 0.2  # the person looks along -y
    assert hand[2] == pytest.approx(1.15 - 0.9, abs=0.02)


def test_the_floor_can_be_given(tmp_path):
    motion = load(tmp_path, person(), floor=-0.9, base_height=0.0)
    assert hand_of(motion, 0.5)[2] == pytest.approx(1.15, abs=0.003)


def test_a_t_pose_before_the_person_walks_up_does_not_turn_them(tmp_path):
    joints = person()
    plain = load(tmp_path, joints)
    n = 100
    walk = np.linspace(1.5, 0.0, n)[:, None] * [0.0, -1.0, 0.0]
    before = {name: np.tile(p[:1], (n, 1)) + walk for name, p in joints.items()}
    before["right_hand"][:50] += [0.7, -0.3, 0.3]
    before["left_hand"][:50] += [-0.6, 0.0, 0.5]
    blend = np.linspace(1, 0, 50)[:, None]
    before["right_hand"][50:] += blend * [0.7, -0.3, 0.3]
    before["left_hand"][50:] += blend * [-0.6, 0.0, 0.5]
    both = {name: np.r_[before[name], p] for name, p in joints.items()}
    motion = load(tmp_path, both)
    off = motion.capsules(1.0 + n / 100) - plain.capsules(1.0)
    assert np.abs(off).max() < 0.05


def test_a_person_who_reaches_little_or_steps_up_stays_clear_of_the_robot(tmp_path):
    joints = person()
    for name in ("right_hand", "right_elbow"):
        joints[name][:, 1] -= 0.25
    hips = motion_hips(load(tmp_path, joints))
    assert 0.84 < np.median(hips) < 0.9
    for place in joints.values():
        place[:, 1] += 0.29 * np.sin(np.linspace(0, np.pi, 300)) ** 8
    assert 0.749 < motion_hips(load(tmp_path, joints)).min() < 0.76


def motion_hips(motion):
    return motion.guesses[:, motion.labels == Part.TORSO][:, 0, 0]


# units, axes, rates


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("metres", [1.0, 0.01, 0.001, 0.0254])
def test_units_and_the_up_axis_are_guessed_and_said(tmp_path, up, metres):
    reference = load(tmp_path, person(60))
    path = write_bvh(tmp_path / "b.bvh", person(60), metres=metres, up=up)
    motion = load_mocap(path)
    np.testing.assert_allclose(motion.frames, reference.frames, atol=1e-4)
    said = " ".join(motion.notes)
    unit = {1.0: "m", 0.01: "cm", 0.001: "mm", 0.0254: "inch"}[metres]
    assert f"taken as {unit}: the arm" in said and f"{up} is up" in said


def test_tracks_with_y_up_are_no_lying_person(tmp_path):
    reference = load(tmp_path, person(60))
    names = dict(hip="SACR", neck="C7", head="LFHD")
    for side in ("left", "right"):
        for joint, marker in (("shoulder", "SHO"), ("elbow", "ELB"), ("hand", "WRA")):
            names[f"{side}_{joint}"] = side[0].upper() + marker
    turned = {name: p[:, [0, 2, 1]] * [1, 1, -1] for name, p in person(60).items()}
    path = write_csv(tmp_path / "y.csv", turned, names=names)
    motion = load_mocap(path)
    np.testing.assert_allclose(motion.frames, reference.frames, atol=1e-4)
    assert "y is up, as the trunk tells; of such a file it is z as" in motion.notes[1]
    assert motion.notes[0].endswith("joints named as by Vicon Plug-in Gait")
    assert not any(" is up" in note for note in reference.notes)
    upset = {name: p[:, [2, 0, 1]] for name, p in person(60).items()}
    with pytest.raises(BadMocap, match="trunk in x.csv points along x, and up is y or"):
        load_mocap(write_csv(tmp_path / "x.csv", upset))


def test_units_and_axis_can_be_given(tmp_path):
    path = write_bvh(tmp_path / "b.bvh", person(60), metres=0.05)
    by_hand = load_mocap(path, settings=MocapSettings(unit=0.05, up="y"))
    reference = load(tmp_path, person(60))
    np.testing.assert_allclose(by_hand.frames, reference.frames, atol=1e-3)


@pytest.mark.parametrize(
    "up, turned",
    [
        ("x", lambda p: p[:, [2, 0, 1]]),
        ("y", lambda p: p[:, [0, 2, 1]] * [1, 1, -1]),
        ("z", lambda p: p),
        ("-x", lambda p: p[:, [2, 1, 0]] * [-1, 1, 1]),
        ("-y", lambda p: p[:, [0, 2, 1]] * [1, -1, 1]),
        ("-z", lambda p: p * [1, -1, -1]),
    ],
)
def test_a_mapping_says_what_is_up(tmp_path, up, turned):
    reference = load(tmp_path, person(60), stand=(1.0, 0.0, 3.0), floor=0.0)
    places = {n: turned(p - [0, 0, 0.9]) + [0, 0, 0.9] for n, p in person(60).items()}
    path = write_csv(tmp_path / "turned.csv", places)
    mapping = tmp_path / "up.toml"
    mapping.write_text(f'up = "{up}"\n')  # alone: names are looked for as ever
    settings = MocapSettings(stand=(1.0, 0.0, 3.0), floor=0.0)
    motion = load_mocap(path, mapping=mapping, settings=settings)
    np.testing.assert_allclose(motion.frames, reference.frames, atol=1e-6)
    mapping.write_text("up = 3\n")
    with pytest.raises(BadMocap, match="no up axis 3; choose one of x, y, z, -x"):
        load_mocap(path, mapping=mapping)


@pytest.mark.filterwarnings("error")
def test_a_shoulder_above_the_other_tells_no_direction_and_warns_nobody(tmp_path):
    motion = load(tmp_path, person(60), up="x")  # the axis through both shoulders
    assert np.isfinite(motion.frames).all()


def without_hip(*others):
    """Return a person with feet [m], without a hip or other joints."""
    joints = person(60)
    for side, x in (("left", -0.1), ("right", 0.1)):
        joints[f"{side}_foot"] = np.tile([x, 0.0, 0.08], (60, 1))
    return {n: p for n, p in joints.items() if n != "hip" and n not in others}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("missing", [(), ("neck", "head"), ("left_foot", "right_foot")])
def test_without_a_hip_the_rest_of_the_body_tells_what_is_up(tmp_path, missing):
    joints = without_hip(*missing)
    names = {n: n.replace("hand", "wrist").replace("foot", "ankle") for n in joints}
    usual = load_mocap(write_csv(tmp_path / "a.csv", joints, names=names))
    assert not any(" up" in note for note in usual.notes)
    turned = {n: p[:, [0, 2, 1]] * [1, 1, -1] for n, p in joints.items()}
    motion = load_mocap(write_csv(tmp_path / "b.csv", turned, names=names))
    np.testing.assert_allclose(motion.frames, usual.frames, atol=1e-4)
    what = "head over the shoulders" if missing[-1:] == ("right_foot",) else "body over"
    told = [note for note in motion.notes if f"y is up, as the {what}" in note]
    assert told and "of such a file it is z as a rule" in told[0]
    upset = {n: p * [1, -1, -1] for n, p in joints.items()}
    with pytest.raises(BadMocap, match=f'{what}.* points along -z.*give up = "-z"'):
        load_mocap(write_csv(tmp_path / "c.csv", upset, names=names))


def test_where_the_body_does_not_tell_what_is_up_that_is_said(tmp_path):
    arm = {name: p for name, p in person(60).items() if name.startswith("right")}
    motion = load(tmp_path, arm)
    assert "z taken as up, as is usual: the body does not tell" in motion.notes


def test_markers_of_the_pelvis_are_the_hip_of_plug_in_gait(tmp_path):
    names = dict(hip="SACR", neck="C7", head="LFHD", psi="LPSI", asi="RASI")
    for side in ("left", "right"):
        for joint, marker in (("shoulder", "SHO"), ("elbow", "ELB"), ("hand", "WRA")):
            names[f"{side}_{joint}"] = side[0].upper() + marker
    joints = person(60)
    reference = load_mocap(write_csv(tmp_path / "a.csv", joints, names=names))
    hip = joints.pop("hip")
    joints |= {"psi": hip + [-0.1, -0.1, 0], "asi": hip + [0.1, 0.1, 0]}
    motion = load_mocap(write_csv(tmp_path / "b.csv", joints, names=names))
    np.testing.assert_allclose(motion.frames, reference.frames, atol=1e-6)
    assert "hip taken as the middle of LPSI, RASI" in motion.notes


def test_a_fast_recording_is_thinned(tmp_path):
    path = write_csv(tmp_path / "fast.csv", person(1500, rate=500.0), rate=500.0)
    motion = load_mocap(path)
    assert motion.rate_hz == 100 and motion.duration_s == pytest.approx(2.99)
    assert any("thinned from 500 to 100" in note for note in motion.notes)


def test_a_slow_recording_plays_too(tmp_path):
    path = write_csv(tmp_path / "slow.csv", person(90, rate=30.0), rate=30.0)
    motion = load_mocap(path)
    assert motion.rate_hz == 30
    assert_never_faster_than_it_says(motion, 5.0)


# the picture


def test_a_strip_is_written(tmp_path):
    from PIL import Image

    motion = load(tmp_path, hole(100, 200))
    path = write_strip(motion, tmp_path / "strip.png", times=[0.5, 1.5])
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    red = np.abs(picture - [196, 62, 62]).sum(axis=2) < 60
    half = picture.shape[1] // 2
    assert red[:, half:].sum() > 100 > 10 * red[:, :half].sum()


def test_a_strip_of_no_moments_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no moments"):
        write_strip(load(tmp_path, person(20)), tmp_path / "strip.png", times=[])
