import numpy as np
import pytest

from registration.report.picture.occlusion import occlude
from registration.report.picture.shell import draw_shell, layer_opacity


def square(z: float, size: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points = np.array([[-1.0, -1, z], [size, -1, z], [size, size, z], [-1, size, z]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return points, np.tile([0.0, 0.0, 1.0], (2, 3, 1)), faces


def test_each_layer_in_front_takes_its_share_and_those_behind_none() -> None:
    depth = np.full((10, 10), -np.inf)
    depth[:5] = 3.0
    through = np.ones((10, 10))
    for z in (1.0, 5.0):
        points, normals, faces = square(z)
        through *= draw_shell(points, normals, faces, depth)
    share = 1.0 - layer_opacity(1.0)
    # The diagonal belongs to both triangles of a square.
    off = ~np.eye(10, dtype=bool)
    assert through[5:][off[5:]] == pytest.approx(share**2)
    assert through[:5][off[:5]] == pytest.approx(share)


def test_open_ground_is_open_and_a_groove_is_darker() -> None:
    flat = np.zeros((40, 40))
    up = np.zeros((40, 40, 3))
    up[:, :, 2] = 1.0
    assert (occlude(flat, up, 8.0) == 1.0).all()
    groove = flat.copy()
    groove[:, 18:22] = -6.0
    found = occlude(groove, up, 8.0)
    assert found[10:30, 19:21].mean() < 0.6
    assert found[10:30, 2:6].mean() == 1.0
    assert found.min() >= 0.0
