"""Pulsatile flow: recipe section `flow.pulse` and `printctl flow`."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from design.hemodynamics import FlowConditions, OutletLoad
from design.hemodynamics.three_d.ranks import (
    RankOptions,
    RankResult,
    write_case,
)
from printctl.analysis.flow.ranks import Engine, find_engine, run_on_ranks
from printctl.analysis.networks import Drive, load_source
from printctl.errors import PrintctlError, UsageError
from printctl.recipe.parts import FlowPart
from tests.design.hemodynamics.three_d.lumens import bend, pipe
from tests.system.cli import called as printctl

FORK = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n"
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n"
    "2,1,3,7,7,3,4,7,7,0.4,0.4,artery,0\n"
)
VEINS = (
    "3,5,4,10,8,7,7,8,3,0.4,0.4,vein,1\n"
    "4,6,4,4,8,7,7,8,3,0.4,0.4,vein,1\n"
    "5,4,7,7,8,3,7,8,0,0.5,0.5,vein,1\n"
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
    assert len(json.loads((fork / "case.json").read_text())["vessels"]) == len(rows)


def test_a_steady_case_for_another_solver_gives_the_steady_flow(fork: Path) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", "--svzerod", "case.json",
                    "--svmultiphysics", "sv", "--json", cwd=fork)  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    drop, case = summary["pressure_drop_pa"], summary["svmultiphysics"]
    assert (fork / "sv" / "solver.xml").is_file()
    # Its elements are straight: an inlet of some nine sides.
    assert 0.9 < case["volume_share"] < 0.95
    assert 0.9 < case["inlet_area_share"] < 0.95
    assert f"hold {case['volume_share']:.1%} of the lumen" in summary["notes"][0]
    assert "--edge-ratio" in summary["notes"][0]
    svzerod = pytest.importorskip("svzerod", reason="the solver's package isn't installed")
    table = svzerod.simulate(json.loads((fork / "case.json").read_text()))
    assert table["pressure_in"][0] == pytest.approx(10 * drop, rel=1e-6)


def test_a_vessel_drawn_backwards_is_noted_by_its_nodes(fork: Path) -> None:
    head, *rows = FORK.splitlines()
    back = "1,2,1,10,7,7,7,7,3,0.4,0.4,artery,0"
    series = [head, rows[0], back, "2,2,3,10,7,7,12,7,7,0.4,0.4,artery,0"]
    (fork / "back.csv").write_text("\n".join(series) + "\n")
    done = printctl("flow", "back.csv", "--unit", "mm", "--json", cwd=fork)
    (note,) = json.loads(done.stdout)["notes"]
    assert "direction alone: 2 (node 2 at (10, 7, 7) mm is an inlet, as vessels 1, 2 all" in note
    assert "node 1 at (7, 7, 3) mm is an outlet, as vessels 0, 1 all end there" in note


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
        (
            ("--fluid", "fluid.yaml"),
            "at most 0.8; mend the numbers of model: pries_1994",
        ),
        (("--viscosity-mpa-s", "1000", "--inlet-flow-ml-min", "9999"), "mmHg"),
    ],
)
def test_mistakes_end_in_one_message(fork: Path, options: tuple[str, ...], words: str) -> None:
    (fork / "wave.csv").write_text("time_s,flow_ml_min\n0,1\n0.5,\n1,1\n")
    (fork / "other.csv").write_text("time_s,flow_ml_min\n0,1\n0.5,3\n1,1\n")
    (fork / "fluid.yaml").write_text("model: pries_1994\nhaematocrit: 5\n")
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""


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


# --- 1D flow: recipe section `flow.one_d` and `printctl flow --one-d`
GEL = ("--wall-young-kpa", "10")


def test_waves_leave_tables_and_the_case_for_another_solver(fork: Path) -> None:
    done = printctl(
        "flow", "fork.csv", "--unit", "mm", *SINE, *GEL, "--one-d", "--svoned", "case.in",
        "--wall-viscosity-pa-s", "0", "--json", cwd=fork,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    waves, lumped = found["one_d"], found["pulsatile"]
    assert waves["inlet_flow_amplitude_ml_min"] == pytest.approx(0.1, rel=1e-3)
    # Short channels under slow pulses: the lumped model is right, but for what inertia weighs.
    assert waves["inlet_pulse_mmhg"] == pytest.approx(lumped["inlet_pulse_mmhg"], rel=0.03)
    assert waves["mass_imbalance"] < 1e-9
    with (fork / "flow" / "flow_1d.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert float(rows[1]["flow_mean_ml_min"]) == pytest.approx(0.125, rel=1e-4)
    # √(E/(2 ϱ (1 + ν))), whatever the radius.
    assert float(rows[2]["wave_speed_mm_s"]) == pytest.approx(1773, rel=1e-3)
    assert len((fork / "flow" / "flow_1d_waves.csv").read_text().splitlines()) == 101
    assert (fork / "case.in").read_text().startswith("MODEL case_\n")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--one-d",), "--one-d follows a pulse"),
        ((*SINE, "--one-d"), "--wall-young-kpa"),
        ((*SINE, *GEL, "--cell-mm", "1"), "--cell-mm is for --one-d"),
        ((*SINE, *GEL, "--one-d", "--cell-mm", "-1"), "--cell-mm: must be above"),
        (("--svoned", "x.in"), "--svoned writes a pulsatile problem"),
        ((*SINE, *GEL, "--svoned", "x.in", "--one-d", "--wall-viscosity-pa-s", "5"), "no viscous"),
    ],
)
def test_mistakes_end_in_one_message_one_d(
    fork: Path, options: tuple[str, ...], words: str
) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=fork)
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""


# --- options of `printctl flow`: inlet pressure, outlets, fluids, losses, wall shear range
HEAD = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
ROWS = (
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n",
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n",
    "2,1,3,7,7,3,4,7,7,0.4,0.4,artery,0\n",
)


@pytest.fixture
def fork_options(tmp_path: Path) -> Path:
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
def test_an_inlet_can_be_driven_by_pressure_steadily_and_in_pulses(fork_options: Path) -> None:
    by_flow = _flow(fork_options, "--inlet-flow-ml-min", "2")
    drop = str(by_flow["pressure_drop_mmhg"])
    again = _flow(fork_options, "--inlet-pressure-mmhg", drop)
    assert again["inflow_ml_min"] == pytest.approx(2, rel=1e-9)
    (fork_options / "wave.csv").write_text(f"time_s,pressure_mmhg\n0,{drop}\n1,{drop}\n")
    found = _flow(fork_options, "--inlet-pressure-mmhg", drop, "--waveform", "wave.csv")[
        "pulsatile"
    ]
    assert found["inlet_flow_mean_ml_min"] == pytest.approx(2, rel=1e-6)
    sine = _flow(fork_options, "--inlet-pressure-mmhg", drop, "--amplitude-mmhg", "0.001",
                 "--period-s", "1")["pulsatile"]  # fmt: skip
    assert sine["inlet_pulse_mmhg"] == pytest.approx(0.002, rel=1e-3)


def test_outlets_take_what_lies_behind_them_from_a_table(fork_options: Path) -> None:
    """Resistances of 1 and 3 mmHg·min/mL, far above the vessels': the flow divides 3:1."""
    (fork_options / "outlets.csv").write_text(
        "node,resistance_mmhg_min_ml,proximal_mmhg_min_ml,compliance_ml_mmhg\n"
        "2,1000,,\n3,2500,500,0.0001\n"
    )
    found = _flow(fork_options, "--outlets", "outlets.csv", *SINE)
    rows = _rows(fork_options / "flow" / "flow.csv")
    assert float(rows[1]["flow_ml_min"]) / float(rows[2]["flow_ml_min"]) == pytest.approx(
        3, rel=1e-3
    )
    assert found["energy_imbalance"] < 1e-9
    waves = _rows(fork_options / "flow" / "flow_pulsatile.csv")
    assert float(waves[1]["flow_mean_ml_min"]) == pytest.approx(
        float(rows[1]["flow_ml_min"]), rel=1e-9
    )
    behind = _flow(
        fork_options, "--outlet-resistance-mmhg-min-ml", "8", "--outlet-pressure-mmhg", "5"
    )
    # 0.125 mL/min through each 8 mmHg·min/mL.
    assert float(
        _rows(fork_options / "flow" / "flow.csv")[1]["pressure_out_mmhg"]
    ) == pytest.approx(6)
    assert behind["mass_imbalance"] < 1e-12


