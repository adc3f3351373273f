"""Flow of a registered print, compared with the design: measured lumens, closed vessels."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from design.errors import FlowError
from design.hemodynamics import FlowConditions
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from printctl.analysis.flow.conditions import Driven, recipe_of
from printctl.analysis.flow.printed.as_printed import open_part, printed_lumens
from printctl.analysis.flow.printed.printed_case import (
    AS_PRINTED,
    PrintedCase,
    flow_intervals,
    lumen_errors,
    solve_as_printed,
)
from printctl.analysis.flow.printed.printed_fidelities import FlowIntervals, lumped
from printctl.errors import UsageError
from printctl.pipeline.facts import recipe_facts
from printctl.recipe import Recipe
from printctl.recipe.parts import FlowPart
from tests.system.cli import called as printctl

WATER = 1e-3


def ladder() -> VesselNetwork:
    """From node 0 by two ways, vessels 1-3 and 2-4, to node 4; vessel 6 bridges their middles."""
    nodes = np.array([[0, 0, 0], [4, 0, 0], [8, 3, 0], [8, -3, 0], [12, 0, 0], [16, 0, 0]], float)
    ends = np.array([[0, 1], [1, 2], [1, 3], [2, 4], [3, 4], [4, 5], [2, 3]])
    count = len(ends)
    zero = np.zeros(count, np.int64)
    radius = np.full(2 * count, 0.25)
    return VesselNetwork(
        nodes, ends, zero, zero, 2 * np.arange(count + 1), nodes[ends].reshape(-1, 3), radius
    )


def rows(network: VesselNetwork, ratio: dict[int, float], closed: tuple[int, ...] = ()) -> Any:
    """What registration says: ten stations a vessel, all counted where a ratio is given."""
    found = []
    for vessel, length in enumerate(network.lengths()):
        share = ratio.get(vessel)
        along = ((np.arange(10) + 0.5) * length / 10).tolist() if share else []
        found.append(
            {
                "vessel": vessel,
                "open": vessel not in closed,
                "gauged_fraction": 1.0 if share else 0.0,
                "along_mm": along,
                "diameter_um": [500.0 * (share or 0.0)] * len(along),
                "ovality_along": [1.0] * len(along),
            }
        )
    return found


EVERY = dict.fromkeys(range(7), 0.9)


def test_resistance_goes_with_the_fourth_power_of_what_was_measured() -> None:
    network = ladder()
    printed = printed_lumens(network, rows(network, EVERY))
    part = open_part(printed, network)
    found = lumped(part.network, FlowConditions(WATER, inlet_flow_ul_s=1.0))
    ideal = 8.0 * WATER * network.lengths() / (np.pi * 0.225**4)
    assert_allclose(found.resistance, ideal, rtol=1e-9)
    assert printed.measured.all()


def test_an_oval_lumen_conducts_as_an_ellipse_does() -> None:
    network = ladder()
    measured = rows(network, EVERY)
    measured[0]["ovality_along"] = [2.0] * 10
    printed = printed_lumens(network, measured)
    long, short = 0.225 * np.sqrt(2.0), 0.225 / np.sqrt(2.0)
    ellipse = 4.0 * WATER * 4.0 * (long**2 + short**2) / (np.pi * long**3 * short**3)
    found = lumped(open_part(printed, network).network, FlowConditions(WATER, inlet_flow_ul_s=1.0))
    assert_allclose(found.resistance[0], ellipse, rtol=1e-9)


def test_a_closed_vessel_carries_nothing_and_flow_goes_the_other_way_round() -> None:
    network = ladder()
    printed = printed_lumens(network, rows(network, EVERY, closed=(2,)))
    part = open_part(printed, network)
    found = lumped(part.network, FlowConditions(WATER, inlet_flow_ul_s=1.0)).of_design(part, 7)
    assert found.flow[2] == 0.0
    assert np.isinf(found.resistance[2])
    # By 1, then parted: straight on by 3 or across the bridge and by 4.
    assert_allclose(found.flow[1], 1.0, rtol=1e-12)
    assert_allclose(found.flow[3] + found.flow[6], 1.0, rtol=1e-12)
    lengths = network.lengths()
    assert_allclose(found.flow[6] * (lengths[6] + lengths[4]), found.flow[3] * lengths[3])


def test_without_a_way_through_the_closed_vessels_are_named() -> None:
    network = ladder()
    printed = printed_lumens(network, rows(network, EVERY, closed=(5,)))
    with pytest.raises(FlowError, match=r"closed \(5\) leave no way open"):
        open_part(printed, network)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder as far as its flow goes."""
    folder = tmp_path / "run"
    folder.mkdir()
    network = ladder()
    write_network_csv(folder / "network.csv", network)
    recipe = {
        "schema": 1,
        "name": "ladder",
        "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
        "vasculature": {"design": "planar_four_vessel"},
        "flow": {"inlet_flow_ml_min": 0.5},
    }
    manifest = {"schema": 1, "facts": {"recipe": recipe}, "stages": {}}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / "registration.json").write_text(
        json.dumps({"vessels": rows(network, EVERY, closed=(2,))})
    )
    return folder


