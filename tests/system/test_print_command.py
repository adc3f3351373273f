"""`printctl print` through the simulated printer's pseudo-terminal, with and without faults."""

import json
from pathlib import Path

import numpy as np

from sim.gcode.motion.executed import ExecutedMotion
from tests.sim_process import printer_process
from tests.system.cli import called, printctl

MOVES = 400


def _job(folder: Path) -> Path:
    """A zigzag of `MOVES` moves with ink."""
    lines = ["G21", "G90", "M82", "M302 P1", "G92 X0 Y0 Z0 E0"]
    lines += [
        f"G1 X{10 * (k % 2)} Y{0.1 * k:.1f} E{0.01 * k:.4f} F1200" for k in range(1, MOVES + 1)
    ]
    path = folder / "job.gcode"
    path.write_text("\n".join([*lines, "M400"]) + "\n")
    return path


def test_every_line_is_executed_once(tmp_path: Path) -> None:
    with printer_process(
        tmp_path, "--exit-on-hangup", "--record", str(tmp_path / "done.npz")
    ) as port:
        done = printctl(
            "print", _job(tmp_path), "--printer", "generic_marlin", "--port", port, "--yes",
            "--json", cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["state"] == "done"
    motion = ExecutedMotion.load(tmp_path / "done.npz")
    assert len(motion) == MOVES
    np.testing.assert_array_equal(np.diff(motion.line), 1)
    np.testing.assert_allclose(motion.plunger_end[-1], 0.01 * MOVES, atol=1 / 6400)


def test_port_that_goes_away_ends_with_the_last_line_known(tmp_path: Path) -> None:
    with printer_process(tmp_path, "--exit-on-hangup", "--fault", "unplug@200") as port:
        done = called(
            "print", _job(tmp_path), "--printer", "generic_marlin", "--port", port, "--yes",
            cwd=tmp_path,
        )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert f"of {MOVES + 6} lines taken" in done.stderr
    assert "journal" in done.stderr


def test_simulated_port_needs_no_set_up(tmp_path: Path) -> None:
    done = called(
        "print", _job(tmp_path), "--printer", "generic_marlin", "--port", "simulated", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "job.gcode.print" / "executed.npz").exists()


def test_refused_job_never_reaches_the_printer(tmp_path: Path) -> None:
    path = tmp_path / "bad.gcode"
    path.write_text("G90\nM82\nG92 X0 Y0 Z0 E0\nG28\nG1 X999 F600\n")
    done = called("print", path, "--printer", "generic_marlin", "--port", "simulated", cwd=tmp_path)
    assert done.returncode == 3, done.stderr
    assert "homing" in done.stderr
    assert "line 5" in done.stderr
    assert not (tmp_path / "bad.gcode.print").exists()
