import numpy as np
import pytest
from mocap_files import BVH_NAMES, STANDING, person, write_bvh, write_csv
from rows import each

from handover.human.body import Part
from sim.people.mocap import BadMocap, MocapSettings, load_mocap, read_tracks
from sim.people.mocap.skeletons import BUILT_IN, joints_of
from sim.people.mocap.tracks import UNITS

ARM = ("right_shoulder", "right_elbow", "right_hand")


def refusal(*args, **options):
    with pytest.raises(BadMocap) as caught:
        load_mocap(*args, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence and ". " not in sentence
    return sentence


# names


@each("label", BUILT_IN)
def test_built_in_names_are_known(tmp_path, label):
    here = {j: n for j, n in BUILT_IN[label].items() if j in STANDING}
    names = {BVH_NAMES[joint]: name for joint, name in here.items()}
    path = write_bvh(tmp_path / "a.bvh", person(30), rename=names)
    found, said = joints_of(read_tracks(path))
    assert {j: found[j] for j in STANDING} == here
    assert len(load_mocap(path).labels) == 9
    assert said == label or BUILT_IN[said].items() >= here.items()


@pytest.mark.parametrize(
    "label, old, new",
    [
        ("3ds Max Biped", "Bip01 ", "Bip001 "),
        ("3ds Max Biped", " ", "_"),
        ("Blender Rigify", "", "DEF-"),
    ],
)
def test_what_exporters_write_otherwise_does_not_matter(tmp_path, label, old, new):
    here = {j: BUILT_IN[label][j].replace(old, new, -1 if old else 1) for j in STANDING}
    rename = {BVH_NAMES[j]: n for j, n in here.items()}
    found, said = joints_of(
        read_tracks(write_bvh(tmp_path / "a.bvh", person(30), rename=rename))
    )
    assert said == label and {j: found[j] for j in STANDING} == here


def test_namespace_and_case_do_not_matter(tmp_path):
    names = {"rShldr": "mixamorig:RightArm", "rForeArm": "mixamorig:rightforearm"}
    names |= {"rHand": "mixamorig:RightHand", "hip": "mixamorig:Hips"}
    path = write_bvh(tmp_path / "a.bvh", person(30), rename=names)
    assert joints_of(read_tracks(path))[1] == "Mixamo, MotionBuilder"


def test_a_mapping_file_names_a_new_skeleton(tmp_path):
    names = {name: f"bone {i}" for i, name in enumerate(BVH_NAMES.values())}
    path = write_bvh(tmp_path / "a.bvh", person(30), rename=names)
    lines = (f'{j} = "{names[n]}"\n' for j, n in BVH_NAMES.items())
    (tmp_path / "map.toml").write_text("".join(lines))
    mapped = load_mocap(path, mapping=tmp_path / "map.toml")
    plain = load_mocap(write_bvh(tmp_path / "b.bvh", person(30)))
    np.testing.assert_array_equal(mapped.frames, plain.frames)


def test_a_joint_that_is_named_for_two_is_refused(tmp_path):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    twice = {j: BVH_NAMES[j] for j in (*ARM, "left_shoulder", "left_elbow")}
    twice["left_hand"] = BVH_NAMES["right_hand"].upper()
    told = refusal(path, mapping=twice)
    assert "right_hand and for left_hand" in told and twice["left_hand"] in told


def test_unknown_bodies_are_ignored(tmp_path):
    joints = person(30)
    other = {"robot": joints["hip"] + 7.0, **joints, "table": joints["hip"] * np.nan}
    motion = load_mocap(write_csv(tmp_path / "a.csv", other))
    plain = load_mocap(write_csv(tmp_path / "b.csv", joints))
    np.testing.assert_array_equal(motion.frames, plain.frames)


def test_a_skeleton_without_arms_is_refused_with_its_names(tmp_path):
    names = {name: f"bone{i}" for i, name in enumerate(BVH_NAMES.values())}
    sentence = refusal(write_bvh(tmp_path / "a.bvh", person(30), rename=names))
    assert "no arm is known in a.bvh, which holds bone0, bone1" in sentence
    assert 'write a mapping file with lines such as right_shoulder = "..."' in sentence


@pytest.mark.parametrize(
    "mapping, words",
    [
        ({"right_hand": "paw"}, "names 'paw' (right_hand), which a.bvh lacks; it hol"),
        ({"right_claw": "rHand"}, "the mapping maps right_claw; joints are hip, neck"),
        ({"right_hand": "rHand"}, "names no whole arm; give shoulder, elbow and hand"),
        ({"right_hand": 3}, "gives right_hand = 3; give a name in quotes"),
        ({}, "names no whole arm"),
    ],
)
def test_a_wrong_mapping_is_refused(tmp_path, mapping, words):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    assert words in refusal(path, mapping=mapping)


@pytest.mark.parametrize(
    "text, words",
    [(None, "cannot be read: No such file"), ("right_hand = ", "is no TOML")],
)
def test_an_unreadable_mapping_is_refused(tmp_path, text, words):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    if text is not None:
        (tmp_path / "map.toml").write_text(text)
    assert words in refusal(path, mapping=tmp_path / "map.toml")


# whose body it is

MARKERS = dict(zip(ARM, ("RSHO", "RELB", "RWRA"), strict=True))


def two_people(path, first="Bob", second="Eve"):
    """Write an arm twice, the second a metre to the side."""
    joints = {(who, j): person(30)[j] for who in (first, second) for j in ARM}
    for joint in ARM:
        joints[second, joint] = joints[second, joint] + [1.0, 0, 0]
    names = {(who, j): f"{who}:{MARKERS[j]}" for who, j in joints}
    text = write_csv(path, joints, names=names).read_text(encoding="utf-8")
    for who in (first, second):
        for marker in MARKERS.values():  # of one person "Bob:RSHO", by its own name
            text = text.replace(f"{who}:{marker}:{who}:{marker}", f"{who}:{marker}")
    path.write_text(text, encoding="utf-8")
    return path


def test_two_people_in_a_file_are_refused_where_nobody_says_who(tmp_path):
    path = two_people(tmp_path / "a.csv")
    sentence = refusal(path)
    assert "a.csv holds the arms of Bob and Eve; say whose to take" in sentence
    assert '(--mapping FILE), as right_shoulder = "Eve:RSHO", right_elb' in sentence
    sentence = refusal(path, mapping=MARKERS)
    assert "gives 'RSHO' for right_shoulder, and a.csv holds Bob:RSHO" in sentence
    assert 'write whose it is, as right_shoulder = "Eve:RSHO"' in sentence
    mixed = {j: f"{'Bob' if 'hand' in j else 'Eve'}:{n}" for j, n in MARKERS.items()}
    assert "mixes the bodies of Eve and Bob" in refusal(path, mapping=mixed)


def test_two_skeletons_of_the_same_names_are_refused(tmp_path):
    """The first one would be the person, and nobody would see the other."""
    path = write_bvh(tmp_path / "a.bvh", person(30))
    head, motion = path.read_text().split("MOTION")
    skeleton = head.partition("\n")[2]
    rows = [line for line in motion.strip().split("\n")]
    twice = "\n".join([*rows[:2], *(f"{row} {row}" for row in rows[2:])])
    path.write_text(f"{head}{skeleton}MOTION\n{twice}\n")
    assert "a.bvh holds two skeletons that have a joint 'hip', and" in refusal(path)
    for line in ("ROOT ", "JOINT "):
        skeleton = skeleton.replace(line, f"{line}Eve:")
    path.write_text(f"{head}{skeleton}MOTION\n{twice}\n")
    mapping = {j: f"Eve:{n}" for j, n in BVH_NAMES.items()}
    assert len(load_mocap(path, mapping=mapping).labels) == 9


@pytest.mark.parametrize("who", ["Bob", "Eve"])
def test_a_mapping_says_which_of_two_people_it_is(tmp_path, who):
    path = two_people(tmp_path / "a.csv")
    mapping = {j: f"{who.upper()}:{n}" for j, n in MARKERS.items()}
    names, _ = joints_of(read_tracks(path), mapping)
    assert names == {j: f"{who}:{n}" for j, n in MARKERS.items()}
    path = two_people(tmp_path / "b.csv", who, "Table")  # nor does the other one do
    sentence = refusal(path, mapping={j: f"Ann:{n}" for j, n in MARKERS.items()})
    assert "names 'Ann:RSHO' (right_shoulder)" in sentence and f"{who}:RSHO" in sentence


def test_of_one_person_the_namespace_may_be_left_out(tmp_path):
    plain = {j: BUILT_IN["Vicon Plug-in Gait"][j] for j in STANDING}
    names = {j: f"Bob:{n}" for j, n in plain.items()}
    rename = {BVH_NAMES[j]: n for j, n in names.items()}
    path = write_bvh(tmp_path / "a.bvh", person(30), rename=rename)
    for mapping in (None, plain, names):
        assert joints_of(read_tracks(path), mapping)[0] == names


# who is seen


def test_one_arm_is_enough(tmp_path):
    joints = {name: person(30)[name] for name in ARM}
    motion = load_mocap(write_csv(tmp_path / "a.csv", joints))
    assert set(motion.labels) == {
        Part.RIGHT_HAND,
        Part.RIGHT_FOREARM,
        Part.RIGHT_UPPER_ARM,
    }
    assert "no left arm" in motion.notes


def test_an_arm_never_seen_is_left_out_and_said(tmp_path):
    joints = person(30)
    joints["left_elbow"][:] = np.nan
    motion = load_mocap(write_csv(tmp_path / "a.csv", joints))
    assert Part.LEFT_FOREARM not in motion.labels and "no left arm" in motion.notes


def test_no_arm_ever_seen_is_refused(tmp_path):
    joints = person(30)
    joints["left_elbow"][:] = joints["right_hand"][:] = np.nan
    sentence = refusal(write_csv(tmp_path / "a.csv", joints))
    assert "no arm is ever seen in a.csv: left elbow, right hand in none of 30" in (
        sentence
    )


def test_nothing_ever_seen_is_refused(tmp_path):
    joints = {name: place * np.nan for name, place in person(30).items()}
    assert "no arm is ever seen" in refusal(write_csv(tmp_path / "a.csv", joints))
    path = write_csv(tmp_path / "b.csv", joints)
    settings = MocapSettings(unit="mm")
    assert "no arm is ever seen" in refusal(path, settings=settings)


def test_a_bvh_of_nan_is_refused(tmp_path):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    head, values = path.read_text().split("Frame Time: 0.01000000\n")
    numbers = " ".join("nan" for _ in values.split())
    path.write_text(f"{head}Frame Time: 0.01\n{numbers}\n")
    assert "no arm is ever seen" in refusal(path)


# people who are none


def test_a_trunk_bent_backwards_is_refused_or_played_on_demand(tmp_path):
    joints = person()
    joints["neck"] += [0, -0.5, -0.1]
    path = write_csv(tmp_path / "a.csv", joints)
    sentence = refusal(path)
    assert "a.csv shows what no person does: the trunk leans back by more" in sentence
    assert "35 degrees in 300 of 300 frames" in sentence
    motion = load_mocap(path, settings=MocapSettings(accept_defects=True))
    assert any("no person does this: the trunk" in note for note in motion.notes)


def stretched(part, length):
    """Return a person whose right upper arm or forearm has this length [m]."""
    joints = person(60)
    a, b = ("shoulder", "elbow") if part == "upper arm" else ("elbow", "hand")
    way = joints[f"right_{b}"] - joints[f"right_{a}"]
    way *= length / np.linalg.norm(way, axis=1, keepdims=True) - 1
    for joint in ("elbow", "hand") if b == "elbow" else ("hand",):
        joints[f"right_{joint}"] += way
    return joints


@each(
    "part, length, fits",
    [
        ("upper arm", 0.13, False),
        ("upper arm", 0.18, True),
        ("upper arm", 0.44, True),
        ("upper arm", 0.55, False),
        ("forearm", 0.08, False),
        ("forearm", 0.14, True),
        ("forearm", 0.45, True),
        ("forearm", 0.52, False),
    ],
)
def test_each_part_of_an_arm_is_of_a_persons_length(tmp_path, part, length, fits):
    path = write_csv(tmp_path / "a.csv", stretched(part, length))
    if fits:
        load_mocap(path)
        return
    sentence = refusal(path)
    assert f"the right {part} is {length:.2f} m long, where people have 0" in sentence
    assert "give the unit or other names in a mapping (--mapping FILE)" in sentence
    motion = load_mocap(path, settings=MocapSettings(accept_defects=True))
    assert any(f"no person does this: the right {part}" in n for n in motion.notes)


def test_an_arm_that_is_too_long_in_some_frames_is_played(tmp_path):
    joints = person(300)
    joints["right_elbow"][100:140] += [0.0, 0.6, 0.0]
    load_mocap(write_csv(tmp_path / "a.csv", joints))


def test_a_mirrored_person_is_refused_by_the_hands(tmp_path):
    joints = person(60)
    joints["left_hand"] += [0, 0.2, 0]
    load_mocap(write_csv(tmp_path / "a.csv", joints))
    mirrored = {name: place * [1, -1, 1] for name, place in joints.items()}
    sentence = refusal(write_csv(tmp_path / "b.csv", mirrored))
    assert "both hands are behind the chest in 60 of 60 frames" in sentence
    assert "swap the names of both sides in a mapping (--mapping FILE)" in sentence
    assert "--accept-defects" in sentence


@pytest.mark.parametrize("side", [1, -1])
def test_toes_tell_a_mirrored_person_better_than_hands(tmp_path, side):
    joints = person(60)
    for name, x in (("left", -0.1), ("right", 0.1)):
        joints[f"{name}_foot"] = np.tile([x, 0.0, 0.08], (60, 1))
        joints[f"{name}_toe"] = np.tile([x, 0.15 * side, 0.02], (60, 1))
        elbow = joints[f"{name}_elbow"]  # hands held behind the back, or ahead
        joints[f"{name}_hand"] = elbow - [0, 0.3 * side, 0]
    names = {n: n.replace("foot", "ankle").replace("toe", "foot") for n in joints}
    names |= dict(left_hand="left_wrist", right_hand="right_wrist", hip="pelvis")
    path = write_csv(tmp_path / "a.csv", joints, names=names)
    if side > 0:
        load_mocap(path)
    else:
        assert "the toes point behind the chest in 60 of 60" in refusal(path)


def test_bending_forward_is_what_people_do(tmp_path):
    joints = person()
    for name, place in joints.items():
        if name != "hip":
            place += [0, 0.4, -0.2]
    load_mocap(write_csv(tmp_path / "a.csv", joints))


def test_a_hand_that_keeps_flying_is_refused(tmp_path):
    joints = person()
    for start in (60, 140, 220):  # out and back at 12 m/s, over five steps each
        way = np.r_[np.linspace(0, 0.6, 6), np.linspace(0.6, 0, 6)]
        joints["left_hand"][start : start + 12, 0] -= way
    sentence = refusal(write_bvh(tmp_path / "a.bvh", joints))
    assert "the left hand flies at up to 12 m/s" in sentence
    assert "play it all the same with --accept-defects" in sentence


def test_jumps_in_every_few_frames_are_refused(tmp_path):
    joints = person()
    noise = np.random.default_rng(0).normal(scale=0.3, size=(300, 3))
    joints["right_shoulder"] += noise
    sentence = refusal(write_csv(tmp_path / "a.csv", joints))
    assert "the right shoulder jumps in 269 of 269 steps" in sentence


def test_a_clip_that_is_over_with_its_t_pose_is_refused(tmp_path):
    joints = person(12)
    joints["right_hand"][8:] += 1.0
    sentence = refusal(write_bvh(tmp_path / "a.bvh", joints))
    assert "holds nothing but a jump at its start" in sentence


# settings


@each(
    "settings, words",
    [
        ({"unit": "furlong"}, "no unit 'furlong'; choose one of m, cm, inch, mm"),
        ({"unit": 0.0}, "a unit of 0.0 m is not positive"),
        ({"up": "w"}, "no up axis 'w'; choose one of x, y, z, -x, -y, -z"),
        ({"stand": (1.0, 2.0)}, "stand is (1.0, 2.0); give x"),
        ({"stand": (1.0, np.nan, 0)}, "give x"),
        ({"base_height": np.nan}, "base_height is nan m"),
        ({"floor": np.inf}, "floor is inf m"),
        ({"height": 3.0}, "a height of 3.0 m is outside 1.2 to 2.2"),
        ({"thickness": "fat"}, "no thickness 'fat'"),
        ({"smooth_s": -1.0}, "smooth_s is -1.0 s"),
    ],
)
def test_settings_out_of_range_are_refused(tmp_path, settings, words):
    path = write_bvh(tmp_path / "a.bvh", person(30))
    with pytest.raises(ValueError) as caught:
        load_mocap(path, settings=MocapSettings(**settings))
    assert words in str(caught.value)


def test_a_size_that_is_no_persons_is_refused(tmp_path):
    path = write_bvh(tmp_path / "a.bvh", person(30), metres=0.05)
    assert "units long, which is no person's in m, cm, inch, mm" in refusal(path)


def test_a_person_upside_down_or_lying_is_refused(tmp_path):
    turned = {n: p * [1, -1, -1] for n, p in person(30).items()}
    sentence = refusal(write_bvh(tmp_path / "a.bvh", turned, up="z"))
    assert "points along -z, and up is y or z" in sentence
    assert 'give up = "-z" in the mapping (--mapping FILE)' in sentence
    lying = {n: p[:, [2, 0, 1]] for n, p in person(30).items()}
    sentence = refusal(write_bvh(tmp_path / "b.bvh", lying, up="z"))
    assert "points along x" in sentence


def test_a_unit_that_makes_the_arm_nobodys_is_refused_with_the_one_that_fits(tmp_path):
    path = write_csv(tmp_path / "a.csv", person(60), unit="m")
    path.write_text(path.read_text().replace(",m,m,m", ",mm,mm,mm"))
    sentence = refusal(path)
    assert "the arm in a.csv is 0.000" in sentence and "(a.csv says so)" in sentence
    assert 'it looks like m: give unit = "m" in the mapping' in sentence
    mapping = tmp_path / "unit.toml"
    mapping.write_text('unit = "m"\n')  # alone: names are looked for as ever
    motion = load_mocap(path, mapping=mapping)
    right = load_mocap(write_csv(tmp_path / "b.csv", person(60), unit="m"))
    np.testing.assert_allclose(motion.frames, right.frames, atol=1e-9)
    mapping.write_text('unit = "cm"\n')
    assert "in the unit cm (unit.toml says so)" in refusal(path, mapping=mapping)
    mapping.write_text("unit = true\n")
    assert "unit.toml gives unit = True" in refusal(path, mapping=mapping)
    told = refusal(path, settings=MocapSettings(unit=40.0))
    assert "in the unit 40 m (unit of the settings)" in told


@each("unit", UNITS)
@each("height", [0.97, 1.05, 1.75, 2.15])
def test_the_unit_is_told_for_children_and_for_tall_people(tmp_path, height, unit):
    size, metres = height / 1.75, UNITS[unit]
    joints = {name: place * size for name, place in person(30).items()}
    motion = load_mocap(write_bvh(tmp_path / "a.bvh", joints, metres=metres))
    assert any(f"taken as {unit}" in note for note in motion.notes)