def test_a_fluid_and_losses_come_from_files_and_options(fork_options: Path) -> None:
    (fork_options / "blood.yaml").write_text("model: carreau\n")
    water = _flow(fork_options, "--viscosity-mpa-s", "1")
    blood = _flow(fork_options, "--fluid", "blood.yaml")
    assert blood["pressure_drop_pa"] > 3.45 * water["pressure_drop_pa"]
    narrow = _flow(
        fork_options, "--viscosity-mpa-s", "1", "--stenosis", "1,0.3,1", "--junction-k", "1"
    )
    assert narrow["pressure_drop_pa"] > water["pressure_drop_pa"]
    assert 0 < narrow["losses_share"] < 1
    assert "losses_share" not in water
    rows = _rows(fork_options / "flow" / "flow.csv")
    assert float(rows[1]["flow_ml_min"]) < float(rows[2]["flow_ml_min"])
    assert float(rows[1]["loss_pa"]) > 0


def test_a_band_of_wall_shear_gets_a_verdict(fork_options: Path) -> None:
    """At 0.25 mL/min of 1 mPa·s the trunk has 4μQ/(πr³) = 0.0424 Pa and the branches 0.0414 Pa."""
    water = ("--viscosity-mpa-s", "1", "--shear-band-dyn-cm2")
    found = _flow(fork_options, *water, "0.42,1")
    band = found["shear_band"]
    assert band["verdict"] == "mixed"
    assert band["vessels_inside"] == pytest.approx(1 / 3)
    area = 3 * 0.5 / (3 * 0.5 + 2 * 5 * 0.4)
    assert band["area_inside"] == pytest.approx(area)
    places = [row["wall_shear_band"] for row in _rows(fork_options / "flow" / "flow.csv")]
    assert places == ["inside", "below", "below"]
    assert _flow(fork_options, *water, "0.1,0.2")["shear_band"]["verdict"] == "above"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--outlet-pressure-mmhg", "10"), "the flow goes backwards, in at outlets"),
        (("--amplitude-mmhg", "9", "--period-s", "1"), "back out of the inlets for 31% of the"),
        (("--outlets", "high.csv"), "flow enters by 1 of 2 outlets (node 3)"),
        ((), ""),
    ],
)
def test_flow_that_goes_backwards_is_told(
    fork_options: Path, options: tuple[str, ...], words: str
) -> None:
    (fork_options / "high.csv").write_text("node,pressure_mmhg\n2,0\n3,6\n")
    call = ("flow", "fork.csv", "--unit", "mm", "--inlet-pressure-mmhg", "5", *options, "--json")
    done = printctl(*call, cwd=fork_options)
    assert done.returncode == 0
    assert words in done.stderr
    notes = json.loads(done.stdout).get("notes", [])
    assert bool(notes) == bool(words)
    assert all(note in done.stderr for note in notes)


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
    fork_options: Path, options: tuple[str, ...], words: str
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
        (fork_options / name).write_text(text)
    _refused(fork_options, words, *options)


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
    fork_options: Path, rows: tuple[str, ...], words: str
) -> None:
    (fork_options / "fork.csv").write_text(HEAD + "".join(rows))
    _refused(fork_options, words, code=1)


