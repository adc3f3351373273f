"""Prints driven by events alone, to their end, a stop, or a trouble of line or host."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import (
    CLEAN,
    JOB,
    LOOKS,
    PRINTER,
    Bench,
    MemoryJournal,
    Wire,
    assert_exact,
    assert_stood,
    assert_true,
    layers,
    made_of,
    observe,
    pause,
    resume,
    stop,
)
from tests.printctl.machine.link.jobs import parse_job

# --- a print that nothing disturbs ------------------------------------------------------------


def test_each_line_is_made_once_and_the_states_follow():
    bench = Bench(JOB)
    assert_exact(bench)
    assert bench.alarms == []
    [checkpoint] = bench.recorded("checkpoint")
    assert checkpoint["done"] == len(JOB)  # a clean line is held up for it at the end alone
    assert bench.states == [LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING]
    assert bench.recorded("end")[0]["done"] == len(JOB)


def test_commands_between_lines_are_in_the_journal_before_they_leave():
    bench = Bench(JOB)
    for line in (6, 15):
        bench.on_line(line, pause)
    bench.when(LinkState.PAUSED, resume, resume)
    assert_exact(bench)
    own, begun = set(JOB.lines), False
    for data, known in zip(bench.sent, bench.known_at, strict=True):
        for number, written in re.findall(rb"N(\d{1,4}) (.*?)\*\d+", data):
            text = re.sub(rb"^M0+(?=\d)", b"M", written)
            begun |= text.startswith(b"G92 X50")
            if begun and text not in own and not text.startswith(b"M118"):
                found = [one for one in bench.journal.records[:known] if one["t"] == "control"]
                controls = {one["n"]: one["command"].encode() for one in found}
                assert controls.get(int(number)) == text


def test_resume_of_a_print_that_is_not_paused_is_refused():
    bench, answers = Bench(JOB), list[str]()
    bench.on_line(6, lambda streamer: streamer.resume(answer=answers.append))
    assert_exact(bench, bench.run())
    assert "isn't paused" in answers[0]


# --- stops ------------------------------------------------------------------------------------


@pytest.mark.parametrize("state", [LinkState.CONNECTING, LinkState.CHECKING])
def test_stop_before_the_first_line_sends_none(state):
    bench = Bench(JOB)
    bench.when(state, stop)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True)
    assert not bench.printer.taken


@pytest.mark.parametrize("state", [LinkState.PAUSING, LinkState.PAUSED, LinkState.RESUMING])
@pytest.mark.parametrize("line", [6, 14])
def test_stop_in_a_pause_ends_with_all_that_was_taken_made(state, line):
    bench = Bench(JOB)
    bench.on_line(line, pause)
    bench.when(LinkState.PAUSED, resume)
    bench.when(state, stop)
    status = bench.run()
    assert status.state is LinkState.STOPPED, status.message
    assert_true(bench, status)
    assert_stood(bench)


@pytest.mark.parametrize("line", range(4, len(JOB)))
def test_stop_after_any_line_says_how_far_the_motors_came(line):
    bench = Bench(JOB)
    bench.on_line(line, stop)
    status = bench.run()
    assert status.state is LinkState.STOPPED, status.message
    assert status.position_known
    assert_true(bench, status)
    assert_stood(bench)
    assert bench.printer.place["Z"] > 10.2


def test_a_stop_is_in_the_journal_before_the_motors_drop_moves():
    bench = Bench(JOB)
    bench.on_line(9, pause)
    bench.when(LinkState.PAUSING, stop)
    bench.run()
    first = next(k for k, data in enumerate(bench.sent) if b"M410" in data)
    known = bench.journal.records[: bench.known_at[first]]
    assert LinkState.STOPPING in [record.get("state") for record in known]


@pytest.mark.parametrize("state", [LinkState.PAUSED, LinkState.LOOKING, LinkState.RESUMING])
def test_stop_away_from_the_job_behind_a_silent_reset_leaves_the_position_unknown(state):
    bench = Bench(JOB, care=LOOKS)

    def reset(_: Streamer) -> None:
        bench.printer.reset_now(silently=True)

    bench.on_line(10, pause)
    bench.when(LinkState.PAUSED, *([resume] * (state is not LinkState.PAUSED)))
    observe(bench)
    bench.when(state, lambda streamer: (reset(streamer), bench.after(1.0, stop)))
    status = bench.run()
    # on its way back the print finds it by itself
    ended = LinkState.POSITION_UNKNOWN if state is LinkState.RESUMING else LinkState.STOPPED
    assert (status.state, status.position_known) == (ended, False), status.message
    assert "X is 0.00 mm where" in status.message
    assert bench.printer.place["X"] == bench.printer.place["Y"] == 0.0
    assert_true(bench, status)


def decide(bench: Bench, decision: LookDecision) -> Callable[[Streamer], None]:
    def act(streamer: Streamer) -> None:
        look = streamer.status.look
        assert look is not None
        answers = bench.answers.append, bench.refusals.append
        streamer.look(LookRequest(look["number"], *answers, "seen", decision))

    return act


@pytest.mark.parametrize("park", [None, (70.0, 40.0, 40.0), (0.0, 0.0, 40.0)])
@pytest.mark.parametrize("decision", [LookDecision.GO_ON, LookDecision.PAUSE])
def test_needle_isnt_led_back_from_a_look_behind_a_silent_reset(park, decision):
    bench = Bench(JOB, care=replace(LOOKS, look_park_mm=park))

    def reset_and_decide(streamer: Streamer) -> None:
        bench.printer.reset_now(silently=True)
        decide(bench, decision)(streamer)

    bench.when(LinkState.LOOKING, reset_and_decide)
    bench.when(LinkState.PAUSED, lambda streamer: bench.after(5.0, stop))
    status = bench.run()
    assert not status.position_known, status.message
    if park or decision is LookDecision.GO_ON:
        assert status.state is LinkState.POSITION_UNKNOWN
    assert bench.printer.place["X"] == bench.printer.place["Y"] == 0.0
    assert_true(bench, status)


@pytest.mark.parametrize("park", [None, (70.0, 40.0, 40.0)])
def test_needle_isnt_led_to_its_parking_place_behind_a_silent_reset_of_the_lift(park):
    bench = Bench(JOB, care=replace(LOOKS, look_park_mm=park))
    bench.when(LinkState.PAUSING, lambda _: bench.after(0.8, reset_silently(bench)))
    bench.when(LinkState.LOOKING, decide(bench, LookDecision.GO_ON))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.POSITION_UNKNOWN, False)
    assert bench.printer.place["X"] == bench.printer.place["Y"] == 0.0
    assert_true(bench, status)


def test_pause_whose_needle_was_moved_from_elsewhere_says_that_the_place_isnt_the_jobs():
    bench, answers = Bench(JOB), list[str]()

    def move(_: Streamer) -> None:
        bench.printer.at["X"] += 5.0

    bench.on_line(10, pause)
    bench.when(LinkState.PAUSING, lambda _: bench.after(0.6, move))

    def try_to_resume(streamer: Streamer) -> None:
        assert "doesn't match the job any more" in streamer.status.message
        streamer.resume(answer=answers.append)
        bench.after(60.0, stop)

    bench.when(LinkState.PAUSED, try_to_resume)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, False), status.message
    assert answers[0].startswith("not resumed: ")
    assert_true(bench, status)


def test_needle_isnt_lowered_behind_a_silent_reset_in_a_resume():
    bench = Bench(JOB)
    bench.on_line(10, pause)
    bench.when(LinkState.PAUSED, resume)
    bench.when(LinkState.RESUMING, reset_silently(bench))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.POSITION_UNKNOWN, False)
    assert bench.printer.place == dict.fromkeys("XYZE", 0.0)
    assert_true(bench, status)


def reset_silently(bench: Bench) -> Callable[[Streamer], None]:
    return lambda _: bench.printer.reset_now(silently=True)


def test_stop_in_a_pause_knows_the_place_that_typed_moves_led_to():
    bench = Bench(JOB)

    def typed(streamer: Streamer) -> None:
        for text in ("G1 Z13.5 F300", "G1 Z14 F300", "G1 Z15 F300", "G1 E0.01 F20"):
            streamer.typed(text, bench.answers.append, bench.refusals.append)
        bench.after(60.0, stop)

    bench.on_line(10, pause)
    bench.when(LinkState.PAUSED, typed)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status.message
    assert len(bench.answers) == 4


# --- what goes wrong on the line --------------------------------------------------------------


class Answers(Wire):
    """Changes the printer's ``at``-th words."""

    def __init__(self, at: int, change: Callable[[bytes], bytes]) -> None:
        self.at, self.change = at, change

    def up(self, data: bytes) -> bytes:
        self.at -= 1
        return self.change(data) if self.at == 0 else data


