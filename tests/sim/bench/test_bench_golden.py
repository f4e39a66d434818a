"""`odm bench golden` says same of itself, and names what differs where it does."""

import json

import pytest

from sim.bench.golden.golden import DIFFERENT, FAILED, HERE, SAME, first_difference, run

QUICK = ("names", "shapes", "human", "obstacles")


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Compare this checkout with itself in some quick items, and write what it does."""
    file = tmp_path_factory.mktemp("golden") / "kept.json"
    return run(against=HERE, write=file, only=QUICK, processes=2), file


@pytest.fixture(scope="module")
def kept(compared):
    return compared[1]


def rows(result):
    return {row[0]: row for row in result["tables"][0]["rows"]}


def test_a_checkout_does_the_same_as_itself(compared):
    result = compared[0]
    assert result["exit_code"] == 0
    assert [row[1] for row in rows(result).values()] == [SAME] * len(QUICK)


def test_what_differs_from_what_was_kept_is_told(odm, kept, tmp_path):
    stored = json.loads(kept.read_text())
    assert len(stored["human"]["lines"]) > 20
    stored["human"]["lines"][3] += " and more"
    stored["names"]["failed"] = "ValueError: it broke"
    doctored = tmp_path / "doctored.json"
    doctored.write_text(json.dumps(stored))
    code, out, err = odm("bench", "golden", "--read", doctored, "--json")
    told = rows(json.loads(out))
    assert code == 1, err
    assert told["shapes"][1] == SAME and told["shapes"][4] == ""
    assert told["human"][1] == DIFFERENT and "and more" in told["human"][4]
    assert told["human"][4].startswith("line 4, ")
    assert told["names"][1] == FAILED and "it broke" in told["names"][4]


def test_the_first_difference_is_told_in_words():
    assert first_difference(["a", "b"], ["a", "b"]) == ""
    assert first_difference(["a", "b 1"], ["a", "b 2"]) == "line 2, b '1' became '2'"
    told = first_difference(["a", "b 1 x", "c"], ["a", "b 1 y", "d"])
    assert told == "line 2, b 1 'x' became 'y'; 1 more lines differ"
    assert "1 lines are gone" in first_difference(["a", "b"], ["a"])
    assert "1 lines are new" in first_difference(["a"], ["a", "b"])


@pytest.mark.parametrize(
    "words",
    [
        (), ("--against", "nowhere"), ("--latency",), ("--read", "none.json"),
        ("--read", "bad.json"), ("--read", "odd.json", "--only", "nothing"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(odm, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.json").write_text("[1]")
    (tmp_path / "odd.json").write_text("{}")
    code, _, err = odm("bench", "golden", *words)
    told = [line for line in err.splitlines() if line.startswith("odm: ")]
    assert code == 2 and len(told) == 1 and "Traceback" not in err
