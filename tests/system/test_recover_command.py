"""Recovery after a printer reset, from a checkpoint, by the command line alone."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from sim.gcode.dry_run.run import dry_run
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.simulated import HEADER, START
from tests.sim_process import printer_process
from tests.system.cli import called as in_this_process
from tests.system.cli import printctl, recipe_file

PRINTER = load(Printer, "generic_marlin")
DATA = layered(4, 60)
TIP = ",".join(f"{value:g}" for value in START)


def called(told: str, **by: float) -> bytes:
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
        pytest.param(called("G92 X30 E0", X=-20), id="X alone, elsewhere", marks=pytest.mark.slow),
        pytest.param(called("G92 Z0 E0", Z=-10), id="Z alone, from 0", marks=pytest.mark.slow),
        pytest.param(
            called("G92 X0 Y0 E0", X=-50, Y=-50), id="X and Y from 0", marks=pytest.mark.slow
        ),
        pytest.param(
            called("G92 Y12.34567 E0", Y=-37.65433),
            id="Y alone, between two steps",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_rest_of_a_print_that_was_reset_is_printed_by_its_own_command(tmp_path, data):
    job = tmp_path / "job.gcode"
    job.write_bytes(data)
    given = ("--printer", "generic_marlin", "--start", TIP, "--yes")
    with printer_process(
        tmp_path, "--exit-on-hangup", "--start", TIP, "--fault", "reset@190"
    ) as port:
        broken = in_this_process(
            "print", job, "--port", port, *given, "--checkpoint-every", "0", cwd=tmp_path
        )
    assert broken.returncode == 4, broken.stderr
    assert "position_unknown" in broken.stderr
    made = in_this_process("recover", job, "--yes", "--json", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "straight up" in made.stderr
    assert f"new file calls X{START[0]:g} Y{START[1]:g} Z{START[2]:g}" in made.stderr
    plan = json.loads(made.stdout)

    rest = Path(plan["file"])
    assert plan["command"].startswith(f"printctl print {rest} ")
    assert plan["command"].endswith(f"--start {TIP}")
    done = in_this_process("print", rest, "--port", "simulated", *given, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    motion = ExecutedMotion.load(tmp_path / "job.rest.gcode.print" / "executed.npz")
    foreseen = dry_run(DATA, PRINTER, START).executed
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
