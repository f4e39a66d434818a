"""A hand-over as a film: both agents and the object over the time of a plan."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from handover.scenes.plan_file import WHO, duration, joints_at, object_at
from handover.scenes.scene import Scene
from sim.draw.film import FilmSettings, write_gif
from sim.draw.scene_picture import agent_triangles
from sim.draw.style import AMBER, BLUE, INK, TEAL, WOOD
from sim.draw.surroundings import add_shaded, all_triangles, show_box
from sim.run.played_plan import PlayedPlan

_FRAMES, _FPS = 60, 10
_COLOURS = TEAL, BLUE, WOOD, AMBER


def write_handover_film(
    scene: Scene | PlayedPlan, record: Mapping, path: str | Path
) -> Path:
    """Write a GIF of a plan, evenly sampled over its duration, whole or not at all.

    `scene` may be the plan's own file as it was read.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(5.6, 4.8), dpi=80)
    canvas = FigureCanvasAgg(figure)
    still = all_triangles(f.shape for f in scene.scenery if f.name != "floor")
    end, pictures, box = duration(record), [], None
    for t in np.linspace(0.0, end, _FRAMES):
        agents = [
            agent_triangles(getattr(scene, who), joints_at(record, who, t))
            for who in WHO
        ]
        T = object_at(record, scene, t)
        thing = all_triangles(scene.object_shapes(T))
        parts = [*agents, still, thing]
        if box is None:
            corners = np.concatenate(parts).reshape(-1, 3)
            box = corners.min(axis=0), corners.max(axis=0)
        figure.clear()
        axis = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
        add_shaded(axis, list(zip(parts, _COLOURS, strict=True)), 1.4)
        show_box(axis, *box)
        axis.view_init(18.0, -62.0)
        figure.text(0.02, 0.95, f"{_doing(record, t)}  {t:.1f} s", color=INK, size=10)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        pictures.append(picture)
    return write_gif(pictures, path, FilmSettings(*picture.size, fps=_FPS))


def _doing(record: Mapping, t: float) -> str:
    for motion in record["motions"]:
        if t <= motion["times"][-1]:
            return f"{motion['who']}: {motion['name']}"
    return "done"
