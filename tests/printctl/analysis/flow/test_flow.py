"""Pulsatile flow: recipe section `flow.pulse` and `printctl flow`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from design.hemodynamics import WindkesselOutlet
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.analysis.flow import pulsatile_conditions, steady_conditions
from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart
from tests.system.cli import called as printctl

FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n"
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n"
    "2,1,3,7,7,3,4,7,7,0.4,0.4,artery,0\n"
)
SINE = ("--amplitude-ml-min", "0.1", "--period-s", "1")


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(FORK)
    return tmp_path


def test_a_pulse_leaves_tables_and_the_case_for_another_solver(fork: Path) -> None:
    done = printctl(
        "flow", "fork.csv", "--unit", "mm", *SINE, "--wall-young-kpa", "10", "--json",
        "--profile", "poiseuille", "--svzerod", "case.json", cwd=fork,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["pulsatile"]
    assert found["inlet_flow_amplitude_ml_min"] == pytest.approx(0.1, rel=1e-3)
    with (fork / "flow" / "flow_pulsatile.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    # Equal branches share alike.
    assert float(rows[1]["flow_mean_ml_min"]) == pytest.approx(0.125)
    assert float(rows[1]["flow_amplitude_ml_min"]) == pytest.approx(0.05, rel=0.01)
    waves = (fork / "flow" / "flow_waves.csv").read_text().splitlines()
    assert len(waves) == 101
    case = printctl("flow", "case.json", "--out", "theirs", "--json", cwd=fork)
    assert case.returncode == 0, case.stderr
    assert json.loads(case.stdout)["periodic"]
    assert (fork / "theirs" / "svzerod.csv").is_file()
    case = printctl("flow", "case.json", "--out", "theirs", "--results", "npz", cwd=fork)
    assert case.returncode == 0, case.stderr
    with np.load(fork / "theirs" / "svzerod.npz") as arrays:
        assert arrays["flow_in"].shape == (101, len(rows))
    for name, option, words in (("case.json", ("--one-d",), "--one-d is for networks"),):
        refused = printctl("flow", name, *option, cwd=fork)
        assert refused.returncode in (1, 2)
        assert words in refused.stderr


def test_a_steady_case_for_another_solver_gives_the_steady_flow(fork: Path) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", "--svzerod", "case.json",
                    "--svmultiphysics", "sv", "--json", cwd=fork)  # fmt: skip
    assert done.returncode == 0, done.stderr
    drop = json.loads(done.stdout)["pressure_drop_pa"]
    assert printctl("flow", "case.json", "--out", "theirs", cwd=fork).returncode == 0
    with (fork / "theirs" / "svzerod.csv").open() as handle:
        inlet = float(next(csv.DictReader(handle))["pressure_in"])
    assert inlet == pytest.approx(10 * drop, rel=1e-6)
    assert (fork / "sv" / "solver.xml").is_file()


def test_tables_are_the_same_numbers_as_arrays_of_one_file(fork: Path) -> None:
    asked = ("flow", "fork.csv", "--unit", "mm", *SINE, "--wall-young-kpa", "10", "--one-d",
             "--shear-band-dyn-cm2", "1,5")  # fmt: skip
    for kind in ("csv", "npz"):
        done = printctl(*asked, "--results", kind, "--out", kind, cwd=fork)
        assert done.returncode == 0, done.stderr
    assert [file.name for file in (fork / "npz").iterdir()] == ["flow.npz"]
    names = ("flow", "flow_1d", "flow_1d_waves", "flow_pulsatile", "flow_waves")
    assert sorted(file.stem for file in (fork / "csv").iterdir()) == list(names)
    with np.load(fork / "npz" / "flow.npz", allow_pickle=False) as arrays:
        assert {name.partition("/")[0] for name in arrays.files} == set(names)
        for name in names:
            with (fork / "csv" / f"{name}.csv").open() as handle:
                rows = list(csv.DictReader(handle))
            for column, text in rows[0].items():
                assert str(arrays[f"{name}/{column}"][0].item()) == text


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--period-s", "1"), "--period-s is for pulsatile flow"),
        (("--amplitude-ml-min", "0.1"), "give --period-s"),
        (("--amplitude-ml-min", "0.1", "--period-s", "-1"), "--period-s: must be above 0"),
        (("--shape", "heart", "--period-s", "1"), "'roller_pump'"),
        (("--svoned", "x.in"), "--svoned writes a pulsatile problem"),
        (("--svzerod", "x.json", "--junction-k", "1"), "one viscosity and no losses"),
        ((*SINE, "--svzerod", "x.json"), "no Womersley impedance"),
        (("--waveform", "wave.csv"), "line 3: '' is no number"),
        (("--waveform", "other.csv"), "set inlet_flow_ml_min: 2"),
        (("--waveform", "missing.csv"), "missing.csv"),
        (("--viscosity-mpa-s", "1000", "--inlet-flow-ml-min", "9999"), "mmHg"),
    ],
)
def test_mistakes_end_in_one_message(fork: Path, options: tuple[str, ...], words: str) -> None:
    (fork / "wave.csv").write_text("time_s,flow_ml_min\n0,1\n0.5,\n1,1\n")
    (fork / "other.csv").write_text("time_s,flow_ml_min\n0,1\n0.5,3\n1,1\n")
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""


def test_a_windkessel_is_converted_and_scaled_with_the_print() -> None:
    outlet = {"resistance_mmhg_min_ml": 4, "proximal_mmhg_min_ml": 1, "compliance_ml_mmhg": 0.01}
    pulse = {"amplitude_ml_min": 0.1, "period_s": 1, "outlet": outlet}
    part = FlowPart.model_validate({"pulse": pulse, "outlet_pressure_mmhg": 10})
    assert part.pulse is not None
    made = pulsatile_conditions(part, part.pulse, Path(), 2.0).outlet
    assert isinstance(made, WindkesselOutlet)
    assert made.distal == pytest.approx(4 * PA_PER_MMHG / UL_S_PER_ML_MIN / 8)
    assert made.compliance == pytest.approx(10 / PA_PER_MMHG * 8)
    assert made.distal_pa == pytest.approx(1333.22)


def test_an_outlet_of_the_pulse_holds_for_steady_flow_as_flow_outlet_does() -> None:
    """The mean of the pulse had a resistance behind it, and the steady flow hadn't."""
    kind = tree = np.zeros(1, dtype=np.int64)
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]])
    network = VesselNetwork.from_segments(nodes, np.array([[0, 1]]), np.array([0.5]), kind, tree)
    wave = {"amplitude_ml_min": 0.1, "period_s": 1}
    outlet = {"resistance_mmhg_min_ml": 4}
    one = FlowPart.model_validate({"pulse": wave, "outlet": outlet})
    other = FlowPart.model_validate({"pulse": {**wave, "outlet": outlet}})
    loads = [steady_conditions(part, network=network).behind for part in (one, other)]
    assert loads[0] == loads[1]
    assert loads[0][1].resistance == pytest.approx(4 * PA_PER_MMHG / UL_S_PER_ML_MIN)


