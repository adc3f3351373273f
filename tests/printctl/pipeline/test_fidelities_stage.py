"""Pipeline stage of 3D flow: runs on request, reruns when its inputs change."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from design.hemodynamics import FlowConditions
from printctl.pipeline.stages import fidelities
from printctl.recipe.parts import FlowPart
from tests.design.hemodynamics.networks import network_of

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
