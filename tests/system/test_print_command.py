"""`printctl print` and `recover`: an embedded print, a zigzag and planar examples, simulated."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.gcode import GcodeOptions, save_gcode, write_gcode
from firmware_profiles import Ink, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from gcode.motion.executed import ExecutedMotion
from printctl.checks.preflight import written_arrays
from tests.design.toolpath.shapes import random_tree
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.simulated import HEADER
from tests.printctl.machine.link.simulated import START as LAYERED_START
from tests.sim_process import printer_process
from tests.system.cli import called, printctl, recipe_file

# --- a print of vessels that was broken off: what the rest's needle meets can be looked at
START = (60.0, 60.0, 90.0)
PLACE = np.array([80.0, 80.0, 40.0])
TIP = ",".join(f"{value:g}" for value in START)
FILLED = ("--syringe", "hamilton_1ml", "--ink", "collagen_fresh", "--for-mounted")
MOUNTED = (*FILLED, "--needle", "30g_50mm", "--bath", "gelatin_support", "--dish", "box_80mm")
"""What a print on a port that isn't the simulated one must name."""
UNSEEN = "collisions of the shaft with printed vessels weren't checked"


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job of vessels whose printer was reset in mid-print."""
    folder = tmp_path_factory.mktemp("job")
    net, options = random_tree(12, 12.0, 3, 0.1), EmbeddedOptions(overlap_radii=0.5, open_joints=99)
    flow = load(Ink, "gelatin_sacrificial").flow_factor
    made = write_gcode(
        plan_embedded(net, options).toolpath,
        load(Printer, "generic_marlin"),
        load(Syringe, "hamilton_1ml"),
        PLACE,
        GcodeOptions(start_mm=START, flow_factor=flow),
    )
    needle = (options.needle_outer_mm, options.needle_outer_mm, 0.0)
    beside = written_arrays(net, PLACE, options.overlap_radii, options.clearance_mm, [needle])
    job = folder / "job.gcode"
    save_gcode(job, folder / "job.map.npz", [made], beside)
    given = ("--printer", "generic_marlin", "--start", TIP, "--yes", "--checkpoint-every", "0")
    cut = made.line_count // 2 + 10
    with printer_process(
        folder, "--exit-on-hangup", "--start", TIP, "--fault", f"reset@{cut}"
    ) as port:
        done = called("print", job, "--port", port, *given, *MOUNTED, cwd=folder)
    assert done.returncode == 4, done.stderr
    return job


def rest_of(job: Path, *more: str) -> dict[str, object]:
    done = called("recover", job, "--yes", "--json", *more, cwd=job.parent)
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_rest_has_the_map_of_its_lines_and_its_shaft_is_checked(broken: Path) -> None:
    rest = Path(str(rest_of(broken)["file"]))
    job, lines = broken.read_text().splitlines(), rest.read_text().splitlines()
    title = re.search(r"from its line (\d+)", lines[0])
    assert title is not None
    kept = len(job) + 1 - int(title[1])
    assert lines[-kept:] == job[-kept:]
    assert sources(rest)[-kept:] == sources(broken)[-kept:]
    assert set(sources(rest)[:-kept]) == {-1}
    assert kept > 30
    checked = called(
        "simulate", rest, "--printer", "generic_marlin", "--start", TIP, cwd=rest.parent
    )
    assert checked.returncode == 0, checked.stderr
    assert UNSEEN not in checked.stdout + checked.stderr
    assert "moves checked" in checked.stdout + checked.stderr


def test_of_vessels_written_twice_it_says_where_the_needle_does_least_harm(broken: Path) -> None:
    plan = rest_of(broken)
    told = " ".join(plan["steps"])  # type: ignore[arg-type]
    line = re.search(r"It does so least with --from-line (\d+)", told)
    assert "passed through by the needle" in told
    assert line is not None
    later = rest_of(broken, "--from-line", line[1])
    assert int(str(later["lines_left_out"])) > int(str(plan["lines_left_out"]))
    assert "It does so least" not in " ".join(later["steps"])  # type: ignore[arg-type]


def test_a_map_of_another_job_is_not_handed_on(broken: Path) -> None:
    own = broken.with_suffix(".map.npz")
    kept = own.read_bytes()
    rest = Path(str(rest_of(broken)["file"])).with_suffix(".map.npz")
    assert rest.is_file()
    with np.load(own) as found:
        arrays = {name: found[name] for name in found.files}
    try:
        np.savez(own, **arrays | {"source": arrays["source"][1:]})
        rest_of(broken)
        assert not rest.is_file()
    finally:
        own.write_bytes(kept)


def sources(job: Path) -> list[int]:
    with np.load(job.with_suffix(".map.npz")) as found:
        numbers: list[int] = found["source"].tolist()
    return numbers


# --- `printctl print` through the simulated printer's pseudo-terminal, with and without faults
MOVES = 400


def _job(folder: Path) -> Path:
    """A zigzag of `MOVES` moves with ink."""
    lines = ["G21", "G90", "M82", "M302 P1", "G92 X100 Y100 Z5 E0"]
    lines += [
        f"G1 X{100 + 10 * (k % 2)} Y{100 + 0.05 * k:.2f} E{0.01 * k:.4f} F1200"
        for k in range(1, MOVES + 1)
    ]
    path = folder / "job.gcode"
    path.write_text("\n".join([*lines, "G0 Z30 F300", "M400"]) + "\n")
    return path


def test_every_line_is_executed_once(tmp_path: Path) -> None:
    with printer_process(
        tmp_path, "--exit-on-hangup", "--record", str(tmp_path / "done.npz")
    ) as port:
        done = printctl(
            "print", _job(tmp_path), "--printer", "generic_marlin", "--port", port, "--yes",
            *MOUNTED, "--json", cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["state"] == "done"
    motion = ExecutedMotion.load(tmp_path / "done.npz")
    assert len(motion) == MOVES + 1  # and a lift
    np.testing.assert_array_equal(np.diff(motion.line), 1)
    np.testing.assert_allclose(motion.plunger_end[-1], 0.01 * MOVES, atol=1 / 6400)


def test_port_that_goes_away_ends_with_the_last_line_known(tmp_path: Path) -> None:
    with printer_process(tmp_path, "--exit-on-hangup", "--fault", "unplug@200") as port:
        done = called(
            "print", _job(tmp_path), "--printer", "generic_marlin", "--port", port, "--yes",
            *MOUNTED, cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert f"of {MOVES + 7} lines taken" in done.stderr
    assert "journal" in done.stderr


def test_simulated_port_needs_no_set_up(tmp_path: Path) -> None:
    done = called(
        "print", _job(tmp_path), "--printer", "generic_marlin", "--port", "simulated", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "job.gcode.print" / "executed.npz").exists()


def test_a_port_that_is_not_simulated_needs_needle_bath_and_dish(tmp_path: Path) -> None:
    done = called(
        "print", _job(tmp_path), "--printer", "generic_marlin", "--port", "/dev/ttyNONE9", "--yes",
        *FILLED, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    for option in ("--needle", "--bath", "--dish"):
        assert option in done.stderr
    none = ("--needle", "none", "--bath", "none", "--dish", "none")  # an air print
    done = called(
        "print", tmp_path / "job.gcode", "--printer", "generic_marlin", "--port", "/dev/ttyNONE9",
        "--yes", *FILLED, *none, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 4, done.stderr


def test_refused_job_never_reaches_the_printer(tmp_path: Path) -> None:
    path = tmp_path / "bad.gcode"
    path.write_text("G90\nM82\nG92 X0 Y0 Z0 E0\nG28\nG1 X999 F600\n")
    done = called("print", path, "--printer", "generic_marlin", "--port", "simulated", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "homing" in done.stderr
    assert "line 5" in done.stderr
    assert not (tmp_path / "bad.gcode.print").exists()


# --- recovery after a printer reset, from a checkpoint, by the command line alone
PRINTER = load(Printer, "generic_marlin")
DATA = layered(4, 60)
LAYERED_TIP = ",".join(f"{value:g}" for value in LAYERED_START)


def placed_job(told: str, **by: float) -> bytes:
    """The job with another first line, which calls places so many mm more."""
    text = DATA.replace(HEADER.splitlines()[-1], told.encode()).decode()
    for axis, mm in by.items():
        text = re.sub(
            rf"^(G[01] .*{axis})(\S+)",
            lambda found, mm=mm: f"{found[1]}{float(found[2]) + mm:.5f}",
            text,
            flags=re.MULTILINE,
        )
    return text.encode()


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(DATA, id="tells its place"),
        pytest.param(
            placed_job("G92 X30 E0", X=-20), id="X alone, elsewhere", marks=pytest.mark.slow
        ),
        pytest.param(placed_job("G92 Z0 E0", Z=-10), id="Z alone, from 0", marks=pytest.mark.slow),
        pytest.param(
            placed_job("G92 X0 Y0 E0", X=-50, Y=-50), id="X and Y from 0", marks=pytest.mark.slow
        ),
        pytest.param(
            placed_job("G92 Y12.34567 E0", Y=-37.65433),
            id="Y alone, between two steps",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_rest_of_a_print_that_was_reset_is_printed_by_its_own_command(tmp_path, data):
    job = tmp_path / "job.gcode"
    job.write_bytes(data)
    given = ("--printer", "generic_marlin", "--start", LAYERED_TIP, "--yes", *MOUNTED)
    with printer_process(
        tmp_path, "--exit-on-hangup", "--start", LAYERED_TIP, "--fault", "reset@190"
    ) as port:
        broken = called(
            "print", job, "--port", port, *given, "--checkpoint-every", "0", cwd=tmp_path
        )
    assert broken.returncode == 4, broken.stderr
    assert "position unknown" in broken.stderr
    made = called("recover", job, "--yes", "--json", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "straight up" in made.stderr
    x, y, z = LAYERED_START
    assert f"new file calls X{x:g} Y{y:g} Z{z:g}" in made.stderr
    plan = json.loads(made.stdout)

    rest = Path(plan["file"])
    assert plan["command"].startswith(f"printctl print {rest} ")
    assert plan["command"].endswith(f"--start {LAYERED_TIP}")
    done = called("print", rest, "--port", "simulated", *given, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    motion = ExecutedMotion.load(tmp_path / "job.rest.gcode.print" / "executed.npz")
    foreseen = dry_run(DATA, PRINTER, LAYERED_START).executed
    left = foreseen.line >= plan["lines_left_out"]
    ours = motion.end[-np.count_nonzero(left) :]
    np.testing.assert_allclose(ours, foreseen.end[left], rtol=0, atol=1e-9)
    per_mm = np.array([getattr(PRINTER.steps_per_mm, axis) for axis in "xyz"])
    steps = np.rint(ours * per_mm), np.rint(foreseen.end[left] * per_mm)
    np.testing.assert_array_equal(*steps)


# --- planar example printed on a simulated Duet and a simulated Klipper
_START = re.compile(r"(?:G92|SET_KINEMATIC_POSITION) X=?([\d.]+) Y=?([\d.]+) Z=?([\d.]+)")


LINES = 1500


def _part(text: str) -> str:
    """The first lines; all of them only where they are wanted."""
    lines = text.splitlines(keepends=True)
    if os.environ.get("PRINTCTL_TEST_WHOLE"):
        return text
    return "".join([*lines[:LINES], "M400\n"])


@pytest.mark.slow
@pytest.mark.parametrize(
    "profile",
    ["ender5_duet3_replistruder5", pytest.param("klipper_bioprinter", marks=pytest.mark.slow)],
)
def test_planar_example_is_printed_as_foreseen(profile: str, tmp_path: Path) -> None:
    recipe = recipe_file(tmp_path, "planar_fresh", printer={"profile": profile})
    done = printctl("toolpath", recipe, "--out", "part.gcode", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    text = _part((tmp_path / "part.gcode").read_text())
    (tmp_path / "part.gcode").write_text(text)
    assert "M85" not in text
    assert ("M302" in text) == (profile != "klipper_bioprinter")
    found = _START.search(text)
    assert found is not None
    done = printctl(
        "print", "part.gcode", "--printer", profile, "--port", "simulated", "--json",
        "--start", ",".join(found.groups()), cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "note: " in done.stderr  # what no job can set is said before the print
    assert json.loads(done.stdout)["state"] == "done"
    x, y, z = (float(word) for word in found.groups())
    planned = dry_run(text.encode(), load(Printer, profile), (x, y, z)).executed
    motion = ExecutedMotion.load(tmp_path / "part.gcode.print" / "executed.npz")
    np.testing.assert_allclose(motion.end, planned.end, atol=1e-6)
    np.testing.assert_allclose(motion.plunger_end, planned.plunger_end, atol=1e-6)
