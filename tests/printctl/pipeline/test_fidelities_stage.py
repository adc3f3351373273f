"""Pipeline stage of 3D flow: runs on request, reruns when its inputs change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.hemodynamics import FlowConditions
from printctl.analysis.flow.three_d import wall_shear_of_vessels
from printctl.pipeline.stages import fidelities
from printctl.recipe.parts import FlowPart
from registration.report.lumen_figure import shear_figure
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.lumens import pipe

NETWORK = network_of([[0, 0, 0], [0, 0, 4.0]], [(0, 1)], 0.5)


def _context(folder: Path, fillet_ratio: float = 0.5, **flow: Any) -> Any:
    return SimpleNamespace(
        recipe=SimpleNamespace(
            flow=FlowPart(**flow),
            solid=SimpleNamespace(fillet_ratio=fillet_ratio),
            print_scale=1.0,
        ),
        recipe_folder=folder,
        folder=folder,
        network=NETWORK,
        conditions=FlowConditions(1e-3, inlet_flow_ul_s=4.0),
    )


def test_it_is_asked_for_by_either_section(tmp_path: Path) -> None:
    assert not fidelities.is_requested(_context(tmp_path))
    assert fidelities.is_requested(_context(tmp_path, three_d={}))
    assert fidelities.is_requested(_context(tmp_path, three_d={}, compare={}))


def test_a_straight_lumen_has_poiseuilles_pressure(tmp_path: Path) -> None:
    pytest.importorskip("ngsolve")
    context = _context(tmp_path, three_d={"edge_ratio": 0.8}, compare={"points": 3})
    told: list[str] = []
    summary, files = fidelities.work(context, lambda share, doing: told.append(doing))
    assert summary["comparison"]["3D"]["pressure_off_percent_of_inlet"] < 1.0
    assert summary["comparison"]["3D"]["flow_off_percent_of_inlet"] < 1e-6
    exact = 8.0 * 1e-3 * 4.0 * 4.0 / (np.pi * 0.5**4) / 133.322
    assert summary["three_d"]["pressure_drop_mmhg"] == pytest.approx(exact, rel=5e-3)
    assert all((tmp_path / name).stat().st_size for name in files)
    assert "meshing" in told


def test_mean_wall_shear_is_by_area_where_nodes_are_uneven() -> None:
    network = network_of([[0, 0, 0], [0, 0, 4.0]], [(0, 1)], 0.5)
    even = pipe(2, 8)
    squeezed = even.points.copy()
    squeezed[:, 2] = even.points[:, 2] ** 2 / 4.0
    mesh = replace(even, points=squeezed)
    node = np.unique(mesh.faces[mesh.label == 0])
    shear: Any = SimpleNamespace(node=node, magnitude=squeezed[node, 2])
    steady: Any = SimpleNamespace(wall_shear=shear, field=SimpleNamespace(mesh=mesh))
    mean, _ = wall_shear_of_vessels(network, steady)
    assert mean == pytest.approx([2.0], rel=0.03)
    assert shear.magnitude.mean() < 1.7


def test_wall_shear_is_told_by_the_nearest_vessel_and_drawn() -> None:
    """The pipe as two vessels, end to end, and a third that the mesh doesn't have."""
    network = network_of(
        [[0, 0, 0], [0, 0, 2.0], [0, 0, 4.0], [0, 9, 0], [0, 9, 4]], [(0, 1), (1, 2), (3, 4)], 0.5
    )
    mesh = pipe(2, 8)
    node = np.unique(mesh.faces[mesh.label == 0])
    height = mesh.points[node, 2]
    shear: Any = SimpleNamespace(node=node, magnitude=height)
    steady: Any = SimpleNamespace(wall_shear=shear, field=SimpleNamespace(mesh=mesh))
    mean, most = wall_shear_of_vessels(network, steady)
    assert most[:2] == pytest.approx([2.0, 4.0], abs=0.26)
    assert mean[:2] == pytest.approx([1.0, 3.0], abs=0.15)
    assert np.isnan(mean[2])
    assert np.isnan(most[2])
    picture = shear_figure(mesh, shear)
    assert picture.startswith(b"<?xml")
    # In dyn/cm², ten times the number in Pa.
    assert b"wall shear" in picture
