"""Simulated Marlin: motion, faults, kill, reset, heat, time; its answers against a real one's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.facts import CODES
from sim.devices.families.marlin_commands import HANDLERS
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import Fault, parse_fault
from tests.sim.transcripts import differences, numbered, ping, ping_pong, printer_of, rows_of
from tests.slower import examples

PROFILE = load(Printer, "marlin_avr")
ERRORS = (b"Error", b"Resend", b"echo")


def ready(start=(0.0, 0.0, 0.0), profile=PROFILE, faults=()):
    printer = MarlinPrinter(profile, start, faults=tuple(faults))
    assert printer.exchange(b"M302 P1\nM110 N0\n").count(b"ok") == 2
    return printer


def send(printer, *texts, first=1):
    return [printer.exchange(numbered(first + k, text)) for k, text in enumerate(texts)]


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
        data = numbered(number, f"G1 X{x * 0.05:.2f} Y{y * 0.05:.2f} E{e * 0.01:.2f} F{f * 60}")
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
    assert printer.exchange(numbered(2, "G1 X1 F600")) == b""
    printer.finish()
    assert printer.executed().end[-1, 0] == 1


@pytest.mark.parametrize("at", [0, 3, 12])
def test_a_flipped_bit_is_asked_for_again(at):
    printer = ready()
    good = numbered(1, "G1 X10 Y5 F600")
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
    assert b"Last Line: 0" in reset.exchange(numbered(3, "G1 X3"))
    dead = ready(faults=[parse_fault("kill@1")])
    assert b"Thermal Runaway" in send(dead, "G1 X1 F600")[0]
    assert dead.dead
    pulled = ready(faults=[parse_fault("unplug@1")])
    send(pulled, "G1 X1 F600")
    assert pulled.unplugged


def test_the_receive_ring_overruns_when_the_planner_is_full():
    printer = ready()
    send(printer, *(f"G1 X{k % 2 * 10} F600" for k in range(1, 16)))
    burst = b"".join(numbered(k, f"G1 X{k % 2 * 10} F600") for k in range(16, 46))
    printer.receive(burst)
    printer.settle()
    assert printer.wire.lost > 0
    # What is left of the last line in the ring shows at the next line's end.
    assert b"Error:" in printer.take_output() + printer.exchange(b"\n")


# Against answers of a real one, line by line.
# Source: measured 2026-11-22 on Marlin bugfix-2.1.x of 2024-10-11 (ATmega2560 under simavr), the
# same bytes to both over pseudo-terminals: some 700 lines, with and without emergency parser.


def marlin(**changes: object) -> MarlinPrinter:
    printer = MarlinPrinter(PROFILE.model_copy(update=changes))
    assert printer.exchange(b"M302 P1\n").endswith((b"ok\n", b"B3\n"))
    return printer


def said(printer: MarlinPrinter, *lines: str) -> str:
    """The last line's answer, without its ok."""
    answers = [printer.exchange(line.encode() + b"\n").decode() for line in lines]
    return answers[-1].removesuffix("ok\n")


def x_steps(printer: MarlinPrinter) -> int:
    """Steps of X since power-up."""
    return round(printer.executed().end[-1, 0] * 80)


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("M118 A1 E1 hi", "echo://hi\r\n"),
        ("M118 E0 hi", "E0 hi\r\n"),
        ("M118 E2 hi", "E2 hi\r\n"),
        ("M118 P1 hi", "hi\r\n"),
        ("M118  E1   two  blanks  ", "echo:two  blanks  \r\n"),
        ("M 118 hi", "hi\r\n"),
        ("M118 hi*5", "hi\r\n"),
        ("M111", "echo:DEBUG:off\n"),
        ("M111 S32", "echo:DEBUG:\n"),
        ("M111 S-1", "echo:DEBUG:off\n"),
        ("M85", "Inactivity timeout 0 s.\n"),
        ("M149", 'echo:Unknown command: "M149"\n'),
        ("M120", ""),
        ("M504", "echo:EEPROM OK\n"),
        ("M428", "echo:Home XYZ First\r\n"),
        ("M205 J0.5", "Error:?J out of range (0.01 to 0.3)\n"),
        ("M301 E0", "  M301 P22.20 I1.08 D114.00\n"),
        ("M206 X5", "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\n"),
        ("M0112", ""),
        ("M65648", ""),
    ],
)
def test_answer_is_the_real_ones(line: str, answer: str) -> None:
    assert said(marlin(), line) == answer


