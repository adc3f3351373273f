"""Options of `printctl flow`: inlet pressure, outlets, fluids, losses, wall shear range."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from tests.system.cli import called as printctl

HEAD = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
ROWS = (
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n",
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n",
    "2,1,3,7,7,3,4,7,7,0.4,0.4,artery,0\n",
)
SINE = ("--amplitude-ml-min", "0.1", "--period-s", "1")


@pytest.fixture
def fork(tmp_path: Path) -> Path:
    (tmp_path / "fork.csv").write_text(HEAD + "".join(ROWS))
    return tmp_path


def _flow(folder: Path, *options: str) -> dict[str, Any]:
    done = printctl("flow", "fork.csv", "--unit", "mm", "--json", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as handle:
        return list(csv.DictReader(handle))


@pytest.mark.slow
def test_an_inlet_can_be_driven_by_pressure_steadily_and_in_pulses(fork: Path) -> None:
    by_flow = _flow(fork, "--inlet-flow-ml-min", "2")
    drop = str(by_flow["pressure_drop_mmhg"])
    again = _flow(fork, "--inlet-pressure-mmhg", drop)
    assert again["inflow_ml_min"] == pytest.approx(2, rel=1e-9)
    (fork / "wave.csv").write_text(f"time_s,pressure_mmhg\n0,{drop}\n1,{drop}\n")
    found = _flow(fork, "--inlet-pressure-mmhg", drop, "--waveform", "wave.csv")["pulsatile"]
    assert found["inlet_flow_mean_ml_min"] == pytest.approx(2, rel=1e-6)
    sine = _flow(fork, "--inlet-pressure-mmhg", drop, "--amplitude-mmhg", "0.001",
                 "--period-s", "1")["pulsatile"]  # fmt: skip
    assert sine["inlet_pulse_mmhg"] == pytest.approx(0.002, rel=1e-3)


def test_outlets_take_what_lies_behind_them_from_a_table(fork: Path) -> None:
    """Resistances of 1 and 3 mmHg·min/mL, far above the vessels': the flow divides 3:1."""
    (fork / "outlets.csv").write_text(
        "node,resistance_mmhg_min_ml,proximal_mmhg_min_ml,compliance_ml_mmhg\n"
        "2,1000,,\n3,2500,500,0.0001\n"
    )
    found = _flow(fork, "--outlets", "outlets.csv", *SINE)
    rows = _rows(fork / "flow" / "flow.csv")
    assert float(rows[1]["flow_ml_min"]) / float(rows[2]["flow_ml_min"]) == pytest.approx(
        3, rel=1e-3
    )
    assert found["energy_imbalance"] < 1e-9
    waves = _rows(fork / "flow" / "flow_pulsatile.csv")
    assert float(waves[1]["flow_mean_ml_min"]) == pytest.approx(
        float(rows[1]["flow_ml_min"]), rel=1e-9
    )
    behind = _flow(fork, "--outlet-resistance-mmhg-min-ml", "8", "--outlet-pressure-mmhg", "5")
    # 0.125 mL/min through each 8 mmHg·min/mL.
    assert float(_rows(fork / "flow" / "flow.csv")[1]["pressure_out_mmhg"]) == pytest.approx(6)
    assert behind["mass_imbalance"] < 1e-12


def test_a_fluid_and_losses_come_from_files_and_options(fork: Path) -> None:
    (fork / "blood.yaml").write_text("model: carreau\n")
    water = _flow(fork, "--viscosity-mpa-s", "1")
    blood = _flow(fork, "--fluid", "blood.yaml")
    assert blood["pressure_drop_pa"] > 3.45 * water["pressure_drop_pa"]
    narrow = _flow(fork, "--viscosity-mpa-s", "1", "--stenosis", "1,0.3,1", "--junction-k", "1")
    assert narrow["pressure_drop_pa"] > water["pressure_drop_pa"]
    assert 0 < narrow["losses_share"] < 1
    assert "losses_share" not in water
    rows = _rows(fork / "flow" / "flow.csv")
    assert float(rows[1]["flow_ml_min"]) < float(rows[2]["flow_ml_min"])
    assert float(rows[1]["loss_pa"]) > 0


