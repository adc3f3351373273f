"""Simulated Duet, Klipper, Aerotech program: differences from Marlin, refusals, complete prints."""

import re

import numpy as np
import pytest

from design.toolpath import MoveKind
from design.toolpath.fresh import FreshOptions
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import FileController, Plunger, Printer, Syringe, load
from firmware_profiles.families import family_of
from firmware_profiles.families.ack_protocol import Sort
from gcode.dry_run.run import dry_run
from gcode.errors import GcodeError
from gcode.motion.executed import ExecutedMotion
from gcode.program.gcode import checksum
from gcode.program.modal import DWELL, MOVE, SYNC
from gcode.program.valve import CLOSED, OPEN
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import LinkState
from sim.devices.families.registry import simulated_printer
from sim.devices.families.reprapfirmware_printer import crc16
from tests.design.toolpath.plans import fresh_toolpath
from tests.design.toolpath.shapes import as_solid, block
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.slower import first_of

START = (50.0, 50.0, 10.0)
PLACED = b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n"
HEADER = b"G90\nM82\nG92 X50 Y50 Z10 E0\n"


def printer_of(firmware: str):
    facts = load(Printer, "generic_marlin").model_copy(
        update={"firmware": firmware, "resets_on_connect": False}
    )
    return simulated_printer(facts)(facts, START), facts


def said(printer, data: bytes) -> bytes:
    printer.receive(data)
    printer.settle()
    return printer.take_output()


def sealed(body: bytes, check=checksum) -> bytes:
    return (
        b"%b*%05d\n" % (body, check(body)) if check is crc16 else b"%b*%d\n" % (body, check(body))
    )


def test_duet_drops_a_garbled_line_without_a_word():
    printer, _ = printer_of("reprapfirmware")
    assert said(printer, sealed(b"N1 G90")) == b"ok\n"
    assert said(printer, sealed(b"N2 G90", crc16)) == b"ok\n"
    assert said(printer, b"N3 G90*77\n") == b""
    assert said(printer, b"N3 G90*0000\n") == b""


def test_klipper_does_a_garbled_line():
    printer, _ = printer_of("klipper")
    assert said(printer, b"N7 G92 X5*1\n") == b"ok\n"
    assert said(printer, b"M114\n").startswith(b"X:5.000 Y:50.000")
    assert said(printer, b"M92\n") == b'// Unknown command:"M92"\nok\n'


def test_duet_moves_no_axis_before_it_is_homed_or_placed():
    printer, _ = printer_of("reprapfirmware")
    assert said(printer, b"G1 X51 F600\n") == b"Error: G0/G1: insufficient axes homed\nok\n"
    assert said(printer, b"G92 X50 Y50\nG1 X51 F600\n") == b"ok\nok\n"
    assert b"insufficient" in said(printer, b"G1 Z11 F600\n")


def test_duet_tells_its_settings_and_what_it_leaves_out_in_its_own_words():
    printer, _ = printer_of("reprapfirmware")
    reply = said(printer, b"M113 S1\n").splitlines()[0]
    assert reply == b"Warning: M113: Command is not supported"
    assert made_protocol("reprapfirmware").sort(reply) is Sort.REFUSAL
    assert b"X: 18000.0, Y: 18000.0, Z: 300.0, E: 120.0, min. speed" in said(printer, b"M203\n")
    assert b"(mm/sec^2): X: 3000.0" in said(printer, b"M201\n")
    assert b"X0.0:200.0, Y0.0:200.0" in said(printer, b"M208\n")


def test_klipper_s_offset_shifts_places_until_it_is_taken_back():
    printer, _ = printer_of("klipper")
    assert said(printer, PLACED + b"SET_GCODE_OFFSET Z=0.5 X=-1\n") == b"ok\nok\n"
    assert said(printer, b"M114\n").startswith(b"X:51.000 Y:50.000 Z:9.500")
    assert said(printer, b"SET_GCODE_OFFSET Z_ADJUST=0.25\nG1 Z11 F600\nM400\n") == 3 * b"ok\n"
    assert printer.executed().end[-1].tolist() == [50.0, 50.0, 11.75]
    said(printer, b"SET_GCODE_OFFSET X=0 Y=0 Z=0\nG1 X50 Z11\nM400\n")
    assert printer.executed().end[-1].tolist() == [50.0, 50.0, 11.0]
    # Being told where the tip is doesn't end it.
    printer, _ = printer_of("klipper")
    said(printer, PLACED + b"SET_GCODE_OFFSET Z=0.5\n" + PLACED)
    assert said(printer, b"M114\n").startswith(b"X:50.000 Y:50.000 Z:9.500")
    said(printer, b"SET_GCODE_OFFSET X=0 Y=0 Z=0\n" + PLACED)
    assert said(printer, b"M114\n").startswith(b"X:50.000 Y:50.000 Z:10.000")


def test_klipper_s_timeout_switches_heaters_and_motors_off():
    printer, _ = printer_of("klipper")
    assert said(printer, b"SET_IDLE_TIMEOUT TIMEOUT=20\n") == (
        b"// idle_timeout: Timeout set to 20.00 s\nok\n"
    )
    said(printer, PLACED + b"M140 S40\nG1 X51 F600\n")
    printer.advance(60.0)
    assert not printer.dead
    assert b"B:" in (reply := said(printer, b"M105\n"))
    assert b"/0.0" in reply or b"/0.00" in reply
    assert b"Must home" in said(printer, b"G1 X52\n")


