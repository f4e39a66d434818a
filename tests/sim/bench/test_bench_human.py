"""`odm bench human` measures the arm and misses nothing."""

import json

from sim.bench.command import markdown_of
from sim.bench.handover import human


def test_the_table_shows_what_is_asked(odm, tmp_path):
    file = tmp_path / "human.json"
    code, out, _ = odm("bench", "human", "--short", "--json", file)
    result = json.loads(file.read_text())
    rows = {row["name"]: row for row in result["rows"]}
    assert code == 0 and "odm bench human" in out and result["setup"]["poses"] == 20_000
    assert rows["IK: poses missed"]["value"] == 0
    assert 0 < rows["IK: largest residual"]["value"] <= 1e-10
    for name in ("IK: a pose, all swivels", "IK: a solution", "quality of a posture"):
        assert rows[name]["unit"] == "us" and rows[name]["value"] > 0
        assert f"| {name} |" in markdown_of(result)


def test_a_miss_would_be_seen():
    """An arm of narrower ranges than the poses were drawn from misses many."""
    import numpy as np

    from handover import Arm
    from handover.human.anthropometry import ARM_RANGES

    arm = Arm("right", np.array([0.33, 0.25, 0.09]), 0.9 * ARM_RANGES)
    joints = np.random.default_rng(1).uniform(
        ARM_RANGES[:, 0], ARM_RANGES[:, 1], (5000, 7)
    )
    assert human._solved(arm, joints)["missed"] > 100