CHANGES = {
    "lost": lambda data: b"",
    "doubled": lambda data: data + b"ok\n",
    "torn": lambda data: data[:1],
    "garbled": lambda data: b"oj" + data[2:],
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("at", [45, 52, 58, 65])
def test_an_ok_that_is_lost_doubled_or_garbled_costs_no_line(change, at):
    bench = Bench(JOB, wire=Answers(at, change))
    bench.when(LinkState.PAUSED, resume)  # of an answer that is too many
    status = bench.run()
    assert made_of(bench.printer, JOB.lines) == CLEAN
    assert status.state is LinkState.DONE, status.message


def test_line_that_noise_garbles_is_sent_again():
    class Noise(Wire):
        left = 3

        def down(self, data: bytes) -> bytes:
            if data.startswith(b"N") and b"G1 X" in data and self.left:
                self.left -= 1
                return data.replace(b"G1 X5", b"G1 X7", 1)
            return data

    bench = Bench(JOB, wire=Noise())
    status = bench.run()
    assert_exact(bench, status)
    assert status.line_errors >= 3


def test_line_whose_number_an_error_cut_off_is_named_as_one_that_may_be_made_twice():
    class Flushed(Wire):
        line = b""

        def down(self, data: bytes) -> bytes:
            pair = re.fullmatch(rb"(N\d+ G1 X.*\n)N\d+ (G1 X.*)(\*\d*)", data)
            if pair is None or self.line:
                return data
            self.line = pair[2]
            return pair[1].replace(b"X5", b"X7", 1) + pair[2] + pair[3]

    wire, profile = Flushed(), PRINTER.model_copy(update={"lines_in_flight": 2})
    bench = Bench(JOB, wire=wire, profile=profile)
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN  # it was made before its turn
    assert bench.printer.fragments == [wire.line.decode()]
    number = JOB.file_line(JOB.lines.index(wire.line) + 1)
    named = f"line {number} may have been executed twice; inspect the part"
    assert named in status.message
    assert [one["text"] for one in bench.recorded("alarm") if "twice" in one["text"]] == [named]


def test_many_errors_pause_the_print():
    class Noise(Wire):
        count = 0

        def down(self, data: bytes) -> bytes:
            if data.startswith(b"N") and b"G1 X" in data:
                self.count += 1
                return data.replace(b"G1 X5", b"G1 X7", 1) if self.count % 3 else data
            return data

    bench = Bench(JOB, care=Care(checkpoint_s=None, noise_window=50, noise_limit=4), wire=Noise())
    bench.when(LinkState.PAUSED, *[resume] * 10)
    assert_exact(bench)
    assert any("check cable and grounding" in one.message for one in bench.statuses)


@pytest.mark.parametrize("seconds", [2.5, 8.0, 30.0])
def test_printer_that_is_silent_for_a_while_loses_nothing(seconds):
    bench = Bench(JOB)

    def mute(_: Streamer) -> None:
        bench.printer.mute = True
        bench.after(seconds, unmute)

    def unmute(_: Streamer) -> None:
        bench.printer.mute = False

    bench.on_line(9, mute)
    assert_exact(bench)


def test_printer_that_stays_silent_ends_the_print_at_its_limit_and_alarms_long_before():
    bench, since = Bench(JOB), list[float]()

    def mute(_: Streamer) -> None:
        bench.printer.mute = True
        since.append(bench.exchange.now_s)

    bench.on_line(9, mute)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert "no valid reply" in status.message
    assert "may or may not have been accepted" in status.message
    assert 60 < bench.exchange.now_s - since[0] < 75
    assert any("no valid reply for" in text and "--silent-limit" in text for text in bench.alarms)
    assert_true(bench, status)


@pytest.mark.parametrize("state", [LinkState.CONNECTING, LinkState.CHECKING])
def test_reset_while_a_station_prepares_a_print_costs_the_place(state):
    bench = Bench(JOB, fresh=False)
    # behind the bytes that the state sends
    bench.when(state, lambda _: bench.after(0.2, lambda _: bench.printer.reset_now()))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False), status.message
    assert (status.lines_done, status.error) == (0, "HandshakeError")
    assert "was reset" in status.message
    assert not bench.printer.taken


