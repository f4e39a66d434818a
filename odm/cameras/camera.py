"""DepthCamera: a pin-hole camera with a pose, and what follows from its pixels."""

import math
from dataclasses import dataclass, replace

import numpy as np

from roadmap.arrays import as_floats, frozen
from roadmap.errors import BadInput
from roadmap.ranges import check_number, is_between, told
from roadmap.transforms import check_pose, moved_points, pose_with

NO_READING = (0, 65535)  # pixel values that are no depths
MOST_PIXELS = 16384  # a side
MOST_NUMBER = 1e12  # any larger one is a mistake
LEAST_DEPTH = 0.03  # [m] no camera reads less
# degrees between a surface's normal and the ray: raw points hold there
_STEEPEST = 75.0
_SIDES = ("width", "height")
_SIDE = f"a whole number of pixels from 8 to {MOST_PIXELS}; take the size of its images"
_ABOVE = "above %s; take it from the camera's calibration"
_CUT = (
    f"a number of pixels from {-MOST_PIXELS} to {MOST_PIXELS}; take it from the "
    "calibration, less the %s that were cut off before the image"
)
_LIMITS = {
    **dict.fromkeys(_SIDES, (8, MOST_PIXELS, _SIDE)),
    **dict.fromkeys(
        ("fx", "fy"), (math.nextafter(2.0, 3.0), MOST_NUMBER, _ABOVE % "2 pixels")
    ),
    "scale": (math.nextafter(0.0, 1.0), MOST_NUMBER, _ABOVE % 0),
    "cx": (-MOST_PIXELS, MOST_PIXELS, _CUT % "columns"),
    "cy": (-MOST_PIXELS, MOST_PIXELS, _CUT % "rows"),
}


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """A camera whose pixels are depths along its optical axis.

    Camera axes: x right, y down, z forward; the ray of pixel (row v, column u) goes
    through (u - cx) / fx, (v - cy) / fy, 1, and the centre of the first pixel is at
    u = v = 0. Lens distortion must be taken out before.

    Attributes:
        width, height: Of the image in pixels.
        fx, fy, cx, cy: Focal lengths and principal point in pixels; that of a cropped
            image may lie outside of it.
        T_base_camera: (4, 4) pose of the camera in the robot's base frame [m].
        scale: Depth of one unit of a pixel [m]: 0.001 where pixels are millimetres.
        name: Of the camera in messages.
        clear_m: A pixel of 65535 says that its ray meets nothing up to this depth along
            the optical axis [m], at most the largest depth of a pixel. None: it tells
            nothing, as 0 always does. See docs/cameras.md before you give it.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    T_base_camera: np.ndarray
    scale: float = 0.001
    name: str = "camera"
    clear_m: float | None = None

    def __post_init__(self) -> None:
        for key, (low, high, wanted) in _LIMITS.items():
            value, kind = getattr(self, key), int if key in _SIDES else float
            if not is_between(value, low, high) or kind(value) != value:
                raise BadInput(f"{key} {told(value)} of {self.name} must be {wanted}")
            object.__setattr__(self, key, kind(value))
        pose = check_pose(self.T_base_camera, f"T_base_camera of {self.name}")
        _vector(pose[:3, 3], f"the place of {self.name}")
        object.__setattr__(self, "T_base_camera", frozen(pose, np.float64))
        self._check_clear()

    def _check_clear(self) -> None:
        if self.clear_m is None:
            return
        most = self.scale * (NO_READING[1] - 1)
        if not (is_between(self.clear_m, 0.0, most) and self.clear_m > 0.0):
            raise BadInput(
                f"clear_m {told(self.clear_m)} of {self.name} must be a depth above 0 "
                f"and up to {most:g} m, the largest of a pixel; give None where 65535 "
                "tells nothing"
            )
        object.__setattr__(self, "clear_m", float(self.clear_m))

    def moved(self, T_base_camera: np.ndarray) -> "DepthCamera":
        """Return the same camera at another pose (4, 4)."""
        return replace(self, T_base_camera=T_base_camera)

    @property
    def kappa(self) -> float:
        """Width of a pixel at depth 1, by the smaller focal length."""
        return 1.0 / min(self.fx, self.fy)

    def thinnest(self, depth_m: float) -> float:
        """Return how thick a thing must be so that no gap between rays hides it [m].

        A ball of that diameter, and so a union of such balls, meets a ray through the
        centre of a pixel wherever it is in view, even if single pixels have no
        reading; see `odm.cameras._seen`.
        """
        check_number("depth_m", depth_m, 0.0, math.inf)
        return 2.0 * depth_m * self.kappa / (1.0 - self.kappa)

    def covering_radius(self, depth_m: float) -> float:
        """Return the covering radius of raw points on a visible surface [m].

        The ray nearest to a visible point leaves it by half the diagonal of a pixel
        at most, across the optical axis. On a plane whose normal is turned from the
        ray by `beta` that grows by 1 / cos(beta): a grazing surface is sampled as
        sparsely as one likes, so the radius holds up to 75 degrees only.

        Args:
            depth_m: Largest depth of the points [m].
        """
        check_number("depth_m", depth_m, 0.0, math.inf)
        half_diagonal = np.sqrt(0.5) * self.kappa
        return float(depth_m * half_diagonal / np.cos(np.radians(_STEEPEST)))

    def check_image(self, image: np.ndarray) -> np.ndarray:
        """Return an image as C-contiguous uint16 of the camera's size, or raise."""
        if not isinstance(image, np.ndarray) or image.dtype != np.uint16:
            kind = getattr(image, "dtype", type(image).__name__)
            raise BadInput(
                f"the image of {self.name} is {kind}; give uint16 pixels, depths in "
                "metres go through camera.from_metres first"
            )
        image = np.ma.filled(image, NO_READING[0])
        if image.shape != (self.height, self.width):
            shown = " x ".join(str(n) for n in image.shape[::-1])
            raise BadInput(
                f"the image of {self.name} is {shown}, but its intrinsics are for "
                f"{self.width} x {self.height}; give the intrinsics of this size"
            )
        # to a compiled loop a read-only image is another type
        if not (image.flags.c_contiguous and image.flags.writeable):
            image = image.copy(order="C")
        return image

    def from_metres(self, depth_m: np.ndarray) -> np.ndarray:
        """Return depths [m] (height, width) as pixels.

        NaN, what is masked or <= 0 give 0: nothing is known there. Infinity and what is
        too far for a pixel give 65535 where the camera has a `clear_m`, else 0, too.
        Rounded down: no surface moves away from the camera.
        """
        depth = as_floats("the depths", depth_m)
        if depth.ndim != 2:
            raise BadInput(
                f"the depths have shape {depth.shape}; give ({self.height}, "
                f"{self.width}), those of an image of {self.name}"
            )
        known = (depth > 0.0) & ~np.ma.getmaskarray(depth_m)
        near = known & (depth < self.scale * NO_READING[1])
        pixels = np.floor(np.where(near, depth, 0.0) / self.scale + 1e-6)
        beyond = known & ~near | (pixels >= NO_READING[1])
        pixels[beyond] = NO_READING[0 if self.clear_m is None else 1]
        return pixels.astype(np.uint16)

    def misread(self, image: np.ndarray, most: float) -> str | None:
        """Return why its readings cannot be depths by this scale, or None.

        To be asked where none of them lies in the robot's grid: a wrong scale and an
        empty room look alike.

        Args:
            image: (height, width) uint16 with at least one reading.
            most: The middle one of all readings is no farther than that [m].
        """
        valid = image[(image != NO_READING[0]) & (image != NO_READING[1])]
        middle, far = self.scale * np.median(valid), self.scale * float(valid.max())
        if middle > most:
            what = f"the middle one is {middle:.3g} m away, more than {most:g} m"
        elif far < LEAST_DEPTH:
            what = f"the farthest one is {1e3 * far:.3g} mm away"
        else:
            return None
        return (
            f"the {valid.size} readings of {self.name} are no depths by its scale of "
            f"{self.scale:g} m per unit: {what}; pixels in millimetres have 0.001"
        )

    def points(self, image: np.ndarray) -> np.ndarray:
        """Return the (n, 3) points of all valid readings in the base frame [m].

        Raw points for a caller of his own; `SeenSpace` does not need them. Give
        `planner.step` the `covering_radius` of their largest depth.
        """
        image = self.check_image(image)
        v, u = np.nonzero((image != NO_READING[0]) & (image != NO_READING[1]))
        z = self.scale * image[v, u]
        x, y = z * (u - self.cx) / self.fx, z * (v - self.cy) / self.fy
        return moved_points(np.column_stack([x, y, z]), self.T_base_camera)


