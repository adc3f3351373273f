"""Prints driven by events alone: pauses, stops, syringes, looks, and what goes wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from printctl.machine.control.halting import UNCONFIRMED
from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.streamer import Streamer
from printctl.machine.errors import Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.states import LinkState, Status
from tests.printctl.machine.control.bench import (
    PRINTER,
    Bench,
    HostDiedError,
    MemoryJournal,
    Wire,
    clean_run,
    layers,
    lines_of,
    made_of,
    motion,
)
from tests.printctl.machine.link.jobs import parse_job

JOB = parse_job(layers(2, 8), "bench.gcode")
OWN = lines_of(layers(2, 8))
CLEAN = clean_run(OWN)
LINES = range(1, len(JOB) + 1)
LOOKS = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=60.0)


MARK = JOB.marks.of(MarkKind.LAYER)[0].index
"""End of the first layer; a mend writes a stroke beside it, and comes back."""
MEND = (
    "G1 X51.5 Y50.123 F3000",
    "G1 E0.04800 F60",
    "G1 X51.25 E0.04900 F600",
    "G1 E-0.22200 F60",
    "G1 X50 Y51.75 F3000",
    "G1 F600",
)


def resume(streamer: Streamer) -> None:
    streamer.resume()


def stop(streamer: Streamer) -> None:
    streamer.stop()


def pause(streamer: Streamer) -> None:
    streamer.pause()


def assert_exact(bench: Bench, status: Status) -> None:
    """Each stroke was made once, from where to where the job says, and that is what is told."""
    assert (status.state, status.position_known) == (LinkState.DONE, True), status.message
    assert made_of(bench.printer, OWN) == CLEAN
    assert status.lines_done == status.lines_executed == len(bench.job)


def assert_true(bench: Bench, status: Status) -> None:
    """What was made is a beginning of the job, and no more is told than is true."""
    made = made_of(bench.printer, OWN)
    assert made == CLEAN[: len(made)]
    assert len(motion_until(bench, status.lines_executed)) <= len(made)
    own = set(motion(OWN))
    taken = [line for line in bench.printer.taken if line in own]
    assert len(motion_until(bench, status.lines_done)) <= len(taken)


def motion_until(bench: Bench, done: int) -> list[bytes]:
    return [line for line in bench.streamer.job.lines[:done] if line.startswith((b"G0", b"G1"))]


# --- a print that nothing disturbs ------------------------------------------------------------


def test_each_line_is_made_once_and_the_states_follow():
    bench = Bench(JOB)
    assert_exact(bench, bench.run())
    assert bench.states == [LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING]
    assert bench.recorded("end")[0]["done"] == len(JOB)


def test_commands_between_lines_are_in_the_journal_before_they_leave():
    bench = Bench(JOB)
    for line in (6, 15):
        bench.on_line(line, pause)
    bench.when(LinkState.PAUSED, resume, resume)
    assert_exact(bench, bench.run())
    own, begun = set(JOB.lines), False
    for data, known in zip(bench.sent, bench.known_at, strict=True):
        for number, written in re.findall(rb"N(\d{1,4}) (.*?)\*\d+", data):
            text = re.sub(rb"^M0+(?=\d)", b"M", written)
            begun |= text.startswith(b"G92 X50")
            if begun and text not in own and not text.startswith(b"M118"):
                found = [one for one in bench.journal.records[:known] if one["t"] == "control"]
                controls = {one["n"]: one["command"].encode() for one in found}
                assert controls.get(int(number)) == text


# --- pauses -----------------------------------------------------------------------------------


@pytest.mark.parametrize("line", [3, 4, 7, 12, 14, 20, len(JOB) - 1])
def test_pause_after_any_line_lifts_the_needle_and_comes_back_to_it(line):
    bench, seen = Bench(JOB), []

    def look_and_resume(streamer: Streamer) -> None:
        seen.append((bench.printer.place["Z"], streamer.status.lines_done))
        streamer.resume()

    bench.on_line(line, pause)
    bench.when(LinkState.PAUSED, look_and_resume)
    assert_exact(bench, bench.run())
    [(z, done)] = seen
    assert z >= 14.0
    assert done >= line
    assert bench.states[-4:] == [
        LinkState.PAUSING,
        LinkState.PAUSED,
        LinkState.RESUMING,
        LinkState.PRINTING,
    ]


def test_pause_after_a_layer_is_held_at_its_mark():
    bench = Bench(JOB)
    bench.on_line(5, lambda streamer: streamer.pause(MarkKind.LAYER))
    bench.when(LinkState.PAUSED, resume)
    assert_exact(bench, bench.run())
    [paused] = [one for one in bench.statuses if one.state is LinkState.PAUSED]
    assert paused.lines_done == JOB.marks.of(MarkKind.LAYER)[0].index
    assert "end of layer 1" in paused.message


def test_pause_that_is_waited_for_is_in_the_journal_at_once_and_can_be_taken_back():
    bench = Bench(JOB)

    def want(streamer: Streamer) -> None:
        streamer.pause(MarkKind.LAYER)
        assert bench.recorded("wanted")[-1]["after"] == MarkKind.LAYER

    bench.on_line(5, want)
    bench.on_line(8, resume)
    assert_exact(bench, bench.run())
    assert LinkState.PAUSED not in bench.states


def test_a_long_pause_shows_that_the_printer_is_there():
    bench = Bench(JOB)
    bench.on_line(5, pause)
    bench.when(LinkState.PAUSED, lambda streamer: bench.after(100.0, resume))
    assert_exact(bench, bench.run())
    assert bench.printer.executed.count("M105") >= 5


def test_print_that_nobody_confirms_is_held_at_the_next_mark():
    bench = Bench(JOB, care=Care(checkpoint_s=None, deadman_s=0.5))
    bench.when(LinkState.PAUSED, resume)
    assert_exact(bench, bench.run())
    [paused] = [one for one in bench.statuses if one.state is LinkState.PAUSED]
    assert "nobody confirmed" in paused.message


def test_resume_is_refused_while_the_needle_is_elsewhere():
    bench, answers = Bench(JOB), list[str]()

    def elsewhere(streamer: Streamer) -> None:
        bench.printer.at["X"] += 1.0
        streamer.resume(answer=answers.append)

    def back(streamer: Streamer) -> None:
        bench.printer.at["X"] -= 1.0
        streamer.resume(answer=answers.append)

    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, elsewhere, back)
    assert_exact(bench, bench.run())
    assert answers[0].startswith("not resumed: ")
    assert answers[1] == ""


def test_command_typed_in_a_pause_is_judged_and_answered():
    bench, replies, refusals = Bench(JOB), list[Any](), list[str]()

    def typed(streamer: Streamer) -> None:
        streamer.typed("M105", replies.append, refusals.append)
        streamer.typed("M500", replies.append, refusals.append)
        bench.after(1.0, resume)

    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, typed)
    assert_exact(bench, bench.run())
    assert b"T:21.00" in replies[0][0]
    assert len(replies) == len(refusals) == 1


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


@pytest.mark.parametrize("line", [*LINES[3:-1]])
def test_stop_after_any_line_says_how_far_the_motors_came(line):
    bench = Bench(JOB)
    bench.on_line(line, stop)
    status = bench.run()
    assert status.state is LinkState.STOPPED, status.message
    assert status.position_known
    assert_true(bench, status)
    assert_stood(bench)
    assert bench.printer.place["Z"] > 10.2


def assert_stood(bench: Bench) -> None:
    """The line that is told to go on with is the one after those that were wholly made.

    Where others pass the same place, within two decimals, it is told as the first of them.
    """
    [stood] = bench.recorded("stood")
    made, told = len(made_of(bench.printer, OWN)), len(motion_until(bench, stood["line"]))
    assert told == made if stood["certain"] else made - 2 <= told <= made


@pytest.mark.parametrize("seconds", [0.05, 0.35, 0.6])
def test_stop_at_any_moment_of_a_pause_leaves_a_needle_that_stands(seconds):
    bench = Bench(JOB)
    bench.on_line(10, pause)
    bench.when(LinkState.PAUSING, lambda streamer: bench.after(seconds, stop))
    status = bench.run()
    assert status.state is LinkState.STOPPED
    assert_true(bench, status)


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
    bench.when(LinkState.LOOKING, decide(bench, LookDecision.GO_ON))
    bench.when(state, lambda streamer: (reset(streamer), bench.after(1.0, stop)))
    status = bench.run()
    # on its way back the print finds it by itself
    ended = LinkState.POSITION_UNKNOWN if state is LinkState.RESUMING else LinkState.STOPPED
    assert (status.state, status.position_known) == (ended, False), status.message
    assert "X is 0.00 mm where" in status.message
    assert bench.printer.place["X"] == bench.printer.place["Y"] == 0.0
    assert_true(bench, status)


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


@pytest.mark.parametrize("after_s", [0.6, 1.0])
def test_pause_whose_lift_a_silent_reset_cut_says_that_the_place_isnt_the_jobs(after_s):
    bench, answers = Bench(JOB), list[str]()
    bench.on_line(10, pause)
    bench.when(LinkState.PAUSING, lambda _: bench.after(after_s, reset_silently(bench)))

    def try_to_resume(streamer: Streamer) -> None:
        assert "isn't the job's any more" in streamer.status.message
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
            streamer.typed(text, bench.told.append, bench.told.append)
        bench.after(60.0, stop)

    bench.on_line(10, pause)
    bench.when(LinkState.PAUSED, typed)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status.message
    assert len(bench.told) == 4


# --- syringes ---------------------------------------------------------------------------------


def test_syringe_is_changed_at_the_next_reload_point_and_the_plunger_counted_anew():
    bench = Bench(JOB)
    bench.on_line(4, lambda streamer: streamer.reload())
    bench.when(
        LinkState.PAUSED,
        lambda streamer: streamer.resume(NewSyringe()),
    )
    assert_exact(bench, bench.run())
    [syringe] = bench.recorded("syringe")
    assert syringe["done"] == JOB.marks.of(MarkKind.RELOAD)[0].index
    assert syringe["command"].startswith("G92 E")
    assert bench.printer.by_number[syringe["n"]] == syringe["command"]


def test_resume_from_a_change_of_syringe_wants_to_know_what_was_put_in():
    bench, refusals = Bench(JOB), list[str]()

    def unsaid(streamer: Streamer) -> None:
        with pytest.raises(Refused, match="--plunger-mm") as refused:
            streamer.resume()
        refusals.append(str(refused.value))
        streamer.resume(unchanged=True)

    bench.on_line(4, lambda streamer: streamer.reload())
    bench.when(LinkState.PAUSED, unsaid)
    assert_exact(bench, bench.run())
    assert refusals
    assert not bench.recorded("syringe")


# --- looks ------------------------------------------------------------------------------------


def decide(bench: Bench, decision: LookDecision, **given: Any) -> Callable[[Streamer], None]:
    def act(streamer: Streamer) -> None:
        look = streamer.status.look
        assert look is not None
        number = look["number"]
        told = bench.told.append
        if given:
            streamer.look(LookRequest(number, told, told, "a gap", **given))
        streamer.look(LookRequest(number, told, told, "as it is", decision))

    return act


def test_print_is_held_for_each_look_and_goes_on_as_it_is_decided():
    bench = Bench(JOB, care=LOOKS)
    go_on = decide(bench, LookDecision.GO_ON)
    bench.when(LinkState.LOOKING, go_on, go_on)
    assert_exact(bench, bench.run())
    assert [one["decision"] for one in bench.recorded("looked")] == ["go_on", "go_on"]
    assert len(bench.told) == 2


def test_insert_of_a_look_is_in_the_journal_before_it_is_confirmed_and_made_once():
    bench = Bench(JOB, care=LOOKS)
    bench.when(
        LinkState.LOOKING,
        decide(bench, LookDecision.GO_ON, lines=MEND),
        decide(bench, LookDecision.GO_ON),
    )
    status = bench.run()
    assert status.state is LinkState.DONE, status.message
    assert made_of(bench.printer, OWN) == CLEAN
    made = [one.line for one in bench.printer.made]
    assert [made.count(line) for line in MEND[:-1]] == [1] * 5
    [insert] = bench.recorded("insert")
    assert insert["after"] == MARK
    assert bench.told[0]["count"] == len(MEND)


def test_look_that_nobody_decides_becomes_a_pause():
    bench = Bench(JOB, care=LOOKS)
    bench.when(LinkState.PAUSED, lambda s: s.resume(unobserved=True))
    bench.when(LinkState.LOOKING, lambda streamer: None, decide(bench, LookDecision.GO_ON))
    assert_exact(bench, bench.run())
    assert bench.recorded("looked")[0]["by"] == "the link"


@pytest.mark.parametrize("by", ["observer", "user"])
def test_stop_in_a_look_leaves_the_needle_up(by):
    bench = Bench(JOB, care=LOOKS)
    bench.when(LinkState.LOOKING, stop if by == "user" else decide(bench, LookDecision.STOP))
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True)
    assert_true(bench, status)
    assert_stood(bench)


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
    assert made_of(bench.printer, OWN) == CLEAN
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
    named = f"line {number} may have been made twice; look at the part"
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
    assert_exact(bench, bench.run())
    assert any("check cable and earthing" in one.message for one in bench.statuses)


@pytest.mark.parametrize("seconds", [2.5, 8.0, 30.0])
def test_printer_that_is_silent_for_a_while_loses_nothing(seconds):
    bench = Bench(JOB)

    def mute(_: Streamer) -> None:
        bench.printer.mute = True
        bench.after(seconds, unmute)

    def unmute(_: Streamer) -> None:
        bench.printer.mute = False

    bench.on_line(9, mute)
    assert_exact(bench, bench.run())


def test_printer_that_stays_silent_ends_the_print():
    bench = Bench(JOB)

    def mute(_: Streamer) -> None:
        bench.printer.mute = True

    bench.on_line(9, mute)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert "gave no usable answer" in status.message
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
    assert "refused line" in status.message
    assert status.lines_done <= 7
    assert wrong not in [one.line for one in bench.printer.made]


# --- the host's own troubles ------------------------------------------------------------------


@pytest.mark.parametrize("record", [22, 27, 30])
@pytest.mark.parametrize("reserve", [0, 1])
def test_full_disk_ends_the_print_by_a_controlled_stop(record, reserve):
    journal = MemoryJournal(full_at=record, reserve=reserve)
    bench = Bench(JOB, journal=journal)
    bench.on_line(5, pause)
    bench.when(LinkState.PAUSED, resume)
    status = bench.run()
    assert status.state is LinkState.FAILED, status.message
    assert "disk full" in status.message
    assert_true(bench, status)
    assert bool(bench.recorded("end")) == bool(reserve)


def test_insert_that_the_disk_has_no_room_for_isnt_taken():
    journal = MemoryJournal()
    bench = Bench(JOB, care=LOOKS, journal=journal)
    insert = decide(bench, LookDecision.GO_ON, lines=MEND)

    def on_a_full_disk(streamer: Streamer) -> None:
        journal.full_at, journal.reserve = len(journal.records), 0
        insert(streamer)

    bench.when(LinkState.LOOKING, on_a_full_disk)
    status = bench.run()
    assert status.state is LinkState.FAILED
    assert MEND[0] not in bench.printer.taken
    assert "isn't taken" in bench.told[0]
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


@pytest.mark.parametrize("wanted", ["nothing", "pause", "syringe", "look"])
def test_host_that_dies_in_any_effect_is_gone_on_with_exactly(wanted):
    """As kill -9 at any write of the port, any record and any word to a client."""
    care = LOOKS if wanted == "look" else Care(checkpoint_s=None)

    def plan(bench: Bench, attempt: int) -> None:
        if wanted == "pause" and not attempt:
            bench.on_line(12, pause)
        elif wanted == "syringe" and not attempt:
            bench.on_line(4, lambda streamer: streamer.reload())
        bench.when(LinkState.PAUSED, *[answer] * 5)
        bench.when(LinkState.LOOKING, *[decide(bench, LookDecision.GO_ON)] * 5)

    def answer(streamer: Streamer) -> None:
        changing = streamer.print.change.going_on
        new = NewSyringe() if changing else None
        streamer.resume(new)

    whole = Bench(JOB, care=care)
    plan(whole, 0)
    whole.run()
    for effect in range(1, whole.effects + 1):
        bench = Bench(JOB, care=care)
        plan(bench, 0)
        bench.dies_at = effect
        with pytest.raises(HostDiedError):
            bench.run()
        if not bench.journal.history().begun:
            continue  # no line of the job may have left
        bench.printer.said(bench.printer.now + 30.0)
        again = Bench(JOB, bench.printer, care, bench.journal, resume=True)
        plan(again, 1)
        status = again.run()
        assert status.state is LinkState.DONE, (effect, status.message)
        assert made_of(again.printer, OWN) == CLEAN, effect