def _refused(folder: Path, words: str, *options: str, code: int = 2) -> None:
    done = printctl("flow", "fork.csv", "--unit", "mm", *options, cwd=folder)
    assert done.returncode == code, done.stdout
    assert "Traceback" not in done.stderr
    assert words in done.stderr
    assert done.stdout == ""


# --- mPI ranks: start and end; the solver itself where FEniCSx is installed
RADIUS, LENGTH, FLOW, VISCOSITY = 0.2, 0.6, 4.0, 1e-3
MESH = pipe(2, 5, RADIUS, LENGTH)


@pytest.fixture
def case_ranks(tmp_path) -> Path:
    write_case(MESH, FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW), tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def engine() -> Engine:
    """FEniCSx, where it is; .ci/run installs it."""
    try:
        found = find_engine()
    except PrintctlError as exc:
        pytest.skip(f"no FEniCSx: {exc}")
    if not (shutil.which("mpirun") or shutil.which("mpiexec")):
        pytest.skip("no mpirun")
    return found


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{text}")
    path.chmod(0o755)
    return path


@pytest.fixture
def stand_in(tmp_path) -> Path:
    """A Python that claims dolfinx, and beside it an mpirun that runs `job.py` instead."""
    home = tmp_path / "conda" / "bin"
    script(home / "mpirun", "import sys, runpy\n"
           "print('other MPI') if '--version' in sys.argv else "
           f"runpy.run_path({str(tmp_path / 'job.py')!r})\n")  # fmt: skip
    return script(home / "python", "print('9.9.9')\n")


