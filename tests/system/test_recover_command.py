"""A print whose printer was reset is gone on with from a checkpoint, by the command line alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from firmware_profiles import Printer, load
from sim.dryrun import dry_run
from sim.executed import ExecutedMotion
from tests.printctl.link.layered import START, layered
from tests.sim_process import printer_process
from tests.system.cli import printctl

PRINTER = load(Printer, "generic_marlin")
DATA = layered(4, 60)
TIP = ",".join(f"{value:g}" for value in START)


def test_rest_of_a_print_that_was_reset_is_printed_by_its_own_command(tmp_path: Path) -> None:
    job = tmp_path / "job.gcode"
    job.write_bytes(DATA)
    given = ("--printer", "generic_marlin", "--start", TIP, "--yes")
    with printer_process(
        tmp_path, "--exit-on-hangup", "--start", TIP, "--fault", "reset@190"
    ) as port:
        broken = printctl(
            "print", job, "--port", port, *given, "--checkpoint-every", "0", cwd=tmp_path
        )
    assert broken.returncode == 4, broken.stderr
    assert "position_unknown" in broken.stderr
    made = printctl("recover", job, "--yes", "--json", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "straight up" in made.stderr
    plan = json.loads(made.stdout)

    rest = Path(plan["file"])
    done = printctl("print", rest, "--port", "simulated", *given, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    motion = ExecutedMotion.load(tmp_path / "job.rest.gcode.print" / "executed.npz")
    foreseen = dry_run(DATA, PRINTER, START).executed
    left = foreseen.line >= plan["lines_left_out"]
    np.testing.assert_array_equal(motion.end[-np.count_nonzero(left) :], foreseen.end[left])