def test_the_door_takes_the_recipe_s_conditions(run: Path) -> None:
    done = printctl("flow", "run", "--as-printed", "--json", "--out", "found", cwd=run.parent)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["conditions"].startswith("the recipe's: inlet_flow_ml_min 0.5, ")
    assert told["closed_vessels"] == [2]
    with (run.parent / "found" / AS_PRINTED).open() as handle:
        table = list(csv.DictReader(handle))
    assert float(table[0]["designed_flow_ml_min"]) == pytest.approx(0.5)
    assert float(table[2]["share"]) == 0.0


def _solved(run: Path, recipe: dict[str, Any], *options: str) -> dict[str, Any]:
    """Solve the run's flow, its recipe's keys replaced by ``recipe``; return the summary."""
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["facts"]["recipe"] |= recipe
    whole = Recipe.model_validate(manifest["facts"]["recipe"])
    manifest["facts"]["recipe"] = recipe_facts(whole)
    (run / "manifest.json").write_text(json.dumps(manifest))
    found = str(run.parent / "found")
    done = printctl("flow", str(run), "--json", "--out", found, *options, cwd=run)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_a_run_is_solved_by_its_own_conditions_and_what_was_typed_in_their_place(run: Path) -> None:
    """It was solved at the options' defaults, and nothing said so."""
    windkessel = {"resistance_mmhg_min_ml": 4, "proximal_mmhg_min_ml": 1,
                  "compliance_ml_mmhg": 0.01}  # fmt: skip
    pulse = {"amplitude_ml_min": 5, "period_s": 1, "profile": "poiseuille"}
    flow = {"inlet_flow_ml_min": 20, "viscosity_mpa_s": 3, "outlet": windkessel, "pulse": pulse}
    own = _solved(run, {"flow": flow}, "--svzerod", "../case.json")
    assert own["inflow_ml_min"] == pytest.approx(20)
    assert own["pulsatile"]["inlet_flow_amplitude_ml_min"] == pytest.approx(5)
    case = json.loads((run.parent / "case.json").read_text())
    kinds = [one["bc_type"] for one in case["boundary_conditions"]]
    assert sorted(kinds) == ["FLOW", "RCR"]
    assert max(case["boundary_conditions"][0]["bc_values"]["Q"]) == pytest.approx(25 / 60, rel=1e-3)
    told = _solved(run, {}, "--viscosity-mpa-s", "6", "--outlet-resistance-mmhg-min-ml", "8",
                   "--shape", "roller_pump")  # fmt: skip
    assert told["pressure_drop_pa"] == pytest.approx(2 * own["pressure_drop_pa"])
    assert "viscosity_mpa_s 6 in place of viscosity_mpa_s 3" in told["conditions"]
    assert "outlet.proximal_mmhg_min_ml 1," in told["conditions"]
    assert "pulse.shape roller_pump in place of pulse.amplitude_ml_min 5" in told["conditions"]
    by_pressure = _solved(run, {"flow": {"inlet_pressure_mmhg": 2, "viscosity_mpa_s": 3}})
    assert by_pressure["pressure_drop_mmhg"] == pytest.approx(2)


