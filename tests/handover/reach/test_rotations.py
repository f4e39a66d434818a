"""The rotation grid: equal cells, no twist, look-ups that hold against slow ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handover import rotation_grid
from handover.reach.rotations import SIZES
from roadmap.errors import BadInput


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles [rad] between rotations (..., 3, 3), broadcast."""
    gap = ((a - b) ** 2).sum(axis=(-2, -1))  # 8 sin^2(angle / 2)
    return 2 * np.arcsin(np.sqrt(np.clip(gap / 8, 0.0, 1.0)))


WORST = {72: 57.0, 576: 32.0, 1944: 22.5}


def rotations(n, seed=0):
    return Rotation.random(n, rng=np.random.default_rng(seed)).as_matrix()


def slow_cell(grid, R):
    """Carry the frame by scipy's rotation between the two axes, then bin the roll."""
    pixels = grid.pixel_frames.reshape(-1, 3, 3)
    pixel = slow_pixel(grid.n_side, R[:, 2])
    c = pixels[pixel][:, 2]
    axis = np.cross(R[:, 2], c)
    sine = np.linalg.norm(axis)
    turn = axis / sine * np.arctan2(sine, R[:, 2] @ c) if sine > 1e-12 else axis
    x = pixels[pixel].T @ Rotation.from_rotvec(turn).as_matrix() @ R[:, 0]
    roll = np.degrees(np.arctan2(x[1], x[0])) % 360
    return pixel * grid.n_roll + int(roll // (360 / grid.n_roll))


def slow_pixel(k, v):
    """Count the pixels' borders that lie north of a point, as HEALPix defines them."""
    z, phi = v[2], np.arctan2(v[1], v[0]) % (2 * np.pi)
    if abs(z) <= 2 / 3:
        # borders: lines of slope +-8 / (3 pi) in (phi, z)
        up = np.floor(k * (0.5 + phi * 2 / np.pi - 0.75 * z))
        down = np.floor(k * (0.5 + phi * 2 / np.pi + 0.75 * z))
        ring = int(k + up - down)  # 0 at the northern belt's border
        first = 2 * k * (k - 1) + 4 * k * ring
        ring += 1
        column = int((up + down - k + (1 - ring % 2) + 1) // 2)
        return first + column % (4 * k)
    quarter, inside = divmod(phi, np.pi / 2)
    radius = k * np.sqrt(3 * (1 - abs(z)))  # rings of the cap
    a = int(min(radius * inside * 2 / np.pi, k - 1))
    b = int(min(radius * (1 - inside * 2 / np.pi), k - 1))
    ring = a + b + 1
    at = int(quarter) * ring + a
    if z > 0:
        return 2 * ring * (ring - 1) + at
    return 12 * k * k - 2 * ring * (ring + 1) + at


@pytest.mark.parametrize("n", SIZES[:4])
def test_a_cell_s_centre_is_in_it(n):
    grid = rotation_grid(n)
    assert grid.n_cells == n == len(grid.centers)
    np.testing.assert_array_equal(grid.cell_of(grid.centers), np.arange(n))
    off = grid.centers @ grid.centers.transpose(0, 2, 1) - np.eye(3)
    assert np.abs(off).max() < 1e-12


@pytest.mark.parametrize("n", [72, 576, 1944])
def test_no_rotation_is_further_from_its_centre_than_a_twistless_cell_is_wide(n):
    grid, R = rotation_grid(n), rotations(400_000)
    # the poles too, where the usual Hopf bins twist
    poles = rotations(50_000, 1)
    poles[:, :, 2] = [0, 0, -1.0]
    poles[:, :, 0] -= poles[:, 2:, 0] * 0 + poles[:, :, 2] * poles[:, 2:, 0] * -1
    poles[:, :, 0] /= np.linalg.norm(poles[:, :, 0], axis=1)[:, None]
    poles[:, :, 1] = np.cross(poles[:, :, 2], poles[:, :, 0])
    for some in (R, poles):
        far = angles_between(some, grid.centers[grid.cell_of(some)])
        assert np.degrees(far.max()) < WORST[n]
    assert np.degrees(far.max()) < 1.05 * 180 / (3 * grid.n_side)


@pytest.mark.parametrize("n", [72, 576])
def test_cells_have_equal_volumes(n):
    counts = np.bincount(rotation_grid(n).cell_of(rotations(1000 * n)), minlength=n)
    # five standard deviations of a fair draw
    assert np.abs(counts / 1000 - 1).max() < 5 / np.sqrt(1000)


@pytest.mark.parametrize("n", SIZES[:4])
def test_look_ups_agree_with_a_slow_twin(n):
    grid, R = rotation_grid(n), rotations(3000, 2)
    slow = [slow_cell(grid, r) for r in R]
    np.testing.assert_array_equal(grid.cell_of(R), slow)


def test_neighbours_are_mutual_and_as_near_as_the_step():
    grid = rotation_grid(576)
    for cell, row in enumerate(grid.neighbors):
        near = row[row >= 0]
        assert 8 <= len(near) and cell not in near
        assert all(cell in grid.neighbors[k] for k in near)
        angles = np.degrees(angles_between(grid.centers[cell], grid.centers[near]))
        assert 29 < angles.min() and angles.max() < 41


def test_angles_between_rotations_are_the_rotation_s_angle():
    a, b = rotations(100, 3), rotations(100, 4)
    slow = [
        Rotation.from_matrix(x.T @ y).magnitude() for x, y in zip(a, b, strict=True)
    ]
    np.testing.assert_allclose(angles_between(a, b), slow, atol=1e-7)


def test_exact_poles_and_borders_have_a_cell():
    grid = rotation_grid(576)
    axes = np.eye(3)
    turns = [np.diag(d) for d in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    turns += [axes[[1, 2, 0]], axes[[2, 0, 1]]]
    cells = grid.cell_of(np.array(turns, float))
    assert ((cells >= 0) & (cells < 576)).all()


@pytest.mark.parametrize("n", [0, 100, 575])
def test_a_size_outside_of_the_family_is_refused_with_the_choices(n):
    with pytest.raises(BadInput, match="72, 576, 1944"):
        rotation_grid(n)


def test_what_is_no_rotation_is_refused():
    grid = rotation_grid(72)
    for bad, word in (
        (np.full((3, 3), np.nan), "NaN"),
        (2 * np.eye(3), "orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), "mirror"),
        (np.eye(4), "shape"),
    ):
        with pytest.raises(BadInput, match=word):
            grid.cell_of(bad)