@pytest.mark.parametrize("line", [5, 14])
@pytest.mark.parametrize("paused", [False, True])
def test_reset_leaves_the_position_unknown_and_sends_nothing_more(line, paused):
    bench = Bench(JOB)

    def reset(_: Streamer) -> None:
        bench.printer.reset_now()

    bench.on_line(line, pause if paused else reset)
    bench.when(LinkState.PAUSED, lambda streamer: bench.after(5.0, reset))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.POSITION_UNKNOWN, False)
    assert "was reset" in status.message
    assert_true(bench, status)


@pytest.mark.parametrize("held", ["look", "change"])
def test_print_that_has_ended_waits_for_nothing(held):
    bench = Bench(JOB, care=LOOKS if held == "look" else Care())
    waited = []

    def halt(streamer: Streamer) -> None:
        waited.append(streamer.status.waits_for)
        bench.printer.take(b"M112\n", bench.exchange.now_s)

    if held == "look":
        bench.when(LinkState.LOOKING, halt)
    else:
        bench.on_line(6, lambda streamer: streamer.reload())
        bench.when(LinkState.PAUSED, lambda _: bench.after(30.0, halt))
    status = bench.run()
    assert waited[0]
    assert (status.state, status.waits_for) == (LinkState.KILLED, "")


def test_firmware_that_halts_itself_ends_the_print_as_killed():
    bench = Bench(JOB)
    bench.on_line(9, lambda _: bench.printer.take(b"M112\n", bench.exchange.now_s))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.KILLED, False)
    assert_true(bench, status)


