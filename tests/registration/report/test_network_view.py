import base64
import zlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from design.network import VesselKind, VesselNetwork
from registration.report.network_view import (
    network_view,
    report_view,
    thin_out,
)
from registration.report.picture import quantities
from registration.report.sections import vessel_summary
from registration.report.simplify import (
    simplify,
)

from .sample import deviation_surface, planar_network, sample_data


def unpacked(text: str, dtype: str) -> NDArray[Any]:
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype)


def positions(packed: dict[str, Any]) -> NDArray[np.float64]:
    """As the page undoes them: wrapped differences of levels."""
    steps = unpacked(packed["positions"], "<u2").reshape(-1, 3)
    levels = np.cumsum(steps, axis=0, dtype=np.uint16)
    return np.array(packed["low"]) + np.array(packed["step"]) * levels


def test_colourings_hold_a_value_for_each_vessel_or_point() -> None:
    network, data = planar_network(), sample_data()
    data["registration"]["vessels"].pop(3)
    made = {c["key"]: c for c in report_view(network, data)["colourings"]}
    assert {"radius", "flow", "pressure", "shear", "kind", "tree", "deviation"} <= set(made)
    radius = unpacked(made["radius"]["values"], "<f4")
    assert made["radius"]["at"] == "point"
    assert radius[10] == pytest.approx(0.2)
    error = unpacked(made["deviation"]["values"], "<f4")
    assert made["deviation"]["at"] == "vessel"
    assert len(error) == 14
    assert np.isnan(error[3])
    assert error[5] == pytest.approx(data["registration"]["vessels"][4]["error_percent"])


def test_the_page_gets_the_network_whole() -> None:
    network = planar_network()
    view = network_view(network, quantities(network), {2: "header"})
    assert np.abs(positions(view["points"]) - network.points).max() < 1e-5 * 16
    assert np.allclose(unpacked(view["radius"], "<f4"), network.radius, rtol=1e-6)
    assert unpacked(view["offset"], "<i4").tolist() == network.offset.tolist()
    assert unpacked(view["number"], "<i4").tolist() == list(range(14))
    assert np.allclose(view["lengths"], network.lengths(), atol=1e-4)
    assert view["names"] == {"2": "header"}
    assert view["least_diameter_mm"] == 0.0


def comb(radius: list[float]) -> VesselNetwork:
    """Vessels side by side."""
    count = len(radius)
    nodes = np.array([[x, y, 0.0] for x in range(count) for y in (0.0, 3.0)])
    ends = np.arange(2 * count).reshape(-1, 2)
    kind = np.full(count, VesselKind.CHANNEL)
    return VesselNetwork.from_segments(nodes, ends, np.array(radius), kind, np.zeros(count))


def test_the_thinnest_are_left_out_and_it_is_told() -> None:
    network = comb([0.1, 0.5, 0.2, 0.4, 0.2])
    assert thin_out(network, 5).vessels.tolist() == [0, 1, 2, 3, 4]
    shown = thin_out(network, 3)
    # Of the two of 0.2 neither is shown, so that "wider than 0.4 mm" is true.
    assert shown.vessels.tolist() == [1, 3]
    assert shown.least_diameter_mm == pytest.approx(0.4)
    view = network_view(network, quantities(network), {}, "radius", 3)
    assert (view["shown_count"], view["vessel_count"]) == (2, 5)
    assert unpacked(view["number"], "<i4").tolist() == [1, 3]
    assert np.allclose(unpacked(view["colourings"][0]["values"], "<f4"), [0.5, 0.5, 0.4, 0.4])
    assert positions(view["points"])[:, 0] == pytest.approx([1, 1, 3, 3], abs=1e-4)


def test_summary_of_vessels() -> None:
    rows = [{"open": True, "error_percent": -4.0, "narrowest_um": 350.0},
            {"open": False, "error_percent": 2.0, "narrowest_um": None}]  # fmt: skip
    lines = {f.label: f.value for f in vessel_summary({"vessels": rows})}
    assert lines["Open"] == "1 of 2"
    assert lines["Mean diameter error"] == "\u22121"
    assert lines["Mean size of the error"] == "3"
    assert lines["Narrowest lumen"] == "350"


def volume(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_shape_and_values_are_kept_to_the_cell() -> None:
    surface = deviation_surface(0.1)
    shown = simplify(surface, len(surface.surface.faces) // 3)
    before, after = (volume(s.surface.vertices, s.surface.faces) for s in (surface, shown))
    assert before > 0
    # The mean of points on a curved wall lies a little inside it.
    assert after == pytest.approx(before, rel=0.05)
    far = shown.cell_mm * np.sqrt(3.0)
    for k in range(0, len(shown.surface.vertices), 97):
        near = np.linalg.norm(surface.surface.vertices - shown.surface.vertices[k], axis=1)
        assert near.min() < far
    assert shown.scalar is not None
    assert np.nanmax(shown.scalar) <= np.nanmax(surface.scalar)  # type: ignore[arg-type]
