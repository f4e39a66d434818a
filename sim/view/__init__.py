"""A page in the browser: a live run or a recording, drawn beside the loop."""

from sim.view.moment import Moment
from sim.view.viewer import Viewer

__all__ = ["Moment", "Viewer"]