def test_a_band_of_wall_shear_gets_a_verdict(fork: Path) -> None:
    """At 0.25 mL/min of 1 mPa·s the trunk has 4μQ/(πr³) = 0.0424 Pa and the branches 0.0414 Pa."""
    water = ("--viscosity-mpa-s", "1", "--shear-band-dyn-cm2")
    found = _flow(fork, *water, "0.42,1")
    band = found["shear_band"]
    assert band["verdict"] == "mixed"
    assert band["vessels_inside"] == pytest.approx(1 / 3)
    area = 3 * 0.5 / (3 * 0.5 + 2 * 5 * 0.4)
    assert band["area_inside"] == pytest.approx(area)
    places = [row["wall_shear_band"] for row in _rows(fork / "flow" / "flow.csv")]
    assert places == ["inside", "below", "below"]
    assert _flow(fork, *water, "0.1,0.2")["shear_band"]["verdict"] == "above"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--outlet-pressure-mmhg", "10"), "the flow goes backwards, in at outlets"),
        (("--amplitude-mmhg", "9", "--period-s", "1"), "back out of the inlets for 31% of the"),
        (("--outlets", "high.csv"), "flow enters by 1 of 2 outlets (node 3)"),
        ((), ""),
    ],
)
def test_flow_that_goes_backwards_is_told(fork: Path, options: tuple[str, ...], words: str) -> None:
    (fork / "high.csv").write_text("node,pressure_mmhg\n2,0\n3,6\n")
    call = ("flow", "fork.csv", "--unit", "mm", "--inlet-pressure-mmhg", "5", *options, "--json")
    done = printctl(*call, cwd=fork)
    assert done.returncode == 0
    assert words in done.stderr
    notes = json.loads(done.stdout).get("notes", [])
    assert bool(notes) == bool(words)
    assert all(note in done.stderr for note in notes)


