"""Fault plans: strict reading, exact timing; faults of the ink, against ink known by arithmetic."""

import numpy as np
import pytest

from firmware_profiles import Printer, load
from gcode.deposit.ink_faults import InkFaults, Timeline
from gcode.deposit.lay import deposit, laid
from gcode.motion.executed import ExecutedMotion
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import Fault, FaultFile, FaultyCable, PermanentFaults
from sim.errors import ServeError
from tests.sim.motions import moved
from tests.sim.transcripts import numbered

PRINTER = load(Printer, "generic_marlin")


def printer(*faults: dict, start=(50.0, 50.0, 10.0)) -> MarlinPrinter:
    made = MarlinPrinter(PRINTER, start, faults=tuple(Fault(**fault) for fault in faults))
    assert made.exchange(b"M110 N0\n") == b"ok\n"
    return made


def test_file_is_read_whole(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(
        "seed: 7\nnoise: 0.0004\nnoise_on: down\nlatency_s: 0.016\nat:\n"
        "  - {fault: unplug, line: 20, back_after_s: 2}\n"
        "  - {fault: noise, bytes: 500, rate: 0.05, length_bytes: 40}\n"
        "  - {fault: endstop_stuck, time_s: 0, axis: x, stuck: open}\n"
    )
    file = FaultFile.load(path)
    assert (file.seed, file.noise, file.noise_on, file.latency_s) == (7, 0.0004, "down", 0.016)
    assert file.at[0] == Fault(fault="unplug", line=20, back_after_s=2)
    assert [fault.fault for fault in file.at] == ["unplug", "noise", "endstop_stuck"]
    path.write_text("")
    assert FaultFile.load(path) == FaultFile()


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
        ("ink: [{fault: clog}]", "give one of line, time_s, written_mm and pushed_ul"),
        ("ink: [{fault: clog, line: 2, passes: 1}]", "passes"),
        ("ink: [{fault: melt, line: 2}]", "ink.0"),
        ("ink: [{fault: skip, line: 2, shift_mm: [0.1, 0], factor: 2}]", "factor"),
    ],
)
def test_what_means_nothing_is_refused(tmp_path, text, message):
    path = tmp_path / "faults.yaml"
    path.write_text(text)
    with pytest.raises(ServeError, match=message):
        FaultFile.load(path)


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


AREA, WIDTH, HEIGHT, LENGTH = 10.0, 0.2, 0.1, 5.0
DOSE = WIDTH * HEIGHT * LENGTH