def test_line_that_the_printer_refuses_ends_the_print_before_it():
    job = parse_job(layers(1, 8), "bench.gcode")
    bench = Bench(job)
    wrong = job.lines[7].decode()

    def refuse(command: str) -> None:
        if command == wrong:
            bench.printer.say(b'echo:Unknown command: "%b"\nok\n' % wrong.encode())
        else:
            carry_out(command)

    carry_out = bench.printer._carry_out
    bench.printer._carry_out = refuse  # type: ignore[method-assign]
    status = bench.run()
    assert status.state is LinkState.FAILED, status.message
    assert "rejected line" in status.message
    assert status.lines_done <= 7
    assert wrong not in [one.line for one in bench.printer.made]


# --- the host's own troubles ------------------------------------------------------------------


@pytest.mark.parametrize("record", [9, 11, 13])
@pytest.mark.parametrize("reserve", [0, 2, 60])
def test_full_disk_pauses_a_print_which_goes_on_by_itself_once_there_is_room(record, reserve):
    journal = MemoryJournal(full_at=record, reserve=reserve, room_at_s=1000.0)
    bench = Bench(JOB, journal=journal)
    refused: list[str] = []
    bench.when(LinkState.PAUSED, lambda streamer: streamer.resume(answer=refused.append))
    status = bench.run()
    assert "disk full; free space; the print resumes by itself" in bench.pauses[0].message
    assert refused == ["not resumed: journal memory can't be written: disk full; free space"]
    assert 1000.0 < bench.exchange.now_s < 1020.0
    assert_exact(bench, status)
    assert [one["message"] for one in bench.recorded("end")] == [status.message]
    assert any("disk full" in alarm for alarm in bench.alarms)
    assert b"M104 S0" not in b"".join(bench.sent)  # heat is kept
    high = [one for one in bench.printer.made if one.end["Z"] > one.start["Z"] + 3.9]
    assert len(high) == 1  # the needle waited above the gel


