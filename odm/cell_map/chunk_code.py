"""Machine code of the chunks of a build, loaded by whoever imports this.

Workers of a build import it before there are chunks, and the process that they are
forked from imports it once for all of them.
"""

from odm.cell_map import _sweep as sweep
from odm.close_test import _static as static
from odm.obstacles import _occupancy as occupancy
from roadmap.compiling.kept_code import load_kept

LOOPS = (
    occupancy.mark_points,
    occupancy.sort_points,
    static.motions_free,
    sweep.sweep_edges,
)

load_kept(LOOPS)
