"""Planar example printed on a simulated Duet and a simulated Klipper.

Its first lines, with every sort of line that it has; PRINTCTL_TEST_WHOLE=1 prints all 15,370.
"""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from sim.gcode.dry_run.run import dry_run
from sim.gcode.motion.executed import ExecutedMotion
from tests.system.cli import printctl, recipe_file

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
