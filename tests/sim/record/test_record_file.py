"""Files that are no recording, or no longer the one that was written."""

import numpy as np
import pytest
from recorded import crane_recipe, new_loop, recorded, tampered, with_array
from rows import each

from odm import build_map, load_map, load_recipe
from odm.cell_map.recipe import Recipe, RobotRecipe, parse_recipe, recipe_names
from sim.record import first_difference, is_record, read_record, run_again, write_record
from sim.record.again import ReplayedPerson, build_again, check_built, check_map
from sim.record.recipe_toml import lost_files, recipe_text
from sim.record.record_check import BadRecord

HEAD = "recording.json"


@pytest.fixture(scope="module")
def cell_map(crane_urdf, tmp_path_factory):
    folder = tmp_path_factory.mktemp("map") / "crane"
    return load_map(build_map(crane_recipe(crane_urdf), threads=1).save(folder))


@pytest.fixture(scope="module")
def record(cell_map):
    return recorded(new_loop(cell_map, duration_s=2.0), cell_map)


@pytest.fixture(scope="module")
def file(record, tmp_path_factory):
    return write_record(record, tmp_path_factory.mktemp("record") / "run.npz")


@pytest.mark.parametrize("share", [0.001, 0.01, 0.3, 0.6, 0.99, 0.9999])
def test_a_truncated_file_is_known_for_what_it_is(share, file, tmp_path):
    part = tmp_path / "part.npz"
    part.write_bytes(file.read_bytes()[: max(48, int(share * file.stat().st_size))])
    assert is_record(part)
    with pytest.raises(BadRecord, match="truncated or damaged"):
        read_record(part)


def test_a_file_that_lost_bytes_on_its_way_is_known_for_what_it_is(file, tmp_path):
    whole, part = file.read_bytes(), tmp_path / "part.npz"
    part.write_bytes(whole[:100] + whole[120:])
    with pytest.raises(BadRecord, match="truncated or damaged"):
        read_record(part)
    part.write_bytes(whole[:26] + b"\xff\x0f" + whole[28:])  # length of a name
    with pytest.raises(BadRecord, match="truncated or damaged") as caught:
        read_record(part)
    assert len(str(caught.value)) < 400 + len(str(part))


def test_a_flipped_byte_is_found(file, tmp_path):
    data = bytearray(file.read_bytes())
    at = data.index(b"q.npy") + 400
    data[at] ^= 1
    (tmp_path / "run.npz").write_bytes(data)
    with pytest.raises(BadRecord, match="damaged.*q.npy"):
        read_record(tmp_path / "run.npz")


def test_a_flipped_number_of_the_outcome_is_found_and_named(file, cell_map, tmp_path):
    def flip(q):
        q[57, 0] += 1e-9

    record = read_record(tampered(file, tmp_path / "run.npz", "q.npy", flip))
    assert record.altered == ("q",)
    found = first_difference(record, run_again(record, cell_map))
    assert (found.frame, found.names) == (57, ("q",))
    assert "joint slew" in found.sentence


@pytest.mark.parametrize("name", ["capsules", "places", "robot.spheres"])
def test_a_flipped_number_of_the_input_is_refused(name, file, tmp_path):
    def flip(array):
        array.flat[3] += 1e-9

    path = tampered(file, tmp_path / "run.npz", f"{name}.npy", flip)
    with pytest.raises(BadRecord, match=f"array {name} of .* was altered"):
        read_record(path)


def test_a_changed_setting_is_refused(file, tmp_path):
    def change(head):
        head["settings"]["speed_scale"] = 0.6

    with pytest.raises(BadRecord, match="was altered"):
        read_record(tampered(file, tmp_path / "run.npz", HEAD, change))


@pytest.mark.parametrize(
    ("version", "remedy"),
    [(0, "record the run again"), (9, "update"), ("x", "record the run again")],
)
def test_another_format_is_refused(version, remedy, file, tmp_path):
    path = tampered(
        file, tmp_path / "run.npz", HEAD, lambda head: head.update(format=version)
    )
    with pytest.raises(BadRecord, match=f"format {version}, but.* 2 to 6; {remedy}"):
        read_record(path)


def test_a_head_that_is_none_is_refused(file, tmp_path):
    for k, head in enumerate(([1, 2], {"a": 1}, {"format": 1})):
        path = tampered(file, tmp_path / f"{k}.npz", HEAD, lambda _, head=head: head)
        with pytest.raises(BadRecord, match="cannot be read"):
            read_record(path)


def test_what_is_no_recording_is_not_taken_for_one(tmp_path):
    np.savez(tmp_path / "frames.npz", capsules=np.zeros((2, 1, 7)), rate_hz=50.0)
    (tmp_path / "text.npz").write_text("recording.json")
    (tmp_path / "empty.npz").write_bytes(b"")
    for name in ("frames", "text", "empty", "absent"):
        assert not is_record(tmp_path / f"{name}.npz")


def rows(record, name, n):
    return with_array(record, **{name: record.arrays[name][:n]})