def test_klipper_that_was_shut_down_answers_each_line_by_why():
    printer, _ = printer_of("klipper")
    first, *rest = said(printer, b"\nM112\n").splitlines()
    assert first == b"// Klipper state: Shutdown"
    assert rest[-2:] == [b"!! Shutdown due to M112 command", b"ok"]
    assert said(printer, b"M112\n") == b"ok\n"
    assert said(printer, b"G1 X52\n").endswith(b"!! Shutdown due to M112 command\nok\n")


def gcode(moves: int, firmware: str) -> bytes:
    first = b"M302 P1\n" if firmware == "reprapfirmware" else PLACED
    lines = [
        b"G1 X%.3f Y%.3f E%.5f F1800" % (50 + i % 2 * 3.5, 50 + i % 40 * 0.25, 0.0034375 * (i + 1))
        for i in range(moves)
    ]
    return first + HEADER + b"\n".join(lines) + b"\n"


def printed(firmware: str, folder, seed: int = 0, **troubles) -> tuple[object, ExecutedMotion]:
    printer, facts = printer_of(firmware)
    transport = SimTransport(printer, VirtualClock(), np.random.default_rng(seed), **troubles)
    wiring = Wiring(
        transport=transport,
        protocol=made_protocol(firmware),
        clock=transport.clock,
        journal=Journal(folder / f"journal-{seed}.log"),
        printer=facts,
    )
    status = Streamer(wiring, parse_job(gcode(150, firmware), "test.gcode")).run()
    return status, printer.executed()


@pytest.mark.parametrize("firmware", ["reprapfirmware", "klipper"])
def test_print_through_the_link_ends_where_the_file_does(firmware, tmp_path):
    status, motion = printed(firmware, tmp_path)
    assert status.state is LinkState.DONE, status
    assert len(motion) == 150
    assert np.round(motion.plunger_end[-1] * 6400) == 150 * 22


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_duet_over_a_line_that_loses_oks_neither_loses_nor_doses_twice(seed, tmp_path):
    for attempt in range(3):
        status, motion = printed("reprapfirmware", tmp_path, seed + 10 * attempt, drop_ok=0.02)
        if status.error != "HandshakeError":
            break
        # A Duet doesn't say that it is busy: behind a lost ok it may have moved, and isn't begun.
        assert "start again" in status.message
        assert len(motion) == 0
    assert status.state is LinkState.DONE, status
    assert np.round(motion.plunger_end * 6400).tolist() == [22 * (k + 1) for k in range(150)]


# Aerotech program file


A3200, SYRINGE = load(Printer, "aerotech_pneumatic"), load(Syringe, "hamilton_1ml")
FILE_START = (60.0, 70.0, 30.0)
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
    run = dry_run(FILE, A3200, FILE_START)
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
    run = dry_run(text, A3200, FILE_START)
    assert [name for _, name in run.unknown] == names
    assert {finding.code for finding in run.findings} == {"unknown_command"}
    assert not (run.program.kind == MOVE).any()


@pytest.mark.parametrize(
    ("said", "instead", "line", "words"),
    [
        (b"G90\n", b"", 6, "G90 or G91"),
        (b"G71\n", b"", 6, "G71 or G70"),
        (b"G76\n", b"", 6, "G76 or G75"),
        (b"VELOCITY ON\n", b"", 6, "VELOCITY ON"),
        (b"G92 X60 Y70 Z30", b"G92 X60 Y70", 16, "G92 Z"),
        (b"G92 X60 Y70 Z30", b"VELOCITY ON // G92 X60 Y70 Z30", 7, "G92 X.*G92 Y.*G92 Z"),
        (b"G92 X60 Y70 Z30\nG1 X61 Y72 F20", b"G1 X61 Y72 F20\nG92 X61 Y72 Z30", 6, "G92 X.*G92 Y"),
    ],
)
def test_move_from_what_the_controller_was_left_at_is_refused(said, instead, line, words):
    (found,) = dry_run(FILE.replace(said, instead), A3200, FILE_START).findings
    assert (found.code, found.line) == ("undeclared", line)
    assert re.search(words, found.message)


@pytest.mark.parametrize(
    ("printer", "waits", "words"),
    [
        (A3200, b"WAIT MOVEDONE X Y", "WAIT MOVEDONE X Y Z"),
        (NEWER, b"WaitForMotionDone([X, Y, Z])", r"WaitForMotionDone\(\[X, Y, Z, A\]\)"),
    ],
)
def test_wait_that_leaves_an_axis_out_is_refused(printer, waits, words):
    modes = "\n".join(family_of(printer).dialect(printer).modes).encode()
    header = modes + b"\nG92 X60 Y70 Z30\nG1 Z31 F5\n"
    (found,) = dry_run(header + waits + b"\n", printer, FILE_START).findings
    assert (found.code, found.line) == ("ambiguous", 7)
    assert re.search(words, found.message)


@pytest.mark.parametrize("printer", [A3200, NEWER])
def test_a_whole_job_of_the_writer_passes(printer: Printer) -> None:
    toolpath = fresh_toolpath(as_solid(block(3, 3, 0.18)), FreshOptions())
    options = GcodeOptions(start_mm=FILE_START, flow_ul_s=0.12)
    data = write_gcode(toolpath, printer, SYRINGE, (60, 70, 20), options).data
    run = dry_run(data, printer, FILE_START)
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
    text = FILE.partition(b"G1")[0]
    text += b"".join(b"G1 X%.4f F20\n" % (60 + 0.01 * k) for k in range(1, 500))
    slow = A3200.model_copy(update={"baud": 9600})
    assert dry_run(text, slow, FILE_START).duration_s == dry_run(text, A3200, FILE_START).duration_s


def test_a_profile_that_doesnt_say_its_controller_is_refused() -> None:
    with pytest.raises(GcodeError, match="which controller"):
        dry_run(FILE, A3200.model_copy(update={"file_controller": None}), FILE_START)