def test_a_run_of_another_size_takes_its_recipe_s_flow_scaled_and_typed_flow_as_it_is(
    run: Path,
) -> None:
    (run.parent / "outlets.csv").write_text("node,resistance_mmhg_min_ml\n5,8\n")
    flow = {"inlet_flow_ml_min": 0.5, "outlets": "outlets.csv"}
    scaled = _solved(run, {"print_scale": 2, "flow": flow})
    assert scaled["inflow_ml_min"] == pytest.approx(4)
    with (run.parent / "found" / "flow.csv").open() as handle:
        # 4 mL/min through the eighth of 8 mmHg·min/mL.
        assert float(list(csv.DictReader(handle))[5]["pressure_out_mmhg"]) == pytest.approx(4)
    assert _solved(run, {}, "--inlet-flow-ml-min", "3")["inflow_ml_min"] == pytest.approx(3)
    (run.parent / "outlets.csv").unlink()
    done = printctl("flow", "run", cwd=run.parent)
    assert done.returncode == 2
    assert "outlets.csv, a table of the run's recipe" in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--one-d",), "the recipe has none"),
        (("--scanned",), "--scanned is for --three-d"),
        (("--edge-ratio", "0.5"), "--edge-ratio is for --three-d"),
        (("--compare",), "--compare doesn't go with --as-printed"),
        (("--unit", "um"), "drop --unit"),
    ],
)
def test_what_makes_no_sense_is_refused(run: Path, options: tuple[str, ...], words: str) -> None:
    done = printctl("flow", "run", "--as-printed", *options, "--out", "found", cwd=run.parent)
    assert done.returncode != 0
    assert words in " ".join(done.stderr.split())


def test_a_file_and_a_run_without_registration_are_told(run: Path) -> None:
    (run / "registration.json").unlink()
    part = FlowPart()
    with pytest.raises(UsageError, match="register a scan first"):
        solve_as_printed(PrintedCase(run, Driven(part), 0.5), run / "found", print)
    with pytest.raises(UsageError, match="wants a run folder"):
        recipe_of(run / "network.csv")


def with_intervals(found: Any, half: float, shared: float) -> Any:
    """Rows whose resistances are known to ± `half` (95 %, of the logarithm)."""
    budget = [{"type": "B", "share": shared}, {"type": "A", "share": 1.0 - shared}]
    ends = [float(np.exp(-half)), float(np.exp(half))]
    return [{**row, "resistance_ratio_interval_95": ends, "budget": budget} for row in found]


def ends_of(half: float, shared: float) -> FlowIntervals:
    network, found = ladder(), with_intervals(rows(ladder(), EVERY), half, shared)
    part = open_part(printed_lumens(network, found), network)
    conditions = FlowConditions(WATER, inlet_flow_ul_s=1.0)
    ends = flow_intervals(part, conditions, lumen_errors(found), 7)
    assert ends is not None
    return ends


def test_an_error_that_all_lumens_share_goes_whole_into_the_pressure_and_not_into_the_split() -> (
    None
):
    ends = ends_of(half=0.2, shared=1.0)
    # R of each vessel is off by the same factor, and so is the drop.
    assert np.log(ends.drop_pa[1] / ends.drop_pa[0]) == pytest.approx(0.4, rel=0.12)
    assert_allclose(ends.share[1], ends.share[0], atol=1e-9)


def test_a_withdrawn_diameter_leaves_no_interval_of_any_flow() -> None:
    found = with_intervals(rows(ladder(), EVERY), 0.2, 0.5)
    found[3]["resistance_ratio_interval_95"] = [None, None]
    errors = lumen_errors(found)
    assert not errors.known
    network = ladder()
    part = open_part(printed_lumens(network, found), network)
    assert flow_intervals(part, FlowConditions(WATER, inlet_flow_ul_s=1.0), errors, 7) is None