def test_code_112_kills_however_it_is_written_after_its_line_was_refused() -> None:
    printer = marlin(emergency_parser=False)
    printer.exchange(b"M0112\n")
    assert printer.dead
    answer = marlin().exchange(b"N5 M112\n")
    assert answer.index(b"Resend: 1\nok\n") < answer.index(b"echo:M112 Shutdown")


def test_text_of_m0_begins_behind_its_words_with_numbers() -> None:
    printer = marlin()
    assert "//action:prompt_begin M0 Stop\n" in said(printer, "M0 S1")
    printer.advance(2.0)
    assert "//action:prompt_begin Move it\n" in said(printer, "M0 P10 Move it")


@pytest.mark.parametrize(
    ("line", "question", "answer"),
    [
        ("M220 S50.7", "M220", "FR:50%\n"),
        ("M220 S40000", "M220", "FR:-25536%\n"),
        ("M221 S95.9", "M221", "echo:E0 Flow: 95%\n"),
        ("M113 S2.5", "M113", "echo:M113 S2\n"),
        ("M92 X0 E-5", "M92", "  M92 X0.00 Y80.00 Z400.00 E-5.00\n"),
        ("M92 E5", "M203", "  M203 X300.00 Y300.00 Z5.00 E2500.00\n"),
        ("M203 X-3", "M203", "  M203 X-3.00 Y300.00 Z5.00 E25.00\n"),
        ("M205 S5 T3", "M205", "  M205 B20000.00 S5.00 T3.00 J0.01\n"),
        ("M200 D1.75", "M200", "  M200 S1 D1.75\n"),
        ("M200 D0", "M200", "  M200 S0 D1.75\n"),
        ("M302 S200.7", "M302", "echo:Cold extrudes are disabled (min temp 200C)\n"),
        ("M302 S0\nM302 P0", "M302", "echo:Cold extrudes are enabled (min temp 0C)\n"),
        ("G92 X-1", "M211", "  M211 S1 ; ON\n  Min:  X-1.00 Y0.00 Z0.00   "
         "Max:  X199.00 Y200.00 Z200.00\n"),
        ("M211 S-1", "M211", "  M211 S0 ; OFF\n  Min:  X0.00 Y0.00 Z0.00   "
         "Max:  X200.00 Y200.00 Z200.00\n"),
    ],
)  # fmt: skip
def test_setting_is_kept_and_told_as_the_real_one_does(line, question, answer):
    assert said(marlin(), *line.split("\n"), question) == answer


def test_stored_settings_outlast_a_reset_and_others_do_not() -> None:
    printer = marlin()
    said(printer, "M92 X81", "M500", "M203 Z4", "M220 S50")
    printer.reset()
    printer.take_output()
    assert said(printer, "M92") == "  M92 X81.00 Y80.00 Z400.00 E500.00\n"
    assert said(printer, "M203") == "  M203 X300.00 Y300.00 Z5.00 E25.00\n"
    assert said(printer, "M220") == "FR:100%\n"
    assert said(printer, "M502", "M92") == "  M92 X80.00 Y80.00 Z400.00 E500.00\n"
    assert "M92 X81.00" in said(printer, "M501")


