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

from .columns import unpacked_table
from .sample import planar_network, sample_data


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
    assert unpacked_table(view["vessels"])["number"].tolist() == [1, 3]
    assert unpacked_table(view["colourings"][0]["values"])["value"] == pytest.approx(
        [0.5, 0.5, 0.4, 0.4]
    )
    assert positions(view["points"])[:, 0] == pytest.approx([1, 1, 3, 3], abs=1e-4)
