"""Pre-start agreement of firmware settings and tip position, on the simulated printer."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import LinkProtocol
from printctl.checks.gate.firmware import differences, reported_settings
from printctl.machine.control.board.connecting import REST_LIMIT_S, protocol_for
from printctl.machine.errors import HandshakeError
from printctl.machine.job.care import Care
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.klipper_printer import KlipperPrinter
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.control.bench import JOB, Bench
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.layered import Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, START

DATA = layered(1, 10)
BARE = b"G1 X51 Y50 Z10 F600\nM400\n"


def printed(tmp_path, data=DATA, dirty: bytes = b"", care: Care | None = None):
    printer = MarlinPrinter(PRINTER, START)
    transport = SimTransport(printer, VirtualClock())
    if dirty:
        transport.write(dirty)
        while transport.read(1.0):
            pass
    status = played(data, tmp_path, transport, Script(), care)
    return status, printer, read_journal(tmp_path / "journal.log").alarms


@pytest.mark.parametrize(
    ("dirty", "why"),
    [
        (b"M220 S250\n", "speed factor is 250 %"),
        (b"M221 S50\n", "flow factor is 50 %"),
        (b"M211 S0\n", "soft endstops are off"),
        (b"M111 S8\n", "debug flags are set: DRYRUN"),
    ],
)
def test_what_somebody_left_is_reset_and_told_before_the_first_line(tmp_path, dirty, why):
    status, printer, alarms = printed(tmp_path, dirty=dirty)
    assert status.state is LinkState.DONE, status
    assert any(why in text for text in alarms)
    machine = printer.machine
    assert float(machine.motion.modal["speed_percent"][0]) == 100
    assert float(machine.motion.modal["flow_percent"][0]) == 100
    assert machine.soft_endstops
    assert machine.debug == 0


@pytest.mark.parametrize(
    ("dirty", "why"),
    [
        (b"M203 Z2\n", "top speed of Z (M203) is 2 mm/s, slower than the profile's 5 (max_speed"),
        (b"M201 X9000\n", "acceleration of X (M201) is 9000 mm/s², faster than the profile's 3000"),
        (b"M204 P500\n", "acceleration (M204 P) is 500 mm/s², slower than the profile's 1000"),
        (b"M204 R50\n", "acceleration (M204 R) is 50 mm/s², slower than the profile's 1000"),
        (b"M205 J0.2\n", "junction deviation (M205 J) is 0.2 mm, faster than the profile's 0.013"),
        (b"M205 B99999\n", "least time of a segment (M205 B) is 99999 µs, slower than the prof"),
        (b"M205 S9\n", "least speed of moves that write (M205 S) is 9 mm/s, faster than the prof"),
        (b"M205 T4\n", "least speed of travels (M205 T) is 4 mm/s, faster than the profile's 0"),
    ],
)
def test_a_board_that_is_slower_or_faster_than_its_profile_is_told_by_name(tmp_path, dirty, why):
    status, _, alarms = printed(tmp_path, dirty=dirty)
    assert status.state is LinkState.DONE, status
    assert any(why in text for text in alarms), alarms
    assert not printed_clean(tmp_path)


def printed_clean(tmp_path) -> list[str]:
    (tmp_path / "clean").mkdir()
    return [text for text in printed(tmp_path / "clean")[2] if "the profile's" in text]


def test_a_slower_board_is_refused_where_ink_flows_by_time():
    air = load(Printer, "pneumatic_marlin")
    speed = f"  M203 X{air.max_speed_mm_s.x / 2:.2f}"
    (slow,) = differences({"M503 S0": [speed]}, air)
    assert not slow.tolerated
    assert "slower than the profile's" in slow.what
    (fast,) = differences({"M503 S0": [f"  M203 X{air.max_speed_mm_s.x * 2:.2f}"]}, air)
    assert fast.tolerated
    (least,) = differences({"M503 S0": ["  M205 B20000.00 S9.00 T0.00 J0.01"]}, air)
    assert not least.tolerated  # lines meant to be slower come out thin


def test_a_shifted_homing_is_refused_by_its_name(tmp_path):
    status, printer, _ = printed(tmp_path, dirty=b"M206 X5\n")
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert "homing is shifted by M206 X5.00 mm" in status.message
    assert len(printer.executed()) == 0


def test_a_start_that_the_printer_contradicts_is_refused_with_both_places(tmp_path):
    status, printer, _ = printed(tmp_path, BARE, care=Care(start_mm=(0.0, 0.0, 0.0)))
    assert status.state is LinkState.FAILED
    assert "X0.00 Y0.00 Z0.00" in status.message
    assert "X50.00 Y50.00 Z10.00" in status.message
    assert len(printer.executed()) == 0


def test_a_start_that_the_printer_or_the_job_confirms_is_printed(tmp_path):
    assert printed(tmp_path, BARE, care=Care(start_mm=START))[0].state is LinkState.DONE
    (tmp_path / "told").mkdir()
    status = printed(tmp_path / "told", DATA, care=Care(start_mm=START))[0]
    assert status.state is LinkState.DONE
    (tmp_path / "other").mkdir()
    status = printed(tmp_path / "other", DATA, care=Care(start_mm=(1.0, 2.0, 3.0)))[0]
    assert "the job's first lines set" in status.message


@pytest.mark.parametrize("job", [b"M302 S0\n", b"M302 S100\n", b"M302 S5 P1\n"])
@pytest.mark.parametrize(("dirty", "allowed"), [(b"", False), (b"M302 P1\n", True)])
def test_the_least_temperature_of_extrusion_is_as_before_at_a_job_s_end(
    tmp_path, job, dirty, allowed
):
    """M302 P0 alone forbids nothing where S is 0 (real board, 2026-11-22)."""
    status, printer, _ = printed(tmp_path, DATA.replace(b"M400\n", job + b"M400\n"), dirty)
    assert status.state is LinkState.DONE, status
    heat = printer.machine.heat
    assert (heat.coldest_c, heat.cold_allowed) == (170.0, allowed)


def test_corners_and_least_speeds_that_a_job_set_are_as_before_at_its_end(tmp_path):
    own = b"M205 B%g\n" % (PRINTER.min_segment_time_s * 1e6)
    status, printer, _ = printed(tmp_path, own + DATA, b"M205 J0.2 B100 S9 T4\n")
    assert status.state is LinkState.DONE, status
    state, settings = printer.machine.motion.state, printer.machine.settings
    assert float(state["junction_deviation"]) == pytest.approx(0.2)
    assert float(state["min_segment_us"]) == 100
    assert (settings.least_feed, settings.least_travel_feed) == (9.0, 4.0)


@pytest.mark.parametrize("before", [b"", b"M85 S900\n"])
def test_the_board_s_own_switch_off_is_as_before_at_a_job_s_end(tmp_path, before):
    status, printer, _ = printed(tmp_path, DATA, before)
    assert status.state is LinkState.DONE, status
    assert printer.machine.idle_limit_s == (900.0 if before else 0.0)


def test_the_recorded_firmware_s_answers_are_read():
    told = {
        "M503 S0": ["  G21 ; (mm)", "  M149 C ; Units in Celsius", "  M200 S0 D1.75",
                    "  M204 P3000.00 R3000.00 T3000.00", "  M205 B20000.00 S0.00 T0.00 J0.01",
                    "  M206 X0.00 Y0.00 Z0.00"],
        "M211": ["  M211 S1 ; ON", "  Min:  X0.00 Y0.00 Z0.00   Max:  X200.00 Y200.00 Z200.00"],
        "M220": ["FR:100%"],
        "M221": ["echo:E0 Flow: 100%"],
        "M111": ["echo:DEBUG:off"],
        "M302": ["echo:Cold extrudes are disabled (min temp 170C)"],
        "M85": ["Inactivity timeout 600 s."],
    }  # fmt: skip
    printer = load(Printer, "marlin_avr")
    assert differences(told, printer) == []
    assert reported_settings(told, printer) == {
        "M204": "M204 P3000.00 R3000.00 T3000.00",
        "M205": "M205 B20000.00 S0.00 T0.00",
        "M302": "M302 S170 P0",
        "M85": "M85 S600",
    }
    worse = {**told, "M503 S0": ["  M149 F", "  M200 S1 D1.75", "  M420 S1 Z10.00", "  M900 K0.40"]}
    assert [one.reset for one in differences(worse, printer)] == [
        "M149 C",
        "M200 S0",
        "",
        "M900 K0",
    ]


def test_places_that_klipper_still_shifts_by_an_earlier_g92_are_reset(tmp_path):
    """SET_KINEMATIC_POSITION leaves the shift: without the reset each move ends 70 mm beside."""
    printer, start = load(Printer, "klipper_bioprinter"), (100.0, 100.0, 20.0)
    board = KlipperPrinter(printer, start)
    transport = SimTransport(board, VirtualClock())
    transport.write(b"G92 X30\n")
    while transport.read(1.0):
        pass
    lines = ["SET_KINEMATIC_POSITION X=100 Y=100 Z=20", "G92 E0", "G1 X101 E0.1 F600", "M400", ""]
    job = "\n".join(["G21", "G90", "M82", *lines]).encode()
    protocol = KlipperProtocol()
    status = played(job, tmp_path, transport, Script(), protocol=protocol, printer=printer)
    assert status.state is LinkState.DONE, status
    assert board.executed().end[-1].tolist() == [101, 100, 20]
    (alarm,) = read_journal(tmp_path / "journal.log").alarms
    assert "places are shifted by X70 Y0 Z0 mm" in alarm


# --- start of a print on a machine that still moves, or is hotter than the set-up allows
START_BUSY_START = (50.0, 50.0, 10.0)
HERE = {
    "generic_marlin": "G92 X50 Y50 Z10 E0\n",
    "ender5_duet3_replistruder5": "G92 X50 Y50 Z10 E0\n",
    "klipper_bioprinter": "SET_KINEMATIC_POSITION X=50 Y=50 Z=10\nG92 E0\n",
}


def begun(
    folder: Path, profile: str, before: str, declared: bool = True
) -> tuple[Status, Script, SimulatedPrinter, int]:
    """Print behind ``before`` of a former job; and the moves that were made before it."""
    changes = {"resets_on_connect": False}
    printer = load(Printer, profile).model_copy(update=changes)
    board, clock = simulated_printer(printer)(printer, START_BUSY_START), VirtualClock()
    wire, script = SimTransport(board, clock), Script()
    wire.write((HERE[profile] + before).encode())
    protocol: LinkProtocol = protocol_for(printer, wire.quiet_s)
    job = (HERE[profile] if declared else "") + "G90\nM82\nG1 X51 Y50 Z10 F600\nM400\n"
    status = played(
        job.encode(), folder, wire, script, protocol=protocol, printer=printer
    )  # fmt: skip
    return status, script, board, before.count("G1")


@pytest.mark.parametrize("profile", HERE)
@pytest.mark.parametrize("feed", [600, 60])
def test_start_is_refused_while_a_former_job_moves(tmp_path, profile, feed):
    status, _, board, moves = begun(tmp_path, profile, f"G90\nG1 X150 F{feed}\n")
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert status.lines_done == 0
    assert len(board.executed()) == moves
    assert ("maximum 30" if feed == 60 else "X50.00 Y50.00 Z10.00") in status.message


class Planned(ScriptedPrinter):
    """It moves for 14 s; M114 tells where the move leads, in steps too; it never says busy."""

    def __init__(self) -> None:
        super().__init__()
        self.keepalive = False
        self.take(b"G1 X64 F60\n", 0.0)
        self.said(0.1)

    @property
    def place(self) -> dict[str, float]:
        return dict(self.at)


def test_start_is_refused_behind_an_m400_that_an_idle_board_answers_at_once():
    bench = Bench(JOB, Planned())
    status = bench.run()
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert (
        "was still moving at the start of the print (it executed earlier commands for 1"
        in status.message
    )
    assert [one.end["X"] for one in bench.printer.made] == [64.0]


@pytest.mark.parametrize("profile", ["generic_marlin", "ender5_duet3_replistruder5"])
def test_job_that_goes_by_the_printers_own_places_waits_until_it_stands(tmp_path, profile):
    status, script, board, _ = begun(tmp_path, profile, "G90\nG1 X80 F180\n", declared=False)
    assert status.state is LinkState.DONE, status
    assert any("waiting for it, up to 30 s" in one.message for one in script.seen)
    assert board.executed().end[-1].tolist() == [51.0, 50.0, 10.0]


@pytest.mark.parametrize("profile", HERE)
@pytest.mark.parametrize("off", ["", "M140 S0\n"])
def test_start_is_refused_while_the_bed_is_above_the_set_ups_limit(tmp_path, profile, off):
    status, _, board, _ = begun(tmp_path, profile, f"M140 S60\nM190 S58.7\n{off}")
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert "the bed is at 58." in status.message
    assert "above 45 °C" in status.message
    assert len(board.executed()) == 0


class Driven(ScriptedPrinter):
    """Its card, or another program, drives it on."""

    def _reply(self, word: str, command: str) -> str:
        self.at["X"] += 0.05 if word == "M114" else 0.0
        return super()._reply(word, command)


class Busy(ScriptedPrinter):
    """It waits for a person: M400 is never answered, and it is busy."""

    def _begins_s(self, command: str) -> float:
        return 1e9 if command == "M400" else super()._begins_s(command)


@pytest.mark.parametrize("make", [Driven, Busy])
def test_machine_that_never_stands_is_waited_for_30_s_and_refused(make):
    bench = Bench(JOB, make())
    status = bench.run()
    assert (status.state, status.error) == (LinkState.FAILED, HandshakeError.__name__)
    assert REST_LIMIT_S < bench.exchange.now_s < REST_LIMIT_S + 5.0
    assert any("waiting for it, up to 30 s" in one.message for one in bench.statuses)
    assert bench.printer.taken == []


def test_the_board_s_own_switch_off_stays_while_a_heater_is_on(tmp_path):
    data = DATA.replace(b"M400\n", b"M104 S30\nM400\n")
    status, printer, alarms = printed(tmp_path, data)
    assert status.state is LinkState.DONE, status
    assert printer.machine.idle_limit_s == 600.0
    assert any("a heater is on" in text and "M85 S0 restores it" in text for text in alarms)


def test_klipper_s_own_switch_off_is_set_back_by_its_name():
    told = {"SET_IDLE_TIMEOUT": ["// idle_timeout: Timeout set to 1800.00 s"]}
    klipper = load(Printer, "klipper_bioprinter")
    assert reported_settings(told, klipper) == {
        "SET_IDLE_TIMEOUT": "SET_IDLE_TIMEOUT TIMEOUT=1800.00"
    }