def test_m200_m205_and_m111_do_to_moves_what_they_say() -> None:
    printer = marlin()
    said(printer, "M200 D1.75", "G1 E10 F600", "M400")
    assert printer.executed().plunger_end[-1] == pytest.approx(4.158, abs=0.002)
    printer = marlin()
    said(printer, "M205 T50", "G1 X10 F60", "M400")
    executed = printer.executed()
    assert executed.time_end[-1] - executed.time_start[0] < 0.3
    printer = marlin()
    said(printer, "M111 S8", "M104 S50", "G1 X3 E3 F600", "M400")
    assert printer.executed().plunger_end[-1] == 0
    assert printer.executed().end[-1, 0] == 3
    assert printer.machine.heat.hotend.target_c == 0


def test_quickstop_before_the_kill_leaves_no_step_behind_it() -> None:
    printer = marlin()
    said(printer, "G1 X100 F3000")
    printer.advance(0.5)
    printer.exchange(b"M410\n")
    stopped = len(printer.executed()), x_steps(printer)
    printer.exchange(b"M112\n")
    printer.advance(3.0)
    assert (len(printer.executed()), x_steps(printer)) == stopped


@pytest.mark.parametrize(("again", "moves_on"), [(False, True), (True, False)])
def test_a_line_that_waited_is_dropped_by_a_second_quickstop(again: bool, moves_on: bool) -> None:
    """Urgent codes aren't looked at in a quickstop's second: the line is let in, then dropped."""
    printer = marlin()
    answer, k = b"ok", 0
    while answer:  # one line in flight: the planner is full, and it waits for room
        printer.receive(b"G1 X%d F600\n" % (95 - 90 * (k % 2)))
        printer.advance(0.01)
        answer, k = printer.take_output(), k + 1
    printer.advance(1.0)
    printer.receive(b"\nM410\n")
    printer.advance(0.5)
    stopped = x_steps(printer)
    if again:
        printer.receive(b"\nM410\n")
    printer.advance(1.3)
    assert (x_steps(printer) != stopped) is moves_on
    printer.receive(b"\nM112\n")
    printer.advance(3.0)
    assert printer.dead
    assert (x_steps(printer) != stopped) is moves_on


def test_firmware_that_stops_itself_runs_on_like_any_kill() -> None:
    printer = MarlinPrinter(PROFILE, faults=(Fault(fault="kill", time_s=1.0),))
    said(printer, "M302 P1", "G1 X100 F3000")
    printer.advance(4.0)
    assert printer.executed().end[-1, 0] > 50 + 30


# Recorded Marlin transcripts, replayed to the simulated printer byte for byte.


@pytest.mark.parametrize(("name", "count"), [("conf_avr.txt", 88), ("conf_avr2.txt", 58)])
def test_every_recorded_row_is_reproduced(name, count):
    rows = rows_of(name)
    assert len([row for row in rows if row.sent]) == count
    assert differences(printer_of(second_build=False), rows) == []


def test_second_build_is_reproduced_up_to_its_kill():
    rows = rows_of("conf_avr3_stock_noEP_advok.txt")
    killed = next(i for i, row in enumerate(rows) if b"kill()" in row.expected)
    assert killed == 10
    assert differences(printer_of(second_build=True), rows[: killed + 1]) == []


@pytest.mark.parametrize("second_build", [True, False])
def test_m112_behind_full_queues_waits_without_emergency_parser_only(second_build):
    rows = rows_of("conf_avr4_m112_window.txt")
    first, second = (i for i, row in enumerate(rows) if row.title.startswith("==="))
    mine = rows[first + 1 : second] if second_build else rows[second + 1 :]
    assert [row.sent for row in mine] == [b"M302 P1\nG92 X0\n", b"N0 M110 N0*125\n", b"M112\n"]
    printer = printer_of(second_build)
    assert differences(printer, mine[:2]) == []
    ping_pong(printer, 18)
    printer.receive(b"".join(ping(n) for n in range(19, 23)))
    printer.advance(0.4)
    assert printer.take_output() == b""
    assert differences(printer, mine[2:]) == []
    assert printer.dead
