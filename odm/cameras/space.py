"""SeenSpace: what cameras see occupied, free or not at all, kept up to date."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from odm.answer import VISIBLE
from odm.cameras import _cubes as cubes
from odm.cameras import _depth as depth
from odm.cameras import _remember as remember
from odm.cameras import _seen as seen
from odm.cameras import _windows as windows
from odm.cameras import layout
from odm.cameras._seen import REMEMBERED, UNKNOWN
from odm.cameras.camera import DepthCamera
from odm.cameras.settings import SeenSettings
from odm.cameras.view import lift
from odm.cell_map.cell_map import CellMap
from odm.checks import check_configuration
from roadmap.errors import BadInput
from roadmap.loading.held_link import with_payload
from roadmap.ranges import check_kind, check_seconds, settings_of

CELL_NAMES = (
    "unseen", "free", "shadow", "occupied", "remembered", "unknown", "out of reach",
)  # fmt: skip
_READINGS = ("valid", "own", "flying", "outside", "clear")  # as they are counted
_NO_FOURS = np.zeros((0, 0), np.uint64)
_LATE_S = 0.3  # [s] images that are as old came late; older ones have another clock
_UNFIT = np.full((1, 3), np.nan)  # a frame of it holds the robot


@dataclass(frozen=True, eq=False)
class Seen:
    """What a frame tells; its arrays are the space's own until the next frame.

    Attributes:
        points: (n, 3) centres of cubes that stand for all blocked cells, base frame
            [m]: what `planner.step` takes. Cells deep inside have one cube of double
            size: no sphere of the map gets there unnoticed, but a smaller one may.
            One row of NaN where the frame is unfit, so that a planner holds.
        covering_radius: Half the diagonal of the smaller cubes [m].
        certified: "visible surface".
        stamp: Time of the last fit frame [s].
        trouble: Why this frame is unfit, one sentence; None when it is fit.
        readings: How many pixels have a valid reading, are the robot's own, are flying
            ones, have a point outside the grid, and are clear (`DepthCamera.clear_m`).
        removed: Own points that the self filter took away, by link.
    """

    points: np.ndarray
    covering_radius: float
    stamp: float | None
    trouble: str | None
    readings: dict[str, int]
    removed: dict[str, int]
    certified: str = VISIBLE


class SeenSpace:
    """Cells that cameras see, remember or do not know; one object per planner.

    Each frame every cell is one of

    - occupied: a point of some camera lies in it;
    - free: all rays that may pass it went through, in one camera at least;
    - shadow: it is not free, and lies at or behind a surface some camera sees;
    - remembered: no camera sees it now, and it or a cell that near was blocked when
      it was last seen, at most `memory_s` ago;
    - unknown: no camera sees it, and the policy "occupied" blocks it;
    - out of reach: the robot cannot come near it;
    - unseen: none of these; it blocks nothing.

    Args:
        cell_map: The map the planner uses.
        cameras: One or more cameras that do not move.
        settings: See SeenSettings.

    Raises:
        BadInput: A camera does not look at the grid, is inside the robot's base, or
            has pixels too wide for the map; or the cells are too large for its rho.
    """

    def __init__(
        self,
        cell_map: CellMap,
        cameras: Sequence[DepthCamera] | DepthCamera,
        settings: SeenSettings | None = None,
    ) -> None:
        check_kind("cell_map", cell_map, CellMap, "give what odm.load_map returns")
        self.cell_map, self.robot = cell_map, cell_map.robot
        one = isinstance(cameras, DepthCamera)
        if not one:
            check_kind("cameras", cameras, Iterable, "give DepthCamera objects")
            if isinstance(cameras, np.ndarray):  # maybe of no dimension
                cameras = cameras.ravel()
        self.cameras = (cameras,) if one else tuple(cameras)
        self.settings = settings_of(settings, SeenSettings)
        self.covering_radius = layout.covering_radius(cell_map)
        self._dense = layout.needs_all_cubes(cell_map, self.covering_radius)
        self._buffers = layout.CellBuffers(cell_map, self.settings)
        self._body = layout.BodySpheres(self.robot, self.settings.d_self)
        noise = self.settings.noise_m
        self._views = layout.views(self.cameras, cell_map, self._buffers, noise)
        self._out = np.zeros((65536, 3))
        self._carried = b""  # what was carried last
        self.reset()

    def reset(self) -> None:
        """Forget all frames; every cell is unseen and never was seen."""
        self._buffers.forget()
        self.stamp: float | None = None
        self._last: float | None = None  # stamp of the last frame, fit or not
        self._newest = 0.0  # stamp up to which what is remembered has aged [s]
        self._clock = 0.0  # like the stamps, but it never goes back [s]
        self._seen_at = 0.0  # of the last fit frame, by that clock

    def update(
        self,
        images: Sequence[np.ndarray] | np.ndarray,
        q: np.ndarray,
        stamp: float,
        payload: np.ndarray | None = None,
    ) -> Seen:
        """Take one frame.

        Args:
            images: (height, width) uint16 for each camera; one camera's alone will do.
            q: (dof,) configuration measured at `stamp` [rad or m].
            stamp: Time of the images [s].
            payload: (k, 4) balls in the tool frame that hold what the robot carries:
                centres and radii [m]. The self filter needs them; and a map without a
                payload layer to look as far as they reach. That takes up to a second
                in the first frame with another object.

        Returns:
            What is blocked, as points for `planner.step`.

        Raises:
            BadInput: Wrong number, size or type of images, shape of q or payload.
        """
        images = self._check_images(images)
        q = check_configuration(self.robot, q, None)
        payload = layout.check_payload(payload)
        self._carry(payload)
        stamp = check_seconds("stamp", stamp)
        trouble = self._judge_time(stamp)
        if trouble is None and not np.isfinite(q).all():
            trouble = (
                "the robot's configuration holds NaN or infinity, so its own points "
                "cannot be told from others; check its encoders"
            )
        if trouble is None:
            self._body.place(q, payload)
            trouble = self._look(images)
        if trouble is not None:
            return self._seen(_UNFIT.copy(), trouble)
        self._remember()
        points = self._points()
        self.stamp = float(stamp)
        return self._seen(points, None)

    def _carry(self, payload: np.ndarray) -> None:
        """Look at what a payload (k, 4) may come near, too, from now on.

        A map with a payload layer has looked so far already.
        """
        key, layer = payload.tobytes(), self.cell_map.payload
        if key in (b"", self._carried) or layer is not None:
            return
        self._carried, buffers = key, self._buffers
        loaded = with_payload(self.robot, payload, solids=[])
        if buffers.reach_to(self.cell_map, loaded):
            noise = self.settings.noise_m
            self._views = layout.views(self.cameras, self.cell_map, buffers, noise)

    def cells(self) -> np.ndarray:
        """Return what every cell is since the last fit frame.

        Returns:
            (nx, ny, nz) uint8, an index of `CELL_NAMES` each; cell (0, 0, 0) is at
            the grid's origin.
        """
        buffers = self._buffers
        cells = buffers.seen_last.copy()
        for code, bits in ((REMEMBERED, buffers.bits), (UNKNOWN, buffers.unknown)):
            cells[buffers.unpack(bits)] = code
        return cells

    def counts(self) -> dict[str, int]:
        """Return how many cells are what."""
        n = np.bincount(self.cells().ravel(), minlength=len(CELL_NAMES))
        return dict(zip(CELL_NAMES, n.tolist(), strict=True))

    # --- inside ----------------------------------------------------------------

    def _check_images(self, images: object) -> list[np.ndarray]:
        if not isinstance(images, list | tuple) and np.ndim(images) < 3:
            images = [images]
        if len(images) != len(self.cameras):
            raise BadInput(
                f"{len(images)} images were given for {len(self.cameras)} cameras; "
                "give one image for each, in their order"
            )
        pairs = zip(self.cameras, images, strict=True)
        return [camera.check_image(image) for camera, image in pairs]

    def _judge_time(self, stamp: float) -> str | None:
        if not np.isfinite(stamp):
            return f"the images are stamped {stamp}; give the time they were taken"
        last, self._last = self._last, stamp
        if last is None:
            self._newest = stamp
            return None
        passed = stamp - self._newest
        # one of several that come late, in order maybe, knows less than the newest
        is_late = 0.0 < -passed <= max(self.settings.memory_s, _LATE_S)
        if stamp < last or is_late:
            behind = -passed if is_late else last - stamp
            return (
                f"the images are stamped {1e3 * behind:.0f} ms before the last ones, "
                "so they do not tell what is there now; deliver images in order, by "
                "one clock"
            )
        # below 0 the clock was set back by more than that, and goes on
        self._clock += passed if passed >= 0.0 else stamp - last
        self._newest = stamp
        return None

    def _look(self, images: list[np.ndarray]) -> str | None:
        """Let all cameras see; return what makes the frame unfit."""
        buffers, body, s = self._buffers, self._body, self.settings
        buffers.hit[:] = 0
        buffers.state[:] = buffers.blank
        body.removed[:] = 0
        buffers.counts[:] = 0
        for camera, view, image in zip(self.cameras, self._views, images, strict=True):
            size = camera.width, camera.height
            inside = depth.list_balls(view, body.centers, body.radii, body.balls, *size)
            if inside >= 0:
                return (
                    f"{camera.name} is inside {body.name_of(inside)} of the robot at "
                    "this configuration; check the camera's pose"
                )
            jump = max(1, round(s.flying_m / camera.scale)) if s.flying_m else 0
            fours = image.view(np.uint64) if camera.width % 4 == 0 else _NO_FOURS
            is_on = s.d_self is not None
            balls = depth.SelfFilter(body.balls, body.owner, body.removed, is_on)
            hits = depth.Hits(buffers.hit.reshape(-1), buffers.shape, buffers.once)
            depth.read_image(image, fours, view, balls, jump, hits)
            buffers.counts += buffers.once
            n_valid = buffers.once[depth.N_VALID]
            if n_valid == buffers.once[depth.N_CLEAR] == 0:
                return (
                    f"{camera.name} sees nothing: none of its {image.size} pixels has "
                    "a reading; check that it is plugged in and not covered, or give "
                    "clear_m to a camera that tells where nothing is"
                )
            if n_valid and buffers.once[depth.N_OUTSIDE] == n_valid:
                trouble = camera.misread(image, s.max_range_m)
                if trouble is not None:
                    return trouble
            lift(view.near, view.spare)
            lift(view.seen, view.spare)
            windows.largest_of_squares(view.near[0], view.top_near)
            windows.largest_of_squares(view.seen[0], view.top_seen)
            seen.see_cells(view, buffers.state, s.shadow)
        seen.mark_hits(buffers.hit4, buffers.hit, buffers.state)
        return None

    def _remember(self) -> None:
        """Fill `cells` from what is seen, remembered and unknown."""
        buffers, s = self._buffers, self.settings
        before, self._seen_at = self._seen_at, self._clock
        remember.note_content(
            buffers.state8, buffers.before8, buffers.flat, buffers.flat_before,
            buffers.kept, buffers.since, before,
        )  # fmt: skip
        content = remember.Kept(buffers.kept8, buffers.kept, buffers.since)
        ageing = remember.Ageing(s.memory_s, s.speed, buffers.h, s.policy_code)
        sources = remember.Sources(buffers.sources, buffers.ptr)
        remember.list_sources(content, self._clock, ageing, sources)
        remember.grow_sources(
            buffers.sources, buffers.ptr, buffers.shape, buffers.bits2, buffers.spare2
        )
        cubes.pack(buffers.state.view(np.uint32), buffers.unseen, buffers.blocked)
        cubes.add_unseen(buffers.unseen, buffers.bits, buffers.blocked)
        if s.policy_code == remember.GO_OCCUPIED:
            keep = self.cell_map.safety.rho + self.cell_map.safety.m
            body = self._body
            remember.spare_robot(
                body.centers,
                body.plain + keep,
                buffers.origin,
                buffers.h,
                buffers.spared,
            )
            remember.list_unknown(
                buffers.state, buffers.kept, buffers.since, self._clock, s.memory_s,
                buffers.spared, buffers.unknown,
            )  # fmt: skip
            cubes.add_unseen(buffers.unseen, buffers.unknown, buffers.blocked)

    def _points(self) -> np.ndarray:
        """Return all blocked cells as points."""
        buffers, s = self._buffers, self.settings
        cubes.list_inner(buffers.blocked, buffers.closed)
        buffers.full[:] = buffers.blocked
        cells = buffers.cells()
        cubes.choose_eighths(cells, s.shadow)
        for view in self._views if s.shadow else ():
            cubes.clear_eighths(view, cells, buffers.scratch)
        cubes.list_inner(buffers.full, buffers.inner)
        buffers.swap()
        while True:
            n = cubes.write_points(cells, self._dense, self._out)
            if n <= len(self._out):
                return self._out[:n]
            self._out = np.zeros((2 * n, 3))

    def _seen(self, points: np.ndarray, trouble: str | None) -> Seen:
        body, counts = self._body, self._buffers.counts.tolist()
        readings = dict(zip(_READINGS, counts, strict=True))
        removed = {
            name: n
            for name, n in zip(body.names, body.removed.tolist(), strict=True)
            if n
        }
        return Seen(
            points, self.covering_radius, self.stamp, trouble, readings, removed
        )
