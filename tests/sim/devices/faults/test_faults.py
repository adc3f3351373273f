"""Fault plans of the simulated printer: strict reading, exact timing."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Printer, load
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import Fault, FaultFile, FaultyCable, PermanentFaults, load_faults
from sim.errors import ServeError
from sim.gcode.program.gcode import checksum

PRINTER = load(Printer, "generic_marlin")


def printer(*faults: dict, start=(50.0, 50.0, 10.0)) -> MarlinPrinter:
    made = MarlinPrinter(PRINTER, start, faults=tuple(Fault(**fault) for fault in faults))
    assert made.exchange(b"M110 N0\n") == b"ok\n"
    return made


def numbered(number: int, text: str) -> bytes:
    body = f"N{number} {text}".encode()
    return b"%b*%d\n" % (body, checksum(body))


# --- the file


def test_file_is_read_whole(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(
        "seed: 7\nnoise: 0.0004\nnoise_on: down\nlatency_s: 0.016\nat:\n"
        "  - {fault: unplug, line: 20, back_after_s: 2}\n"
        "  - {fault: noise, bytes: 500, rate: 0.05, length_bytes: 40}\n"
        "  - {fault: endstop_stuck, time_s: 0, axis: x, stuck: open}\n"
    )
    file = load_faults(path)
    assert (file.seed, file.noise, file.noise_on, file.latency_s) == (7, 0.0004, "down", 0.016)
    assert file.at[0] == Fault(fault="unplug", line=20, back_after_s=2)
    assert [fault.fault for fault in file.at] == ["unplug", "noise", "endstop_stuck"]
    path.write_text("")
    assert load_faults(path) == FaultFile()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nois: 1", "nois: is no key here"),
        ("noise: 2", "noise: must be at most 1"),
        ("noise_on: left", "noise_on"),
        ("at: [{fault: melt, line: 3}]", "at.0.fault"),
        ("at: [{fault: reset}]", "give one of line, time_s and bytes"),
        ("at: [{fault: reset, line: 3, bytes: 4}]", "give one of line, time_s and bytes"),
        ("at: [{fault: reset, line: 3, axis: x}]", "axis belongs to endstop_stuck"),
        ("at: [{fault: noise, line: 3, rate: 0.1}]", "noise needs length_bytes"),
        ("at: [{fault: drop_ok, time_s: 3}]", "drop_ok is the ok to a line"),
        ("[", "isn't YAML"),
    ],
)
def test_what_means_nothing_is_refused(tmp_path, text, message):
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    with pytest.raises(ServeError, match=message):
        load_faults(path)


# --- the cable


def flipped(before: bytes, after: bytes) -> list[int]:
    """How many bits of each byte differ."""
    return [(a ^ b).bit_count() for a, b in zip(before, after, strict=True)]


def test_noise_flips_single_bits_at_its_rate_and_in_its_direction():
    data = bytes(100_000)
    line = FaultyCable(PermanentFaults(noise=0.01, noise_on="down"), np.random.default_rng(1))
    hits = flipped(data, line.down(data))
    assert set(hits) == {0, 1}
    assert 900 < sum(hits) < 1100
    line.up(data, 0.0)
    assert line.due(0.0) == data


def test_replies_come_late_and_in_order():
    line = FaultyCable(PermanentFaults(latency_s=0.5))
    line.hold(2.0)
    line.up(b"a", 1.0)
    line.up(b"b", 1.1)
    assert line.next_s == 3.5
    assert (line.due(3.4), line.due(3.5), line.due(3.5)) == (b"", b"a", b"b")
    line.up(b"c", 4.0)
    line.clear()
    assert line.due(99.0) == b""


def test_oks_are_lost_by_chance_and_nothing_else_is():
    line = FaultyCable(PermanentFaults(drop_ok=1.0))
    line.up(b"ok\nResend: 3\nok\nok T:20\n", 0.0)
    assert line.due(0.0) == b"Resend: 3\nok T:20\n"


# --- the board


def test_faults_happen_by_clock_and_by_bytes():
    by_clock = printer({"fault": "reset", "time_s": 5.0})
    by_clock.advance(4.0)
    assert by_clock.take_output() == b""
    by_clock.advance(2.0)
    assert b"Marlin" in by_clock.take_output()
    by_bytes = printer({"fault": "kill", "bytes": 50})
    assert by_bytes.exchange(numbered(1, "G1 X51 F600")) == b"ok\n"
    by_bytes.exchange(numbered(2, "G1 X52 F600") + numbered(3, "G1 X53 F600"))
    assert by_bytes.dead


def test_endstop_stuck_closed_homes_where_the_carriage_stands():
    stuck = printer({"fault": "endstop_stuck", "time_s": 0.0, "axis": "x", "stuck": "closed"})
    assert b"x_min: TRIGGERED\ny_min: open" in stuck.exchange(b"M119\n")
    said = stuck.exchange(b"G28 X\nM400\nM114\n")
    assert b"X:0.00" in said
    moved = stuck.executed()
    assert not len(moved) or moved.end[-1, 0] == 50.0


def test_endstop_stuck_open_ends_in_a_halt_and_heaters_off():
    stuck = printer({"fault": "endstop_stuck", "time_s": 0.0, "axis": "y", "stuck": "open"})
    stuck.exchange(b"M140 S37\n")
    said = stuck.exchange(b"G28 X\nG28 Y\nG1 X5\n")
    assert b"Homing Failed" in said
    assert b"Printer halted" in said
    assert stuck.dead
    assert stuck.machine.heat.bed.target_c == 0
    assert stuck.executed().end[-1, 1] == 0.0
