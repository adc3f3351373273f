"""Networks, flows and toolpaths as a notebook shows them: short, as a table, and drawn."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import design
from design.errors import DesignError


def made() -> tuple[design.VesselNetwork, design.FlowSolution, design.Toolpath]:
    network = design.planar_four_vessel()
    flow = design.solve_flow(network, design.FlowConditions(1e-3, inlet_flow_ul_s=4.0))
    part = design.block_solid((4, 3, 0.6))
    options = design.FreshOptions(layer_height_mm=0.15, line_width_mm=0.3)
    return network, flow, design.plan_fresh(part, options).toolpath


def test_values_of_arrays_are_shown_in_a_line_and_as_html() -> None:
    network, flow, path = made()
    for value in (network, flow, path):
        assert len(repr(value)) < 250
        assert "array(" not in repr(value)
        assert "<table>" in value._repr_html_()
    assert repr(network).startswith("<VesselNetwork vessels: 14, nodes: ")
    assert "layers: 4" in repr(path)
    assert f"flow: {abs(flow.flow).min():.4g} to 4 µL/s" in repr(flow)


def test_tables_hold_a_row_a_vessel_or_move() -> None:
    pytest.importorskip("pandas")
    network, flow, path = made()
    table = network.to_pandas()
    np.testing.assert_array_equal(table["length_mm"], network.lengths())
    np.testing.assert_array_equal(flow.to_pandas()["flow_ul_s"], flow.flow)
    moves = path.to_pandas()
    np.testing.assert_array_equal(moves["to_z_mm"], path.end[:, 2])
    assert moves.loc[moves["kind"] == "write", "volume_ul"].sum() == pytest.approx(
        path.volume_ul[path.kind == 0].sum()
    )


def test_without_pandas_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(DesignError, match="pip install pandas"):
        made()[0].to_pandas()


def test_plots_draw_every_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib import pyplot as plt

    network, flow, path = made()
    (lines,) = network.plot().collections
    assert len(lines._segments3d) == len(network.pieces()[0])
    (lines,) = path.plot().collections
    assert len(lines._segments3d) == (path.kind == 0).sum()
    axes = flow.plot()
    drawn = np.asarray(axes.collections[0].get_offsets())
    np.testing.assert_allclose(drawn, np.column_stack([abs(flow.flow), abs(flow.wall_shear)]))
    assert flow.plot(axes) is axes
    plt.close("all")