def test_a_table_is_looked_for_beside_the_recipe(tmp_path: Path) -> None:
    (tmp_path / "wave.csv").write_text("time_s,flow_ml_min\n0,1\n1,3\n2,1\n")
    part = FlowPart.model_validate({"inlet_flow_ml_min": 2, "pulse": {"table": "wave.csv"}})
    assert part.pulse is not None
    made = pulsatile_conditions(part, part.pulse, tmp_path)
    assert made.inlet.at(np.array([1.0])) == pytest.approx([3 * UL_S_PER_ML_MIN])
    with pytest.raises(UsageError, match="set inlet_flow_ml_min: 2"):
        pulsatile_conditions(
            part.model_copy(update={"inlet_flow_ml_min": 1.0}), part.pulse, tmp_path
        )


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"pulse": {"amplitude_ml_min": 1, "period_s": 1, "outlet": {"resistance_mmhg_min_ml": 4}},
          "outlet": {"resistance_mmhg_min_ml": 4}}, "or pulse.outlet"),
        ({"outlets": "o.csv", "outlet": {"resistance_mmhg_min_ml": 4}}, "outlet or outlets"),
        ({"viscosity": {"model": "power_law", "index": 0.5}}, "consistency_mpa_sn"),
        ({"viscosity": {"model": "carreau", "index": 3}}, "index"),
        ({"losses": {"stenoses": [{"vessel": 0, "diameter_share": 2, "length_mm": 1}]}}, "share"),
        ({"losses": {"junction_k": -1}}, "junction_k"),
    ],
)  # fmt: skip
def test_a_flow_section_that_says_too_much_or_too_little_is_refused(
    section: dict[str, object], words: str
) -> None:
    with pytest.raises(ValidationError, match=words):
        FlowPart.model_validate(section)