WRONG = {
    "clip of 90 frames, shorter than the run of 200": lambda r: rows(r, "capsules", 90),
    "q of .* is a clip of 199 frames": lambda r: rows(r, "q", 199),
    "time goes backwards in .*: 0.5 s in frame 50, then 0.2 s": lambda r: with_array(
        r, time_s=np.r_[r.arrays["time_s"][:51], 0.2, r.arrays["time_s"][52:]]
    ),
    "frame 1 of .* is at 0.02 s": lambda r: with_array(
        r, time_s=2 * r.arrays["time_s"]
    ),
    "status of .* has the shape": lambda r: with_array(r, status=np.zeros((200, 2))),
    "capsules of .* has the shape": lambda r: with_array(
        r, capsules=np.zeros((200, 2, 6))
    ),
    "NaN or infinity": lambda r: with_array(
        r, capsules=np.where(r.arrays["capsules"] > 0.5, np.nan, r.arrays["capsules"])
    ),
    "capsules_at of .* must ascend": lambda r: with_array(
        r, capsules=np.zeros((9, 7)), capsules_at=np.r_[0, 9, np.full(199, 3)]
    ),
    "work places": lambda r: with_array(r, places=np.zeros((1, 2))),
}


@each("words", WRONG)
def test_arrays_that_are_no_run_are_refused(words, record, tmp_path):
    path = write_record(WRONG[words](record), tmp_path / "run.npz")
    with pytest.raises(BadRecord, match=words):
        read_record(path)


def test_a_missing_array_is_named(record, tmp_path):
    arrays = {k: a for k, a in record.arrays.items() if k != "dq"}
    broken = type(record)(record.head, arrays)
    with pytest.raises(BadRecord, match="lacks 'dq'"):
        read_record(write_record(broken, tmp_path / "run.npz"))


def test_an_unknown_setting_is_refused(record, cell_map):
    settings = record.head["settings"] | {"telepathy": 1.0}
    other = type(record)(record.head | {"settings": settings}, record.arrays)
    with pytest.raises(BadRecord, match="sets telepathy = 1.0"):
        run_again(other, cell_map)


def test_the_person_is_asked_for_no_time_beyond(record):
    person = ReplayedPerson(record)
    np.testing.assert_array_equal(person.capsules(1.99), record.person("capsules", 199))
    for t in (-0.01, 2.0):
        with pytest.raises(ValueError, match="from 0 to 1.99 s"):
            person.capsules(t)


def test_a_write_that_fails_leaves_the_old_file(record, file, tmp_path, monkeypatch):
    path = tmp_path / "run.npz"
    path.write_bytes(b"old")
    monkeypatch.setattr(np.lib.format, "write_array", _full)
    with pytest.raises(BadRecord, match="cannot be written .no space"):
        write_record(record, path)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def _full(*args, **options):
    raise OSError("no space")


def test_another_map_is_refused_and_both_are_named(
    record, cell_map, crane_urdf, tmp_path
):
    recipe = crane_recipe(crane_urdf, "other", nodes=60)
    other = load_map(build_map(recipe, threads=1).save(tmp_path / "other"))
    with pytest.raises(BadRecord) as told:
        run_again(record, other)
    sentence = str(told.value)
    assert cell_map.hash[:12] in sentence and other.hash[:12] in sentence
    assert "--build" in sentence and "--recipe-out" in sentence
    check_map(record, cell_map)
    with pytest.raises(BadRecord, match="another one from the same recipe"):
        check_built(record, other, "there")


def test_the_map_is_built_again_without_its_urdf(crane_urdf, tmp_path):
    moved = tmp_path / "gone.urdf"
    moved.write_text(crane_urdf.read_text())
    cell_map = load_map(build_map(crane_recipe(moved), threads=1).save(tmp_path / "a"))
    found = recorded(new_loop(cell_map, duration_s=0.2), cell_map)
    moved.unlink()
    path = write_record(found, tmp_path / "run.npz")
    again = load_map(build_again(read_record(path), threads=1).save(tmp_path / "b"))
    assert again.hash == cell_map.hash


@each("name", recipe_names())
def test_recipes_are_written_as_they_are_read(name, tmp_path):
    recipe = load_recipe(name)
    (tmp_path / "again.toml").write_text(recipe_text(recipe), encoding="utf-8")
    assert load_recipe(tmp_path / "again.toml").as_dict() == recipe.as_dict()


def test_odd_names_and_nested_values_survive_as_toml(tmp_path):
    table = {
        "roadmap": {
            "region": [[0.0, -1.0, 0.0], [1.0, 1.0, 1e-7]],
            "weights": [1.0, 0.5],
        },
        "scenery": [
            {"type": "mesh", "file": 'a "b"\\c\x7f.stl', "scale": 0.001},
            {"type": "box", "size": [1, 2.0, 3], "rpy": [0.0, 0.0, -1.5]},
        ],
    }
    robot = RobotRecipe(source="my arm\n.urdf", locked={"joint 1.a": -0.5}, srdf="s")
    (tmp_path / table["scenery"][0]["file"]).touch()
    recipe = parse_recipe(table, "näme", tmp_path)
    recipe = Recipe(recipe.name, robot, recipe.roadmap, recipe.safety, recipe.scenery)
    (tmp_path / "again.toml").write_text(recipe_text(recipe), encoding="utf-8")
    assert load_recipe(tmp_path / "again.toml").as_dict() == recipe.as_dict()


def test_a_recipe_tells_which_of_its_files_are_not_where_it_is_written(tmp_path):
    (tmp_path / "my.urdf").touch()
    robot = RobotRecipe(source="my.urdf", tip="hand", srdf="/no/my.srdf")
    scenery = ({"type": "mesh", "file": "at/home.stl"}, {"type": "plane"})
    recipe = Recipe(name="mine", robot=robot, scenery=scenery)
    assert lost_files(recipe, tmp_path) == ["at/home.stl"]
    assert lost_files(recipe, tmp_path / "else") == ["my.urdf", "at/home.stl"]
    assert not lost_files(Recipe(name="p", robot=RobotRecipe("panda")), tmp_path)