def test_without_fenicsx_the_message_says_how_to_install_it(tmp_path, monkeypatch):
    bare = script(tmp_path / "python", "raise ModuleNotFoundError('dolfinx')\n")
    with pytest.raises(PrintctlError, match=r"doesn't import dolfinx \(ModuleNot.*apt-get install"):
        find_engine(bare)
    with pytest.raises(PrintctlError, match="no such file"):
        find_engine(tmp_path / "nothing")
    monkeypatch.setattr("printctl.analysis.flow.ranks._places", lambda: iter([bare]))
    monkeypatch.delenv("PRINTCTL_DOLFINX_PYTHON", raising=False)
    with pytest.raises(PrintctlError, match=r"no Python with FEniCSx.*conda create"):
        find_engine()


@pytest.mark.parametrize("ranks", [0, 1 + (os.cpu_count() or 1)])
def test_more_ranks_than_processors_are_refused(case_ranks, ranks):
    with pytest.raises(UsageError, match=f"{ranks} ranks on .* processors; give 1 to"):
        run_on_ranks(case_ranks, ranks)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "end"])
def test_what_ends_us_ends_the_ranks(case_ranks, stand_in, tmp_path, how):
    (tmp_path / "job.py").write_text("import os, time\nprint(os.getpid(), flush=True)\n"
                                     "time.sleep(30)")  # fmt: skip
    # What runs in the background of a shell is begun deaf to Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    begun = []

    def struck(line: str) -> None:
        begun.append(int(line))
        signal.raise_signal(how)

    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)):
            run_on_ranks(case_ranks, 1, stand_in, struck)
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(begun[0], 0)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def solved(
    folder: Path, engine: Engine, ranks: int, driven: FlowConditions, mesh=MESH, **options
) -> RankResult:
    write_case(mesh, driven, folder, RankOptions(**options))
    return run_on_ranks(folder, ranks, engine.python)


