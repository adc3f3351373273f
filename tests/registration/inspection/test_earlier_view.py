"""Camera's move between two pictures of a bath, on whose surface glints move by themselves."""

import cv2
import numpy as np
import pytest

from registration.inspection.pictures.before import with_halos
from registration.inspection.pictures.earlier_view import camera_move
from tests.slower import first_of

SIZE = 260


@pytest.mark.parametrize("seed", first_of([1, 2, 3, 4]))
@pytest.mark.parametrize("texture", [0.004, 0.02])
def test_drifting_glints_do_not_pull_the_camera(seed: int, texture: float) -> None:
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:SIZE, 0:SIZE].astype(np.float64)
    rough = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), 2.0)
    bath = 130.0 * (1.0 + texture * rough / rough.std()) * (1.0 + 0.1 * x / SIZE)
    true = np.array([0.4, -0.3])
    at = rng.uniform(40, SIZE - 40, (2, 2))
    pictures = []
    for moved in (np.zeros(2), true):
        plane = bath.copy()
        for place in at + rng.normal(0, 1.5, (2, 2)):
            plane += 400.0 * np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2) / 8.0**2)
        shift = np.array([[1.0, 0.0, moved[0]], [0.0, 1.0, moved[1]]])
        plane = cv2.warpAffine(plane, shift, (SIZE, SIZE), borderMode=cv2.BORDER_REFLECT)
        pictures.append(np.clip(plane + rng.normal(0, 1.0, plane.shape), 0, 255))
    now, earlier = (np.log(one + 5.0)[:, :, None].astype(np.float32) for one in pictures)
    bright = np.asarray((pictures[0] >= 254) | (pictures[1] >= 254), dtype=np.bool_)
    move = camera_move(now, earlier, 1 - with_halos(bright))
    corners = np.array([[0, 0, 1], [SIZE, 0, 1], [0, SIZE, 1], [SIZE, SIZE, 1]], dtype=float)
    off = corners @ move.matrix.T - corners[:, :2] - true
    limit = 0.15 if texture > 0.01 else 0.6
    assert np.hypot(off[:, 0], off[:, 1]).max() < limit
