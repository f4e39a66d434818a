"""Of robots of any size and kind nothing is called free that is not."""

import pytest
from drawn_robots import draw_recipe
from forms import size, some

import odm
from odm.audit.audit import audit
from odm.audit.sequence_audit import run_sequence
from odm.audit.sequence_judge import Judge


@pytest.mark.parametrize("seed", some(range(24), 13, 19, 20))
def test_the_audits_find_nothing_whatever_the_robot_and_its_margins(tmp_path, seed):
    built = odm.build_map(draw_recipe(tmp_path, seed), threads=1)
    cell_map = odm.load_map(built.save(tmp_path / "map"))
    for close in (False, True):
        report = audit(cell_map, pairs=size(400, 4000), close=close, threads=1)
        assert report.violations == report.unresolved == 0, str(report)
        assert report.free_share > 0.05
    played = run_sequence(cell_map, Judge(cell_map), seed, size(60, 400))
    assert not played.first_faults
    assert played.answered > 0.2 * played.steps
