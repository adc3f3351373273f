from typing import get_args

import numpy as np
import pytest
from hypothesis import strategies as st

from design.network import VesselNetwork
from registration.report.picture import (
    DIRECTIONS,
    Colour,
    PictureOptions,
    Quantity,
    VesselQuantities,
    View,
    draw_picture,
    fitted_camera,
    quantities,
)
from registration.report.picture.quantity import magnitude

from ..sample import block_surface, planar_network

NETWORK = planar_network()
BLOCK = block_surface().surface


def quantity(key: str) -> Quantity:
    return next(each for each in quantities(NETWORK) if each.key == key)


def picture(key: str = "radius", **options: object) -> bytes:
    return draw_picture(NETWORK, quantity(key), BLOCK, PictureOptions(width=400, **options))  # type: ignore[arg-type]


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


def fork() -> VesselNetwork:
    """A trunk, two branches, and a piece of a vein; the trunk bends."""
    nodes = np.array([[0.0, 0, 0], [4, 0, 0], [8, 3, 0], [8, -3, 0], [0, 9, 0], [5, 9, 0]])
    points = np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0], [4, 0, 0], [8, 3, 0], [4, 0, 0],
                       [8, -3, 0], [0, 9, 0], [5, 9, 0]])  # fmt: skip
    return VesselNetwork(
        nodes=nodes,
        vessel_nodes=np.array([[0, 1], [1, 2], [1, 3], [4, 5]]),
        kind=np.array([0, 0, 0, 1]),
        tree=np.array([0, 0, 0, 7]),
        offset=np.array([0, 3, 5, 7, 9]),
        points=points,
        radius=np.array([0.5, 0.5, 0.4, 0.3, 0.3, 0.2, 0.2, 0.01, 0.01]),
    )


def by_key(known: VesselQuantities | None = None) -> dict[str, Quantity]:
    return {quantity.key: quantity for quantity in quantities(fork(), known)}


def test_only_what_is_known_is_offered() -> None:
    assert list(by_key()) == ["radius", "order", "kind", "tree"]
    flow = {name: np.ones(4) for name in ("flow_ml_min", "wall_shear_pa", "pressure_in_mmhg",
                                          "pressure_out_mmhg")}  # fmt: skip
    known = by_key(VesselQuantities(flow, {"error_percent": np.array([1.0, -2.0, np.nan, 0.0])}))
    assert set(get_args(Colour)) <= set(known)


def test_orders_are_strahlers_and_start_at_the_terminals() -> None:
    order = by_key()["order"]
    assert [order.labels[int(v)] for v in order.values] == ["2", "1", "1", "1"]
    assert len(order.colours) == 2


def test_a_logarithmic_scale_where_numbers_span_much() -> None:
    wide = magnitude("flow", "Flow", "mL/min", np.array([0.0, 1e-3, 1e-1, 10.0]))
    assert wide is not None
    assert wide.scale == "log"
    assert wide.limits == (1e-3, 10.0)
    # Nought sits at the lower end, the geometric mean in the middle.
    assert wide.place(wide.values) == pytest.approx([0.0, 0.0, 0.5, 1.0])
    narrow = magnitude("flow", "Flow", "mL/min", np.array([1.0, 3.0]))
    assert narrow is not None
    assert narrow.scale == "linear"


# Ray caster of rounded tubes, against rows of spheres in plain arithmetic.

radius = st.floats(0.3, 9.0)
