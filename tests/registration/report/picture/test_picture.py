import io

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from registration.report.picture import (
    DIRECTIONS,
    PictureOptions,
    Quantity,
    View,
    draw_picture,
    fitted_camera,
    quantities,
)
from registration.report.picture.flow_marks import port_reach

from ..sample import block_surface, planar_network

NETWORK = planar_network()
BLOCK = block_surface().surface


def quantity(key: str) -> Quantity:
    return next(each for each in quantities(NETWORK) if each.key == key)


def picture(key: str = "radius", **options: object) -> bytes:
    return draw_picture(NETWORK, quantity(key), BLOCK, PictureOptions(width=400, **options))  # type: ignore[arg-type]


def pixels(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def test_same_input_gives_the_same_bytes() -> None:
    assert picture() == picture()


@pytest.mark.parametrize("view", list(DIRECTIONS))
def test_every_view_shows_the_whole_scene(view: View) -> None:
    camera = fitted_camera(NETWORK.points, view, 300, 200, 10)
    seen = camera.project(NETWORK.points)[:, :2]
    assert seen.min() >= 9.5 - 1e-6
    assert (seen <= [289.5 + 1e-6, 189.5 + 1e-6]).all()
    assert np.linalg.det(camera.turn) == pytest.approx(-1.0)  # y is downwards


def test_from_the_top_x_is_to_the_right_and_y_is_up() -> None:
    camera = fitted_camera(NETWORK.points, "top", 300, 200, 10)
    a, b, c = camera.project(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    assert b[0] > a[0]
    assert c[1] < a[1]


def test_inlets_and_outlets_have_arrows_within_the_picture() -> None:
    reach = port_reach(NETWORK)
    ports = len(NETWORK.inlets()) + len(NETWORK.outlets())
    assert len(reach) == ports > 0
    shown = pixels(draw_picture(NETWORK, quantity("radius"), None, PictureOptions(width=800)))
    dark = (shown[:, :660].max(axis=2) < 60).sum()
    assert dark > 100


@pytest.mark.slow
def test_arrows_turn_with_the_flow() -> None:
    options = PictureOptions(width=400)
    ahead = np.ones(NETWORK.vessel_count)
    designed = draw_picture(NETWORK, quantity("radius"), None, options)
    assert draw_picture(NETWORK, quantity("radius"), None, options, ahead) == designed
    assert draw_picture(NETWORK, quantity("radius"), None, options, -ahead) != designed