def test_a_pause_for_room_that_a_person_takes_over_waits_for_that_person():
    bench = Bench(JOB, journal=MemoryJournal(full_at=12, room_at_s=100.0))
    bench.when(LinkState.PAUSED, pause)
    bench.at(5000.0, resume)
    assert_exact(bench)
    assert bench.exchange.now_s > 5000.0


def test_disk_that_stays_full_leaves_a_stop_and_its_end():
    journal = MemoryJournal(full_at=12, reserve=60)
    bench = Bench(JOB, journal=journal)
    bench.when(LinkState.PAUSED, lambda streamer: bench.after(100.0, stop))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True)
    assert_true(bench, status)


@pytest.mark.parametrize("effect", [40, 70, 80, 88])
def test_lost_port_ends_the_print_and_says_so(effect):
    bench = Bench(JOB)
    bench.lost_at = effect
    status = bench.run()
    assert status.state is LinkState.FAILED
    assert "the cable was pulled" in status.message
    assert_true(bench, status)


def test_kill_whose_port_is_lost_is_not_said_to_have_halted_the_printer():
    bench = Bench(JOB)

    def kill(streamer: Streamer) -> None:
        streamer.print.channel.kill.asked.set()
        bench.lost_at = bench.effects

    bench.on_line(5, kill)
    status = bench.run()
    assert status.state is LinkState.KILLED
    assert UNCONFIRMED in status.message


# --- what an ended print leaves ---------------------------------------------------------------


def test_lost_port_says_how_long_motors_run_on_and_where_needle_and_heat_are():
    job = parse_job(b"M140 S37\n" + layers(2, 8), "bench.gcode")
    bench = Bench(job)
    bench.on_line(12, lambda _: setattr(bench, "lost_at", bench.effects))
    status = bench.run()
    assert status.state is LinkState.FAILED
    match = re.search(r"queued moves for up to (\d+\.\d) s, then stop", status.message)
    bench.printer.run_to(1e9)
    last_s = bench.printer.last_made_s - bench.exchange.now_s
    assert match, status.message
    assert last_s - 0.1 <= float(match[1]) < last_s + 1.5
    assert "the needle wasn't lifted and may be in the print at Z 10.00 mm" in status.message
    assert "heaters stay set: the bed at 37 °C" in status.message


def test_lost_port_in_a_pause_says_that_the_needle_is_lifted():
    bench = Bench(JOB)
    bench.on_line(8, pause)
    lose: list[Callable[[Streamer], None]] = [lambda _: setattr(bench, "lost_at", bench.effects)]
    bench.when(LinkState.PAUSED, *lose)
    status = bench.run()
    assert "its motors were at rest; the needle waits above the print" in status.message
    assert "no heater was set" in status.message


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (
            stop,
            "the motors are at rest; the needle was lifted straight up; kept on: bath cooling",
        ),
        (
            lambda streamer: streamer.print.channel.kill.asked.set(),
            "the needle wasn't lifted and may be in the print at Z 10.00 mm",
        ),
    ],
    ids=["stop", "kill"],
)
def test_each_end_says_where_needle_motors_and_heat_are(act, words):
    bench = Bench(JOB)
    bench.on_line(9, act)
    if act is not stop:
        bench.on_line(9, lambda s: (act(s), bench.printer.take(b"M112\n", bench.exchange.now_s)))
    status = bench.run()
    assert words in status.message, status.message