def test_poiseuilles_pressure_drop_comes_out(engine, tmp_path):
    told = []
    driven = FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW, outlet_pressure_pa=5.0)
    write_case(MESH, driven, tmp_path)
    found = run_on_ranks(tmp_path, 1, engine.python, told.append)
    drop = 8.0 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    assert found.port_pressure[0] - found.port_pressure[1] == pytest.approx(drop, rel=5e-3)
    assert found.port_pressure[1] == pytest.approx(5.0, abs=1e-2 * drop)
    assert found.port_flow == pytest.approx([-FLOW, FLOW], rel=1e-9)
    # Nodes keep the mesh's own numbers: the parabola along, linear pressure.
    r = np.hypot(*MESH.points[:, :2].T)
    exact = 2.0 * FLOW / (np.pi * RADIUS**2) * (1.0 - (r / RADIUS) ** 2)
    assert np.abs(found.velocity[:, 2] - exact).max() < 0.02 * exact.max()
    corners = MESH.points[: MESH.corner_count]
    line = 5.0 + drop * (1.0 - corners[:, 2] / LENGTH)
    assert np.abs(found.pressure - line).max() < 0.02 * drop
    assert any("unknowns" in line for line in told)
    assert found.report["solver"] == "direct"
    assert len(found.report["memory_mb"]) == 1


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_two_ranks_find_what_one_does_by_either_solver(engine, tmp_path):
    mesh = bend(2, 3, RADIUS, LENGTH, 1.0)
    driven = FlowConditions(VISCOSITY, inlet_flow_ul_s=FLOW, behind={1: OutletLoad(2.0, 1.0)})
    one = solved(tmp_path / "one", engine, 1, driven, mesh)
    for solver in ("direct", "iterative"):
        two = solved(tmp_path / solver, engine, 2, driven, mesh, solver=solver)
        assert two.report["ranks"] == 2
        assert len(two.report["memory_mb"]) == 2
        assert np.abs(two.pressure - one.pressure).max() < 1e-6 * np.abs(one.pressure).max()
        assert np.abs(two.velocity - one.velocity).max() < 1e-6 * np.abs(one.velocity).max()
    # p = 1 + 2 Q at the mean of the port, to the discretisation.
    assert one.port_pressure[1] == pytest.approx(1.0 + 2.0 * FLOW, rel=1e-2)
    # At Re = 12 a bend costs more than a straight pipe.
    straight = 8.0 * VISCOSITY * LENGTH * FLOW / (np.pi * RADIUS**4)
    assert one.port_pressure[0] - one.port_pressure[1] > straight


@pytest.mark.slow
def test_an_outlets_flow_and_given_pressures_come_out(engine, tmp_path):
    drawn = FlowConditions(VISCOSITY, inlet_pressure_pa=9.0, outlet_flow_ul_s={1: FLOW})
    found = solved(tmp_path, engine, 1, drawn, model="stokes")
    assert found.port_flow == pytest.approx([-FLOW, FLOW], rel=1e-9)
    pressure = found.port_pressure.tolist()
    driven = FlowConditions(
        VISCOSITY, inlet_pressure_pa=pressure[0], outlet_pressure_pa=pressure[1]
    )
    again = solved(tmp_path, engine, 1, driven, model="stokes")
    assert again.port_flow == pytest.approx(found.port_flow, rel=1e-3)


def test_a_vein_that_no_artery_joins_drains_what_the_artery_brings(tmp_path: Path) -> None:
    """Its terminals are inlets; at the artery's pressure they would take most of the inflow."""
    (tmp_path / "pair.csv").write_text(FORK + VEINS)
    done = printctl("flow", "pair.csv", "--unit", "mm", *SINE, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "flow" / "flow.csv").open() as handle:
        flow = [float(row["flow_ml_min"]) for row in csv.DictReader(handle)]
    assert flow == pytest.approx([0.25, 0.125, 0.125, 0.125, 0.125, 0.25])
    with (tmp_path / "flow" / "flow_pulsatile.csv").open() as handle:
        mean = [float(row["flow_mean_ml_min"]) for row in csv.DictReader(handle)]
    assert mean == pytest.approx(flow)
    (note,) = json.loads(done.stdout)["notes"]
    assert "no artery joins the veins (tree 1): they drain" in note
    assert "0.25 mL/min" in note
    known = load_source(tmp_path / "pair.csv", "mm", Drive(inlet_flow_ml_min=0.5)).known
    assert known.flow["flow_ml_min"] == pytest.approx([2 * q for q in flow])
    driven = printctl(
        "flow", "pair.csv", "--unit", "mm", "--inlet-pressure-mmhg", "9", cwd=tmp_path
    )
    assert driven.returncode == 2, driven.stderr
    assert "tree 1 is a vein that no artery joins" in driven.stderr
    (tmp_path / "vein.csv").write_text(FORK.splitlines()[0] + "\n" + VEINS)
    alone = printctl("flow", "vein.csv", "--unit", "mm", "--json", cwd=tmp_path)
    assert json.loads(alone.stdout)["inflow_ml_min"] == pytest.approx(0.25), alone.stderr