def test_ranks_take_what_is_said_of_elements_and_inertia(fork: Path) -> None:
    """The case is written before FEniCSx is looked for."""
    call = ("flow", "fork.csv", "--unit", "mm", "--ranks", "1", "--ranks-python", "nowhere")
    cells = []
    for ratio in ("0.9", "0.7"):
        done = printctl(*call, "--no-inertia", "--edge-ratio", ratio, cwd=fork)
        assert "nowhere" in done.stderr
        case = fork / "flow" / "ranks"
        assert json.loads((case / "case.json").read_text())["model"] == "stokes"
        cells.append((case / "tets.npy").stat().st_size)
    assert cells[1] > cells[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--inlet-pressure-mmhg", "5", "--inlet-flow-ml-min", "1"), "and not both"),
        (("--inlet-pressure-mmhg", "5", *SINE), "goes with --amplitude-mmhg"),
        (("--amplitude-mmhg", "5", "--period-s", "1"), "needs --inlet-pressure-mmhg"),
        (("--shear-band-dyn-cm2", "5"), "isn't LOW,HIGH"),
        (("--shear-band-dyn-cm2", "5,1"), "let it rise"),
        (("--stenosis", "1,0.3"), "isn't VESSEL,SHARE,MM"),
        (("--stenosis", "7,0.3,1"), "the network has 0 to 2"),
        (("--stenosis", "1,0.3,3", "--stenosis", "1,0.5,3"), "6 mm long (several count together)"),
        (("--fluid", "ink.yaml"), "--fluid ink.yaml: 'model' is 'honey'; it must be one of"),
        (("--fluid", "odd.yaml"), "--fluid odd.yaml: rest_mpa_s is no key here"),
        (("--fluid", "torn.yaml"), "--fluid torn.yaml isn't YAML"),
        (("--stenosis", "1.5,0.3,1"), "--stenosis 1.5,0.3,1: vessel must be a whole number"),
        (("--amplitude-ml-min", "0.3", "--period-s", "1"), "would go back out of the inlet"),
        (("--ranks", "2", "--order", "3"), "--ranks takes --edge-ratio and --inertia alone"),
        (("--ranks", "2", "--edge-ratio", "7"), "--edge-ratio: must be at most 1"),
        (("--ranks", "2", "--check"), "--check is for --three-d; --ranks takes"),
        (("--fluid", "no.yaml"), "no.yaml"),
        (("--fluid", "empty.yaml"), "--fluid empty.yaml names no fluid"),
        (("--fluid", "blood.yaml", *SINE), "a pulse is solved with --viscosity-mpa-s"),
        (("--fluid", "blood.yaml", "--viscosity-mpa-s", "2"), "viscosity or --viscosity-mpa-s"),
        (("--outlets", "short.csv"), "outlet 3 has no condition"),
        (("--outlets", "wrong.csv"), "node 1 isn't one of the outlets"),
        (("--outlets", "odd.csv"), "'flow'"),
        (("--outlets", "text.csv"), "line 2: pressure_mmhg 'low' is no number"),
        (("--outlets", "short.csv", "--outlet-resistance-mmhg-min-ml", "4"), "outlet or outlets"),
        (("--outlet-proximal-mmhg-min-ml", "4"), "--outlet-resistance-mmhg-min-ml is missing"),
        (("--steps", "50"), "--steps is for pulsatile flow; give --amplitude-ml-min"),
        (("--three-d-steps", "12"), "--three-d-steps is for --three-d"),
        (("--no-inertia",), "--no-inertia is for --three-d"),
        (("--waveform", "back.csv"), "sample 2 is -1 mL/min"),
        (("--waveform", "hole.csv"), "line 3: '' is no number"),
        (("--waveform", "nan.csv"), "sample 2 of the waveform is missing"),
    ],
)
def test_what_cannot_be_meant_ends_in_one_message(
    fork: Path, options: tuple[str, ...], words: str
) -> None:
    for name, text in (
        ("blood.yaml", "model: carreau\n"),
        ("ink.yaml", "model: honey\n"),
        ("odd.yaml", "model: carreau\nrest_mpa_s: 3\n"),
        ("torn.yaml", "[1,2\n"),
        ("empty.yaml", "\n"),
        ("short.csv", "vessel,pressure_mmhg\n1,0\n"),
        ("wrong.csv", "node,pressure_mmhg\n1,0\n"),
        ("odd.csv", "node,flow\n1,0\n"),
        ("text.csv", "node,pressure_mmhg\n2,low\n"),
        ("back.csv", "time_s,flow_ml_min\n0,1\n0.5,-1\n1,1\n"),
        ("hole.csv", "time_s,flow_ml_min\n0,1\n0.5,\n1,1\n"),
        ("nan.csv", "time_s,flow_ml_min\n0,1\n0.5,nan\n1,1\n"),
    ):
        (fork / name).write_text(text)
    _refused(fork, words, *options)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ((*ROWS, "3,3,4,4,7,7,4,7,7,0.3,0.3,artery,0\n"), "zero length"),
        ((ROWS[0], ROWS[1].replace("0.4,0.4", "0,0"), ROWS[2]), "radius"),
        ((*ROWS, "3,4,5,1,1,1,2,2,2,0.3,0.3,artery,0\n4,5,6,2,2,2,2,1,5,0.3,0.3,artery,0\n"
          "5,6,4,2,1,5,1,1,1,0.3,0.3,artery,0\n"),
         "isolated part without inlet"),
    ],
)  # fmt: skip
def test_networks_that_carry_no_flow_are_refused_by_vessel(
    fork: Path, rows: tuple[str, ...], words: str
) -> None:
    (fork / "fork.csv").write_text(HEAD + "".join(rows))
    _refused(fork, words, code=1)


def _refused(folder: Path, words: str, *options: str, code: int = 2) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=folder)
    assert done.returncode == code, done.stdout
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""
