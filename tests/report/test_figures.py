"""Figures for paper, pictures of networks, what the three-dimensional view holds."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from lxml import etree, html
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from report import (
    diameter_figure,
    histogram_figure,
    network_figure,
)
from report.gcode import layer_figure
from report.gcode.colouring import colourings
from report.pages.network_view import (
    network_view,
    report_view,
    thin_out,
)
from report.picture import (
    DIRECTIONS,
    Colour,
    PictureOptions,
    Quantity,
    VesselQuantities,
    View,
    draw_picture,
    fitted_camera,
    magnitude,
    quantities,
)
from report.svg import inline_svg
from tests.design.networks import network, polylines

from .columns import unpacked_table
from .gcode_sample import layered_job
from .sample import block_surface, planar_network, sample_data

MEANS = [
    {"vessel": 0, "designed_um": 400.0, "value_um": 10.0},
    {"vessel": "$b_2$", "designed_um": 500.0, "value_um": 100.0, "u_um": 8.0, "lower_um": -30.0,
     "upper_um": 90.0, "decision": "fail"},
    {"vessel": 2, "designed_um": 450.0, "value_um": -31.0, "u_um": 8.0, "lower_um": -30.0,
     "decision": "undecided"},
]  # fmt: skip


def every_figure() -> dict[str, bytes]:
    network = planar_network()
    job = layered_job()
    return {
        "histogram": histogram_figure([-50, 0, 50, 100], [1, 3, 2]),
        "diameters": diameter_figure(MEANS),
        "network": network_figure(network, np.arange(14.0), "flow / mL/min"),
        "layer": layer_figure(job, 0, colourings(job)[0]),
    }


@pytest.fixture(scope="module")
def twice() -> tuple[dict[str, bytes], dict[str, bytes]]:
    return every_figure(), every_figure()


@pytest.mark.parametrize("name", ["histogram", "diameters", "network", "layer"])
def test_a_figure_is_svg_and_reproducible(twice, name):
    first, second = twice[0][name], twice[1][name]
    assert etree.fromstring(first).tag == "{http://www.w3.org/2000/svg}svg"
    assert first == second


def test_diameters_are_counted_by_their_decision_and_allowed_what_is_theirs() -> None:
    found = every_figure()["diameters"].decode()
    for said in ("measured (1)", "undecided (1)", "fail (1)"):
        assert said in found
    assert "pass" not in found


def test_inlined_drawings_follow_the_theme_and_keep_their_ids_apart() -> None:
    picture = every_figure()["diameters"]
    pages = [html.fromstring(inline_svg(picture, "c", prefix)) for prefix in ("a-", "b-")]
    first, second = (set(page.xpath("//@id")) for page in pages)
    assert first
    assert not first & second
    for page, ids in zip(pages, (first, second), strict=True):
        assert {ref[1:] for ref in page.xpath("//@href")} <= ids
    assert "var(--ink)" in inline_svg(picture, "c", "a-")
    assert "#1c2126" not in inline_svg(picture, "c", "a-")


def positions(packed: dict[str, Any]) -> NDArray[np.float64]:
    rows = unpacked_table(packed)
    return np.column_stack([rows[axis] for axis in "xyz"])


def test_colourings_hold_a_value_for_each_vessel_or_point() -> None:
    network, data = planar_network(), sample_data()
    data["registration"]["vessels"].pop(3)
    made = {c["key"]: c for c in report_view(network, data)["colourings"]}
    assert {"radius", "flow", "pressure", "shear", "kind", "tree", "deviation"} <= set(made)
    radius = unpacked_table(made["radius"]["values"])["value"]
    assert made["radius"]["at"] == "point"
    assert radius[10] == pytest.approx(0.2)
    error = unpacked_table(made["deviation"]["values"])["value"]
    assert made["deviation"]["at"] == "vessel"
    assert len(error) == 14
    assert np.isnan(error[3])
    assert error[5] == pytest.approx(data["registration"]["vessels"][4]["error_percent"])


def test_the_page_gets_the_network_whole() -> None:
    network = planar_network()
    view = network_view(network, quantities(network), {2: "header"})
    assert np.abs(positions(view["points"]) - network.points).max() < 1e-5 * 16
    assert np.allclose(unpacked_table(view["points"])["radius"], network.radius, rtol=1e-6)
    vessels = unpacked_table(view["vessels"])
    assert vessels["end"].tolist() == network.offset[1:].tolist()
    assert vessels["number"].tolist() == list(range(14))
    assert np.allclose(view["lengths"], network.lengths(), atol=1e-4)
    assert view["names"] == {"2": "header"}
    assert view["least_diameter_mm"] == 0.0


def comb(radius: list[float]) -> VesselNetwork:
    """Vessels side by side."""
    nodes = [[x, y, 0.0] for x in range(len(radius)) for y in (0.0, 3.0)]
    return network(nodes, np.arange(len(nodes)).reshape(-1, 2), radius, VesselKind.CHANNEL)


def test_the_thinnest_are_left_out_and_it_is_told() -> None:
    network = comb([0.1, 0.5, 0.2, 0.4, 0.2])
    assert thin_out(network, 5).vessels.tolist() == [0, 1, 2, 3, 4]
    shown = thin_out(network, 3)
    # Of the two of 0.2 neither is shown, so that "wider than 0.4 mm" is true.
    assert shown.vessels.tolist() == [1, 3]
    assert shown.least_diameter_mm == pytest.approx(0.4)
    view = network_view(network, quantities(network), {}, "radius", 3)
    assert (view["shown_count"], view["vessel_count"]) == (2, 5)
    assert unpacked_table(view["vessels"])["number"].tolist() == [1, 3]
    assert unpacked_table(view["colourings"][0]["values"])["value"] == pytest.approx(
        [0.5, 0.5, 0.4, 0.4]
    )
    assert positions(view["points"])[:, 0] == pytest.approx([1, 1, 3, 3], abs=1e-4)


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
    lines = [[(0, 0, 0), (1, 0, 0), (4, 0, 0)], [(4, 0, 0), (8, 3, 0)], [(4, 0, 0), (8, -3, 0)],
             [(0, 9, 0), (5, 9, 0)]]  # fmt: skip
    radius = [0.5, 0.5, 0.4, 0.3, 0.3, 0.2, 0.2, 0.01, 0.01]
    return replace(polylines(lines, radius, [0, 0, 0, 1]), tree=np.array([0, 0, 0, 7]))


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
