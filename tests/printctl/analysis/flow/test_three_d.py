"""3D flow, comparison of fidelities and matched split, by recipe and command."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from pydantic import ValidationError

from design.hemodynamics import FlowConditions, ProbeWaves
from design.hemodynamics.probes import clear_parts, midpoints
from design.network_files.csv_format import read_network_csv
from printctl.analysis.flow.fidelities import (
    IDEAL,
    comparison_summary,
    comparison_table,
    places,
    steady_comparison,
)
from printctl.recipe.parts import ComparePart, FlowPart, ThreeDPart
from registration.report.flow_figures import comparison_figure
from tests.design.hemodynamics.networks import network_of
from tests.printctl.analysis.flow.test_flow import SINE
from tests.slower import first_of
from tests.system.cli import called as printctl

pytest.importorskip("ngsolve")

HEAD = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
FORK = HEAD + (
    "0,0,1,0,0,0,2.5,0,0,0.5,0.5,artery,0\n"
    "1,1,2,2.5,0,0,4.5,0.3,0,0.4,0.4,artery,0\n"
    "2,1,3,2.5,0,0,3,-2,0,0.4,0.4,artery,0\n"
)
NETWORK = network_of(
    [[0, 0, 0], [4, 0, 0], [8, 3, 0], [8, -3, 0]], [(0, 1), (1, 2), (1, 3)], [0.5, 0.4, 0.3]
)
CONDITIONS = FlowConditions(1e-3, inlet_flow_ul_s=4.0)


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(FORK)
    return tmp_path


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as handle:
        return list(csv.DictReader(handle))


def _flow(folder: Path, *options: str) -> dict[str, Any]:
    done = printctl("flow", "fork.csv", "--unit", "mm", "--json", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def test_one_command_solves_in_3d_and_compares(fork: Path) -> None:
    found = _flow(fork, "--three-d", "--edge-ratio", "0.9", "--compare", "--along-vessel", "1")
    space, compared = found["three_d"], found["comparison"]
    assert space["order"] == 2
    assert space["mass_imbalance"] < 1e-6
    assert space["vessels_without_flow"] == []
    # π r² ℓ of each, less what overlaps at the fork.
    assert 2.5 < space["volume_ul"] < np.pi * (0.25 * 2.5 + 0.16 * (2.022 + 2.062))
    reduced = space["reduced"]
    assert reduced["effective_pressure_off_percent_of_drop"] < 0.5
    assert reduced["nominal_pressure_off_percent_of_drop"] > 1.0
    assert compared["along_vessel"] == 1
    assert compared["3D"]["flow_off_percent_of_inlet"] < 3.0
    rows = _rows(fork / "flow" / "flow_3d.csv")
    flow = [float(row["flow_ml_min"]) for row in rows]
    assert flow[0] == pytest.approx(0.25, rel=1e-6)
    assert flow[1] + flow[2] == pytest.approx(flow[0], rel=1e-6)
    for name in (
        "flow_3d.svg",
        "flow_3d_pressure.svg",
        "flow_streamlines.svg",
        "flow_comparison.svg",
    ):
        ElementTree.parse(fork / "flow" / name)
    assert {row["fidelity"] for row in _rows(fork / "flow" / "flow_comparison.csv")} == {
        "ideal",
        "3D",
    }


@pytest.mark.slow
def test_a_pulse_is_compared_over_its_cycle(fork: Path) -> None:
    found = _flow(fork, "--three-d", "--edge-ratio", "1", "--compare", *SINE, "--steps", "8")
    flow = found["comparison"]["3D"]["flow_off_percent_of_inlet"]
    assert flow < 5.0
    rows = [r for r in _rows(fork / "flow" / "flow_comparison.csv") if r["fidelity"] == "3D"]
    swing = [float(row["flow_swing_ml_min"]) for row in rows[:3]]
    assert swing[0] == pytest.approx(0.2, rel=0.02)
    assert swing[1] + swing[2] == pytest.approx(swing[0], rel=0.02)


def test_radii_are_matched_to_flows_that_are_wanted(fork: Path) -> None:
    found = _flow(
        fork, "--match-split", "--want", "2,0.1", "--want", "3,0.15", "--match-percent", "1",
        "--least-lumen-mm", "0.6",
    )["match"]  # fmt: skip
    assert found["met"]
    assert found["worst_percent_of_inlet_before"] > 1.0 >= found["worst_percent_of_inlet"]
    history = _rows(fork / "flow" / "flow_match.csv")
    assert [int(row["round"]) for row in history] == list(range(1, found["rounds"] + 1))
    assert float(history[0]["radius_scale_most"]) == 1.0
    matched = read_network_csv(fork / "flow" / "network_matched.csv", "mm")
    assert matched.radius.min() >= 0.3
    rows = _rows(fork / "flow" / "flow_match_vessels.csv")
    assert rows[0]["wanted_ml_min"] == "nan"
    assert float(rows[2]["flow_ml_min"]) == pytest.approx(0.15, abs=0.0026)
    scale = [float(row["radius_scale"]) for row in rows]
    assert matched.mean_radius() == pytest.approx(np.array([0.5, 0.4, 0.4]) * scale)


@pytest.mark.slow
def test_a_split_that_bounds_forbid_is_said_not_to_be_met(fork: Path) -> None:
    done = printctl(
        "flow", "fork.csv", "--unit", "mm", "--match-split", "--want", "2,0.001",
        "--least-lumen-mm", "0.79", cwd=fork,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "isn't met" in done.stderr
    assert "stand at a bound" in done.stderr


def test_wrong_options_have_a_message_each(fork: Path) -> None:
    for options, said in (
        (("--want", "2,0.1"), "--want is for --match-split"),
        (("--match-split", "--want", "two"), "isn't NODE,ML_MIN"),
        (("--match-split", "--want", "1,0.1"), "node 1 is given a flow and isn't an outlet"),
        (("--match-split", "--want", "2,0.2", "--want", "3,0.2"), "sum to 6.66667"),
        (("--edge-ratio", "0.5"), "--edge-ratio is for --three-d"),
        (("--along-vessel", "1"), "--along-vessel is for --compare"),
        (("--three-d", "--edge-ratio", "3"), "--edge-ratio: must be at most 1 (is 3.0)"),
        (("--compare",), "give three_d, one_d or compare.lattice, too"),
        (("--ranks-python", "python3"), "--ranks-python is for --ranks"),
    ):
        done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
        assert done.returncode != 0
        assert said in " ".join(done.stderr.split()), options


def test_places_are_amid_vessels_then_along_the_clear_part_of_one() -> None:
    probes, vessel = places(NETWORK, ComparePart(points=4))
    assert vessel == 1
    assert probes.vessel.tolist() == [0, 1, 2, 1, 1, 1, 1]
    # 0.5 mm of the widest and 0.4 of its own before; nothing but its own at the free end.
    first, last = 0.9 / 5.0, 1.0 - 0.4 / 5.0
    assert clear_parts(NETWORK)[1] == pytest.approx([first, last])
    step = (last - first) / 4.0
    assert probes.fraction[3:] == pytest.approx(first + step * (np.arange(4) + 0.5))
    assert clear_parts(network_of([[0, 0, 0], [1, 0, 0]], [(0, 1)], 0.5))[0] == pytest.approx(
        [0.4, 0.6]
    )


def test_deviations_from_the_ideal_are_told_in_units_and_parts() -> None:
    part = ComparePart(points=2)
    probes, _ = places(NETWORK, part)
    bare = steady_comparison(NETWORK, CONDITIONS, part, {})
    ideal = bare.waves[IDEAL]
    other = ProbeWaves(np.zeros(1), ideal.pressure + 1.33322, ideal.flow * 1.01)
    found = steady_comparison(NETWORK, CONDITIONS, part, {"3D": other})
    told = comparison_summary(found)
    assert told["3D"]["flow_off_percent_of_inlet"] == pytest.approx(1.0)
    assert told["3D"]["flow_off_ul_min"] == pytest.approx(0.04 * 60.0)
    assert told["3D"]["pressure_off_mmhg"] == pytest.approx(0.01, rel=1e-4)
    assert told["3D"]["flow_spread_percent"] == pytest.approx(told["ideal_flow_spread_percent"])
    table = comparison_table(found)
    assert len(table["vessel"]) == 2 * len(probes.vessel)
    assert table["flow_off_ul_min"][: len(probes.vessel)] == pytest.approx(0.0)
    assert len(midpoints(NETWORK).vessel) == 3


@pytest.mark.parametrize("times", first_of([1, 6]))
def test_the_figure_draws_every_fidelity(times: int) -> None:
    rng = np.random.default_rng(times)
    line = {
        "vessel": 4,
        "time_s": np.arange(times) / times,
        "fraction": np.linspace(0.1, 0.9, 5),
        "flow_ml_min": {n: 1.0 + rng.random((5, times)) for n in ("ideal", "1D", "3D")},
        "pressure_mmhg": {n: rng.random((5, times)) for n in ("ideal", "1D", "3D")},
    }
    picture = comparison_figure(line)
    root = ElementTree.fromstring(picture)
    axes = [e for e in root.iter() if str(e.get("id", "")).startswith("axes_")]
    assert len(axes) == (2 if times == 1 else 4)
    assert comparison_figure(line) == picture


def test_recipes_refuse_what_is_out_of_bounds() -> None:
    assert ThreeDPart().order == 2
    for bad in ({"edge_ratio": 1.2}, {"order": 4}, {"memory_gb": 0}, {"speed": 1}):
        with pytest.raises(ValidationError):
            ThreeDPart(**bad)
    with pytest.raises(ValidationError):
        ComparePart(points=0)
    assert FlowPart(three_d={}, compare={}).compare == ComparePart()