def rows(layers: int = 2, lines: int = 4, purge_after: int = -1) -> ExecutedMotion:
    """Lines of 5 mm, 0.2 mm apart, a second a block; 1 µL pushed in a stand after one of them."""
    points, volumes = [(0.0, 0.0, HEIGHT)], []
    for number in range(layers * lines):
        z = HEIGHT * (1 + number // lines)
        y = 1 + 0.3 * (number % lines)
        points += [(0.0, y, z), (LENGTH, y, z)]
        volumes += [0.0, DOSE]
        if number == purge_after:
            points += [points[-1]]
            volumes += [1.0]
    return moved(points, volumes, AREA)


def faults(tmp_path, text: str) -> InkFaults:
    path = tmp_path / "faults.yaml"
    path.write_text(f"seed: 3\nink:\n  - {text}\n")
    return FaultFile.load(path).of_ink


def ink_of(tmp_path, text: str, motion: ExecutedMotion | None = None):
    return laid(motion or rows(), faults(tmp_path, text), AREA, plunger_step_mm=1e-6)


def test_clog_ends_the_ink_where_it_begins_and_lets_it_come_again(tmp_path):
    found = ink_of(tmp_path, "{fault: clog, written_mm: 7, lasts_mm: 1.5}")
    assert found.written_ul == pytest.approx(8 * DOSE * (1 - 1.5 / 40))
    second = found.strands.line == 3
    assert found.strands.end[second][0, 0] == pytest.approx(2.0)
    assert found.strands.start[second][1, 0] == pytest.approx(3.5)
    assert len(np.unique(found.strands.stroke)) == 9


@pytest.mark.parametrize(
    ("text", "purge_after", "lines"),
    [
        ("clog, written_mm: 7, clears_ul: 0.4, passes: 0.25", 2, 8 - 0.75 * (15 - 7) / LENGTH),
        ("clog, written_mm: 7, clears_ul: 1.4, passes: 0.25", 2, 7 / 5 + 0.25 * 33 / 5),
        ("drift, line: 4, factor: 1.3", -1, 1 + 7 * 1.3),
        ("drift, written_mm: 10, factor: 0.7, over_mm: 20", -1, 2 + 4 * 0.85 + 2 * 0.7),
        ("empty, pushed_ul: 0.25, fades_ul: 0.1", -1, (0.25 + 0.05) / DOSE),
    ],
    ids=["a purge clears a clog", "or is too little", "a step", "a ramp", "empty"],
)
def test_what_is_laid_is_what_a_fault_leaves(tmp_path, text, purge_after, lines):
    found = ink_of(tmp_path, f"{{fault: {text}}}", rows(purge_after=purge_after))
    assert found.written_ul == pytest.approx(DOSE * lines)


def test_bubble_is_missing_and_catches_up(tmp_path):
    text = "{fault: bubble, pushed_ul: 0.15, ul: 0.05, catches_up: 0.6}"
    found = ink_of(tmp_path, text)
    assert found.written_ul == pytest.approx(8 * DOSE - 0.05 + 0.03)
    assert found.strands.area_mm2.max() == pytest.approx(1.6 * WIDTH * HEIGHT)


def test_skipped_steps_shift_what_follows(tmp_path):
    found = ink_of(tmp_path, "{fault: skip, written_mm: 12, shift_mm: [0.3, -0.1]}")
    y = found.strands.start[found.strands.line == 5, 1]
    np.testing.assert_allclose(y, [1.6, 1.5])
    assert found.strands.end[-1] == pytest.approx([5.3, 1.8, 0.2])


def test_sag_widens_layers_and_sinks_filaments(tmp_path):
    text = "{fault: sag, written_mm: 20, percent: 25, drop_mm: 0.05}"
    found = ink_of(tmp_path, text)
    assert found.strands.area_mm2[-1] == pytest.approx(1.25 * WIDTH * HEIGHT)
    sunk = laid(rows(), faults(tmp_path, text), AREA, style="embedded", plunger_step_mm=1e-6)
    assert sunk.strands.end[-1, 2] == pytest.approx(0.15)


def test_debris_lies_beside_the_line_in_the_scan_too(tmp_path):
    wrong = faults(
        tmp_path, "{fault: debris, written_mm: 2.5, diameter_mm: 0.8, offset_mm: [0, -0.6]}"
    )
    voxels = deposit(rows(), AREA, 0.05, faults=wrong, plunger_step_mm=1e-6)
    x, y, z = np.round((np.array([2.5, 0.4, 0.05]) - voxels.origin_mm) / 0.05).astype(int)
    assert voxels.volume[z, y, x] == 255
    assert voxels.written_ul == pytest.approx(8 * DOSE + np.pi / 4 * 0.64 * HEIGHT)


def test_ink_of_a_second_syringe_counts_on():
    push = np.array([40.0, -1.0, 1.0, 10.0, -20.0, -30.0, 2.0, 5.0, -1.0, 1.5])
    line = Timeline.of(
        np.column_stack([np.arange(10.0), np.arange(1.0, 11)]),
        np.arange(10),
        np.ones(10),
        push,
        push > 0,
    )
    np.testing.assert_allclose(line.pushed_ul, [0, 40, 40, 40, 50, 50, 50, 52, 57, 57, 57.5])
    # A purge is at least twice the median dose a mm, which is 5.
    assert line.purged_ul[-1] == 40 + 10
