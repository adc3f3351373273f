"""Simulated firmware: fast and slow path agree; motion, faults, kill, reset, heat, time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.facts import CODES
from sim.devices.families.marlin.commands import HANDLERS
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import parse_fault
from sim.gcode.program.gcode import checksum
from tests.slower import examples

PROFILE = load(Printer, "marlin_avr")
ERRORS = (b"Error", b"Resend", b"echo")


def line(number, text):
    body = f"N{number} {text}".encode()
    return b"%s*%d\n" % (body, checksum(body))


def ready(start=(0.0, 0.0, 0.0), profile=PROFILE, faults=()):
    printer = MarlinPrinter(profile, start, faults=tuple(faults))
    assert printer.exchange(b"M302 P1\nM110 N0\n").count(b"ok") == 2
    return printer


def send(printer, *texts, first=1):
    return [printer.exchange(line(first + k, text)) for k, text in enumerate(texts)]


def motion(printer):
    executed = printer.executed()
    return np.column_stack(
        [
            executed.start,
            executed.end,
            executed.plunger_start,
            executed.plunger_end,
            executed.time_start,
            executed.time_end,
            executed.line,
        ]
    )


steps = st.lists(
    st.tuples(st.integers(0, 40), st.integers(0, 40), st.integers(0, 9), st.integers(5, 90)),
    max_size=40,
)


@given(steps, st.booleans())
@settings(max_examples=examples(25), deadline=None)
def test_the_short_road_does_what_the_general_one_does(points, advanced):
    profile = PROFILE.model_copy(update={"advanced_ok": advanced})
    short, general = ready(profile=profile), ready(profile=profile)
    for number, (x, y, e, f) in enumerate(points, start=1):
        data = line(number, f"G1 X{x * 0.05:.2f} Y{y * 0.05:.2f} E{e * 0.01:.2f} F{f * 60}")
        answer = short.exchange(data)
        general.receive(data)
        general.settle()
        assert general.take_output() == answer
        assert answer.startswith(b"ok")
        assert short.now == pytest.approx(general.now, abs=1e-9)
    short.finish()
    general.finish()
    np.testing.assert_allclose(motion(short), motion(general), atol=1e-8)


def test_every_known_command_is_handled_and_no_other():
    moves = {"G0", "G1", "G2", "G3"}
    assert set(HANDLERS) | moves == CODES


@pytest.mark.parametrize("name", sorted(CODES - {"M112", "M0", "M1", "M999"}))
def test_every_known_command_ends_with_one_ok(name):
    answer = ready().exchange(f"{name}\n".encode())
    assert answer.count(b"ok") == 1
    assert b"Unknown" not in answer


def test_blocks_carry_their_line_and_the_tip_starts_where_it_was_put():
    printer = ready((50.0, 60.0, 5.0))
    send(printer, "G92 X0 Y0 Z0", "G1 X10 F600", "G92 E0", "G1 X10 Y5 E1", "M400")
    executed = printer.executed()
    assert executed.line.tolist() == [1, 3]
    assert executed.start[0].tolist() == [50, 60, 5]
    assert executed.end[-1].tolist() == [60, 65, 5]
    assert executed.plunger_end[-1] == 1


def test_a_host_that_is_slow_or_gone_starves_nothing():
    printer = ready()
    send(printer, *(f"G1 X{k % 2 * 10} F600" for k in range(1, 9)))
    before = printer.now
    printer.settle()
    assert printer.now == before
    printer.finish()
    executed = printer.executed()
    assert len(executed) == 8
    np.testing.assert_allclose(executed.time_start[1:], executed.time_end[:-1])


def test_a_full_planner_holds_the_ok_until_a_block_ends():
    printer = ready()
    times = []
    for number in range(1, 21):
        send(printer, f"G1 X{number % 2 * 10} F600", first=number)
        times.append(printer.now)
    gaps = np.diff(times)
    assert gaps[:13].max() < 0.05
    np.testing.assert_allclose(gaps[15:], 1.003, atol=0.005)


def test_a_repeated_line_is_dropped_in_silence_and_moves_nothing():
    printer = ready()
    send(printer, "G91", "G1 X1 F600")
    assert printer.exchange(line(2, "G1 X1 F600")) == b""
    printer.finish()
    assert printer.executed().end[-1, 0] == 1


@pytest.mark.parametrize("at", [0, 3, 12])
def test_a_flipped_bit_is_asked_for_again(at):
    printer = ready()
    good = line(1, "G1 X10 Y5 F600")
    bad = bytearray(good)
    bad[at] ^= 0x02
    answer = printer.exchange(bytes(bad))
    assert answer.startswith(ERRORS) or answer == b"ok\n"
    if b"Resend: 1\nok\n" in answer:
        assert printer.exchange(good) == b"ok\n"


def test_a_killed_printer_is_silent_until_it_is_reset():
    printer = ready()
    send(printer, "G1 X100 F600", "M104 S40")
    printer.advance(1.1)
    assert b"Printer halted" in printer.exchange(b"M112\n")
    assert printer.dead
    assert printer.exchange(b"M105\nM999\n") == b""
    assert printer.machine.heat.hotend.target_c == 0
    printer.advance(2.0)
    assert printer.executed().end[-1, 0] == pytest.approx(16.4, abs=0.5)  # 0.64 s at 10 mm/s
    printer.reset()
    assert printer.take_output().startswith(b"start\n")
    assert printer.exchange(b"M105\n").startswith(b"ok T:")


def test_after_a_reset_the_firmware_believes_its_start_and_the_motors_stay():
    printer = ready((20.0, 0.0, 0.0))
    send(printer, "G1 X30 F600", "M400")
    printer.reset()
    printer.take_output()
    assert printer.exchange(b"M114\n").startswith(b"X:20.00")
    printer.exchange(b"M302 P1\nG1 X25 F600\nM400\n")
    executed = printer.executed()
    assert executed.start[-1, 0] == 30
    assert executed.end[-1, 0] == 35


def test_without_homing_the_soft_limits_do_not_hold_and_after_it_they_do():
    printer = ready()
    send(printer, "G1 X300 F12000", "M400")
    assert printer.executed().end[-1, 0] == 300
    send(printer, "G28 X", "G1 X300 F12000", "M400", first=3)
    assert printer.executed().end[-1, 0] == 200


def test_waiting_for_heat_reports_each_second_and_takes_its_time():
    printer = ready()
    answer = printer.exchange(b"M109 S60\n")
    assert answer.count(b" T:") >= 10
    assert b"W:?" in answer
    assert answer.endswith(b"W:0\nok\n")
    assert printer.machine.heat.hotend.read(printer.now) == 60
    assert printer.exchange(b"M104 S0\nM190 S30\n").count(b"ok\n") == 2


def test_the_idle_timeout_kills_when_nothing_moves_for_so_long():
    printer = ready()
    send(printer, "M85 S60", "G1 X100 F600")
    printer.advance(65)
    assert not printer.dead
    printer.advance(10)
    assert printer.dead
    assert b"too much inactive time" in printer.take_output()


def test_a_quickstop_drops_the_queue_and_the_position_stays_true():
    printer = ready()
    send(printer, "G1 X50 F600", "G1 X0", "G1 X50")
    printer.advance(1.0)
    printer.exchange(b"M410\n")
    report = printer.exchange(b"M114\n")
    steps = int(report.split(b"Count X:")[1].split()[0])
    assert printer.executed().end[-1, 0] == steps / 80
    assert printer.machine.motion.blocks == 0
    send(printer, "G1 X20", "M400", first=4)
    assert printer.executed().end[-1, 0] == 20


def test_a_fault_happens_at_its_line():
    silent = ready(faults=[parse_fault("drop_ok@2")])
    assert send(silent, "G1 X1 F600", "G1 X2", "G1 X3") == [b"ok\n", b"", b"ok\n"]
    reset = ready(faults=[parse_fault("reset@2")])
    assert send(reset, "G1 X1 F600", "G1 X2")[1].startswith(b"start\n")
    assert b"Last Line: 0" in reset.exchange(line(3, "G1 X3"))
    dead = ready(faults=[parse_fault("kill@1")])
    assert b"Thermal Runaway" in send(dead, "G1 X1 F600")[0]
    assert dead.dead
    pulled = ready(faults=[parse_fault("unplug@1")])
    send(pulled, "G1 X1 F600")
    assert pulled.unplugged


def test_the_receive_ring_overruns_when_the_planner_is_full():
    printer = ready()
    send(printer, *(f"G1 X{k % 2 * 10} F600" for k in range(1, 16)))
    burst = b"".join(line(k, f"G1 X{k % 2 * 10} F600") for k in range(16, 46))
    printer.receive(burst)
    printer.settle()
    assert printer.wire.lost > 0
    # What is left of the last line in the ring shows at the next line's end.
    assert b"Error:" in printer.take_output() + printer.exchange(b"\n")
