"""Cuts through what a person's hand reaches: figure 3 of [Vahrenkamp2016], as a PNG."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handover import Human
from handover.meet.places import qualities_at
from sim.draw import style
from sim.draw.silhouette import Silhouette
from sim.terminal.progress import Bars

FIELDS = {
    "dexterity": "dexterity (1: the arm's best)",
    "effort": "ease: quality of the effort",
    "combined": "half of each, of one posture",
}


@dataclass(frozen=True, eq=False)
class Cut:
    """Places of one plane and what a hand can do there."""

    normal: int  # axis the plane is square to, 1 (y) or 2 (z)
    at: float  # where on that axis [m]
    # places across and up [m], ascending
    x: np.ndarray
    y: np.ndarray
    # name -> (len(y), len(x)) in [0, 1], NaN where the hand cannot be
    fields: dict[str, np.ndarray]

    def value(self, field: str, across: float, up: float) -> float:
        """Return a field at the nearest place of the cut."""
        i, j = np.abs(self.x - across).argmin(), np.abs(self.y - up).argmin()
        return float(self.fields[field][j, i])

    def best(self, field: str) -> tuple[float, np.ndarray]:
        """Return the largest value and its place (3,) [m]."""
        values = self.fields[field]
        j, i = np.unravel_index(np.nanargmax(values), values.shape)
        place = np.empty(3)
        across, up = style.VIEWS[self.normal][0]
        place[[self.normal, across, up]] = self.at, self.x[i], self.y[j]
        return float(values[j, i]), place


def arm_cut(
    human: Human,
    side: str,
    normal: int,
    at: float,
    spacing: float,
    rotations: int = 576,
    tell: Bars | None = None,
) -> Cut:
    """Return the cut through all places that a hand can be at.

    It is square to the axis `normal`, 1 (y) or 2 (z), at `at` [m], with places
    `spacing` apart [m]; at each, `rotations` of the hand are tried.
    """
    shoulder = human.T_world_shoulder(side)[:3, 3]
    reach = human.arm(side).length
    across, up = style.VIEWS[normal][0]
    x, y = (_places(shoulder[k], reach, spacing) for k in (across, up))
    points = np.empty((len(y), len(x), 3))
    points[..., normal] = at
    points[..., across], points[..., up] = np.meshgrid(x, y)
    flat = points.reshape(-1, 3)
    near = (np.linalg.norm(flat - shoulder, axis=1) <= reach) & (flat[:, 2] > 0.0)
    found = qualities_at(human, side, flat[near], rotations=rotations, progress=tell)
    fields = {}
    for name, best in found.best.items():
        fields[name] = np.full((len(y), len(x)), np.nan)
        fields[name].ravel()[near] = best
    return Cut(normal, float(at), x, y, fields)


def write_arm_picture(human: Human, side: str, cuts: list[Cut], path: Path) -> Path:
    """Draw dexterity, effort and both as a PNG, one row for each cut."""
    body = Silhouette(human.capsules_of("mean"))
    limits = [_limits(cut, body) for cut in cuts]
    wide = min(x[0] for x, _ in limits), max(x[1] for x, _ in limits)
    tall = [(y[1] - y[0]) / (wide[1] - wide[0]) for _, y in limits]
    where = " and ".join(f"{style.AXES[cut.normal]} = {cut.at:.2f} m" for cut in cuts)
    figure = style.new_figure(
        12.0,
        1.7 + 3.6 * sum(tall),
        f"The {side} hand of a person of {human.height:.2f} m, {human.posture}: the "
        f"best over all rotations and elbows in the planes {where}",
    )
    ratios = {"height_ratios": tall}
    axes = figure.subplots(len(cuts), 3, squeeze=False, gridspec_kw=ratios)
    for column, (name, words) in enumerate(FIELDS.items()):
        top = max(float(np.nanmax(cut.fields[name])) for cut in cuts)
        for row, (cut, (_, high)) in enumerate(zip(cuts, limits, strict=True)):
            axis = axes[row][column]
            image = _draw(axis, cut, name, top, body)
            axis.set(xlim=wide, ylim=high)
            at = human.T_world_shoulder(side)[list(style.VIEWS[cut.normal][0]), 3]
            axis.plot(*at, "+", color=style.INK, ms=8, zorder=5)
            if column:
                axis.set_ylabel("")
        style.set_title(axes[0][column], words)
        style.colour_bar(figure, image, ax=axes[:, column])
    return style.save(figure, path)


def _draw(axis: object, cut: Cut, name: str, top: float, body: Silhouette):
    plane, view = style.VIEWS[cut.normal]
    cell = cut.x[1] - cut.x[0]
    corner = cut.x[0] - 0.5 * cell, cut.y[0] - 0.5 * cell
    image = style.draw_cut(axis, corner, cell, cut.fields[name], (0.0, top), zorder=2)
    body.draw(axis, plane, style.BODY, style.BODY_EDGE, alpha=0.75, linewidths=1.0)
    if plane[1] == 2:
        style.draw_floor(axis)
    style.space_axes(axis, cut.normal, view=f"{view}: ")
    return image


def _limits(cut: Cut, body: Silhouette) -> list[tuple[float, float]]:
    seen = body.points()[:, list(style.VIEWS[cut.normal][0])]
    shown = np.isfinite(cut.fields["combined"])
    limits = []
    for axis, (places, other) in enumerate(((cut.x, 0), (cut.y, 1))):
        filled = places[shown.any(axis=other)]
        low = min(filled.min(initial=np.inf), seen[:, axis].min()) - 0.05
        limits.append((low, max(filled.max(initial=low), seen[:, axis].max()) + 0.05))
    return limits


def _places(middle: float, reach: float, spacing: float) -> np.ndarray:
    n = int(np.ceil(reach / spacing))
    return middle + spacing * np.arange(-n, n + 1)