def look_at(
    eye: np.ndarray,
    target: np.ndarray,
    up: np.ndarray | tuple[float, ...] = (0.0, 0.0, 1.0),
) -> np.ndarray:
    """Return T_base_camera (4, 4) of a camera at `eye` that looks at `target` [m].

    Args:
        eye: (3,) where the camera is.
        target: (3,) what is in the middle of the image.
        up: (3,) direction that is up in the image.

    Raises:
        BadInput: Eye and target are the same, or the camera looks along `up`.
    """
    eye, target, up = _vector(eye, "eye"), _vector(target, "target"), _vector(up, "up")
    z = target - eye
    x = np.cross(z, up)
    if not (np.linalg.norm(z) > 1e-9 and np.linalg.norm(x) > 1e-9):
        raise BadInput(
            f"a camera at {eye} cannot look at {target} with {up} up; "
            "move one of them, or give another direction `up`"
        )
    z, x = z / np.linalg.norm(z), x / np.linalg.norm(x)
    return pose_with(np.column_stack([x, np.cross(z, x), z]), eye)


def _vector(value: object, name: str) -> np.ndarray:
    try:
        row = as_floats(name, value)
    except BadInput:
        row = np.zeros(0)
    if row.shape != (3,) or (np.abs(row) > MOST_NUMBER).any():
        raise BadInput(
            f"{name} is {told(value)}; give three numbers up to {MOST_NUMBER:g}, base "
            "frame"
        )
    return row
