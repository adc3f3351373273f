"""Aerotech program file in the simulation: interpretation and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from design.toolpath import MoveKind
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import FileController, Plunger, Printer, Syringe, load
from sim.errors import GcodeError
from sim.gcode.dry_run.run import dry_run
from sim.gcode.heads import CLOSED, OPEN
from sim.gcode.program.modal import DWELL, MOVE, SYNC
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block

A3200, SYRINGE = load(Printer, "aerotech_pneumatic"), load(Syringe, "hamilton_1ml")
START = (60.0, 70.0, 30.0)
NEWER = A3200.model_copy(
    update={
        "file_controller": FileController(controller="automation1", plunger_axis="A"),
        "dispenser": Plunger(),
        "plunger_travel_mm": 60.0,
    }
)
FILE = b"""$DO[0].X=0
G71
G76
G90
VELOCITY ON
G92 X60 Y70 Z30
G1 X61 Y72 F20
WAIT MOVEDONE X Y Z
$DO[0].X=1
G4 P0.03
G1 X66 F2.5 // written
WAIT MOVEDONE X Y Z
$DO[0].X=0
DWELL 0.5
//LAYER_END:1
G1 Z35 F20
"""


def test_a_file_is_read_as_it_is_meant() -> None:
    run = dry_run(FILE, A3200, START)
    program = run.program
    assert not run.findings
    moves = program.kind == MOVE
    assert program.line[moves].tolist() == [7, 11, 16]
    assert program.target[moves][:, :3].tolist() == [[61, 72, 30], [66, 72, 30], [66, 72, 35]]
    np.testing.assert_allclose(program.feed[moves], [20, 2.5, 20])
    assert program.value[program.kind == DWELL].tolist() == [0.03, 0.5]
    assert program.line[program.kind == SYNC].tolist() == [8, 12]
    assert run.valve is not None
    assert run.valve.state.tolist() == [CLOSED, OPEN, CLOSED]
    assert program.line[run.valve.row].tolist() == [1, 9, 13]
    assert program.line[run.doses & moves].tolist() == [11]
    # 2.24 and 5 mm at 20 mm/s, 5 mm at 2.5 mm/s, two dwells, ramps, and 0.1 s after each stop
    # that Marlin's planner waits for a second block.
    assert 2.85 < run.duration_s < 3.3


def test_what_isnt_known_is_refused_by_name() -> None:
    text = b"M104 S20\nG21\nX5 Y3\nG1 Q4\nG28\nLINEAR X1\nG2 X1 I1\nG1 E4\nG91 G1 X1\nM400\n"
    names = ["M104", "G21", "X5", "G1", "G28", "LINEAR", "G2", "G1", "G91", "M400"]
    run = dry_run(text, A3200, START)
    assert [name for _, name in run.unknown] == names
    assert {finding.code for finding in run.findings} == {"unknown_command"}
    assert not (run.program.kind == MOVE).any()


@pytest.mark.parametrize("printer", [A3200, NEWER])
def test_a_whole_job_of_the_writer_passes(printer: Printer) -> None:
    toolpath = fresh_toolpath(as_solid(block(3, 3, 0.18)), FreshOptions())
    options = GcodeOptions(start_mm=START, flow_ul_s=0.12)
    data = write_gcode(toolpath, printer, SYRINGE, (60, 70, 20), options).data
    run = dry_run(data, printer, START)
    assert not run.findings
    assert run.unknown == ()
    volume = toolpath.volume_ul
    if printer.pneumatic is None:
        pushed = np.pi / 4 * SYRINGE.inner_mm**2 * run.program.pushed[run.doses].sum()
        assert pushed == pytest.approx(volume[volume > 0].sum(), rel=1e-3)
    else:
        before = np.vstack([run.program.start, run.program.target[:-1]])
        way = np.linalg.norm((run.program.target - before)[:, :3], axis=1)
        seconds = (way / run.program.feed)[run.doses & (run.program.kind == MOVE)].sum()
        wanted = volume[toolpath.kind == MoveKind.WRITE].sum()
        assert 0.12 * seconds == pytest.approx(wanted, rel=1e-3)


def test_lines_dont_have_to_come_by_a_wire() -> None:
    """Many short moves: a serial line of 9600 baud would starve the planner."""
    text = b"".join(b"G1 X%.4f F20\n" % (60 + 0.01 * k) for k in range(1, 500))
    slow = A3200.model_copy(update={"baud": 9600})
    assert dry_run(text, slow, START).duration_s == dry_run(text, A3200, START).duration_s


def test_a_profile_that_doesnt_say_its_controller_is_refused() -> None:
    with pytest.raises(GcodeError, match="which controller"):
        dry_run(FILE, A3200.model_copy(update={"file_controller": None}), START)
