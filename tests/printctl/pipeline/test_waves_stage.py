"""Pipeline stage of flow: 1D waves on request, at the print's size."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.analysis.flow import ONE_D, ONE_D_WAVES, TABLE, steady_conditions
from printctl.analysis.flow.conditions import Driven
from printctl.pipeline.stages.flow import work
from printctl.recipe.parts import FlowPart
from printctl.recipe.solid import SolidPart
from tests.design.hemodynamics.networks import network_of


def test_a_run_writes_the_problems_that_its_recipe_names(tmp_path: Path) -> None:
    flow = FlowPart.model_validate({"exports": ["svzerod", "svmultiphysics"]})
    network = network_of([[0, 0, 0], [6, 0, 0]], [(0, 1)], 0.8)
    context: Any = SimpleNamespace(
        recipe=SimpleNamespace(flow=flow, print_scale=2.0, solid=SolidPart()),
        recipe_folder=Path(),
        folder=tmp_path,
        network=network,
        conditions=Driven(flow, print_scale=2.0).steady(network),
        bars=SimpleNamespace(remark=lambda *_: None),
    )
    summary, files = work(context, cast(Any, lambda *_: None))
    case = json.loads((tmp_path / "svzerod.json").read_text())
    flow_cm3_s = case["boundary_conditions"][0]["bc_values"]["Q"]
    assert flow_cm3_s == pytest.approx([8 * 0.25 / 60] * len(flow_cm3_s))
    assert summary["inflow_ml_min"] == pytest.approx(8 * 0.25)
    assert {"svzerod.json", "svmultiphysics/solver.xml"} < set(files)
    assert all((tmp_path / name).is_file() for name in files)


def test_a_print_twice_the_size_carries_eight_times_the_flow(tmp_path: Path) -> None:
    flow = FlowPart.model_validate(
        {
            "pulse": {"amplitude_ml_min": 0.1, "period_s": 1, "wall_young_kpa": 10, "steps": 20},
            "one_d": {},
        }
    )
    told: list[tuple[float, str]] = []
    context: Any = SimpleNamespace(
        recipe=SimpleNamespace(flow=flow, print_scale=2.0),
        recipe_folder=Path(),
        folder=tmp_path,
        network=network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 0.8),
        conditions=steady_conditions(flow),
        bars=SimpleNamespace(remark=lambda *_: None),
    )
    summary, files = work(context, cast(Any, lambda *said: told.append(said)))
    found = summary["one_d"]
    assert files[0] == TABLE
    assert found["inlet_flow_mean_ml_min"] == pytest.approx(8 * 0.25)
    assert (tmp_path / ONE_D).is_file()
    # Twenty samples and the columns' names.
    assert len((tmp_path / ONE_D_WAVES).read_text().splitlines()) == 21
    shares = [share for share, _ in told]
    assert len(told) == found["cycles"]
    assert np.all((np.array(shares) >= 0.0) & (np.array(shares) <= 1.0))
