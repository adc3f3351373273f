"""Pauses, changes of syringe and typed commands, by events alone."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise

import pytest

from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.control.requests import ResumeRequest
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import (
    CALM,
    CLEAN,
    ENDS,
    JOB,
    RELOADS,
    Bench,
    HostDiedError,
    Instant,
    assert_exact,
    assert_true,
    die,
    layers,
    made_of,
    pause,
    pause_after_layer,
    reload,
    resume,
    stop,
)
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_families import FAKES, facts


@pytest.mark.parametrize("line", [3, 4, 7, 12, 14, 20, len(JOB) - 1])
def test_pause_after_any_line_lifts_the_needle_and_comes_back_to_it(line):
    bench, seen = Bench(JOB), []

    def look_and_resume(streamer: Streamer) -> None:
        seen.append((bench.printer.place["Z"], streamer.status.lines_done))
        streamer.resume()

    bench.on_line(line, pause)
    bench.when(LinkState.PAUSED, look_and_resume)
    assert_exact(bench)
    [(z, done)] = seen
    assert z >= 14.0
    assert done >= line
    held = [LinkState.PAUSING, LinkState.PAUSED, LinkState.RESUMING, LinkState.PRINTING]
    assert bench.states[-4:] == held
    motors_off = [text for text in bench.printer.numbered if text.startswith("M84")]
    assert motors_off == ["M84 S0"]  # before the first line, else Marlin cuts them in a long dwell


def test_pause_after_a_layer_is_journalled_at_once_and_held_at_its_mark():
    bench = Bench(JOB)

    def request(streamer: Streamer) -> None:
        with pytest.raises(LinkError, match="has no end of a vessel after line 5"):
            streamer.pause(MarkKind.VESSEL)
        streamer.pause(MarkKind.LAYER)
        assert bench.recorded("wanted")[-1]["after"] == MarkKind.LAYER

    bench.on_line(5, request)
    bench.when(LinkState.PAUSED, resume)
    assert_exact(bench)
    [paused] = bench.pauses
    assert paused.lines_done == ENDS[0]
    assert "end of layer 1" in paused.message


@pytest.mark.parametrize("request_", [pause_after_layer, reload])
def test_pause_that_is_waited_for_can_be_taken_back(request_):
    bench = Bench(JOB)
    bench.on_line(5, request_)
    bench.on_line(8, resume)
    assert_exact(bench)
    assert bench.pauses == []
    assert bench.journal.history().wanted is None


def test_a_pause_of_half_an_hour_keeps_the_printer_awake():
    """Marlin switches off by itself (M85) where no command comes."""
    bench, commands = Bench(JOB), list[float]()
    carry_out = bench.printer._carry_out

    def timed(command: str) -> None:
        commands.append(bench.printer.now)
        carry_out(command)

    bench.printer._carry_out = timed
    bench.on_line(5, pause)
    bench.when(LinkState.PAUSED, lambda streamer: bench.after(1800.0, resume))
    assert_exact(bench)
    assert commands[-1] > 1800
    assert max(b - a for a, b in pairwise(commands)) < 60


@pytest.mark.parametrize(("confirmed", "stops"), [(False, False), (True, False), (False, True)])
def test_print_that_nobody_confirms_is_held_at_the_next_mark_or_stopped(confirmed, stops):
    bench = Bench(JOB, care=Care(checkpoint_s=None, deadman_s=0.5, deadman_stops=stops))
    bench.when(LinkState.PAUSED, resume, resume)
    for line in range(1, len(JOB)) if confirmed else ():
        bench.on_line(line, lambda streamer: streamer.alive())
    status = bench.run()
    if stops:
        assert (status.state, status.position_known) == (LinkState.STOPPED, True)
        assert "no operator confirmed" in status.message
        assert_true(bench, status)
        return
    assert_exact(bench, status)
    assert bool(bench.pauses) is not confirmed
    assert all("no operator confirmed" in one.message for one in bench.pauses)
    assert {one.lines_done for one in bench.pauses} <= set(ENDS)
    assert any("no operator confirmed" in text for text in bench.alarms) is not confirmed
    assert bench.statuses[-1].deadman_left_s is not None


def test_resume_is_refused_while_the_needle_is_elsewhere_and_it_stays_up():
    bench, answers, heights = Bench(JOB), list[str](), list[float]()

    def elsewhere(streamer: Streamer) -> None:
        streamer.command(b"G1 X90", lambda said: streamer.resume(answer=answers.append))

    def back(streamer: Streamer) -> None:
        heights.append(bench.printer.place["Z"])
        assert "not resumed: X is 90.00 mm" in streamer.status.message
        x = JOB.lines[streamer.status.lines_done - 1].split(b"X")[1].split()[0]
        streamer.command(b"G1 X" + x, lambda said: streamer.resume(answer=answers.append))

    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, elsewhere, back)
    assert_exact(bench)
    assert heights[0] >= 14.0
    assert answers[0].startswith("not resumed: ")
    assert answers[1] == ""


def test_extra_prime_is_pushed_and_not_counted():
    bench = Bench(JOB, retreat=Retreat(relief_mm=0.1, prime_mm=0.05, lift_mm=4.0))
    bench.on_line(8, pause)
    bench.when(LinkState.PAUSED, resume)
    assert_exact(bench)
    e = float(JOB.lines[bench.pauses[0].lines_done - 1].split(b"E")[1].split()[0])
    primed = bench.printer.numbered.index(f"G1 E{e + 0.05:.5f} F30")
    assert bench.printer.numbered[primed + 1] == f"G92 E{e:.5f}"


@pytest.mark.parametrize("firmware", [None, *FAKES])
@pytest.mark.parametrize("moved_mm", [0.3, -0.3])
def test_a_plunger_moved_by_hand_in_a_pause_is_never_drawn_back_in_the_gel(firmware, moved_mm):
    """Relieved by 0.1 mm, moved at the panel: all that follows in the gel is the push of 0.1 mm."""
    printer = ScriptedPrinter() if firmware is None else Instant(FAKES[firmware]())
    board = printer if firmware is None else printer.fake
    care = Care(checkpoint_s=None)
    bench = Bench(JOB, printer, care, profile=facts(firmware or "marlin"))
    bench.on_line(8, pause)

    def by_hand(streamer: Streamer) -> None:
        board.at["E"] += moved_mm
        if hasattr(board, "motors"):
            board.motors = dict(board.at)
        streamer.resume()

    bench.when(LinkState.PAUSED, by_hand)
    status = bench.run()
    assert status.state is LinkState.DONE, status
    at = float(JOB.lines[bench.pauses[0].lines_done - 1].split(b"E")[1].split()[0])
    commands = board.executed
    begin = commands.index(f"G92 E{at - 0.1:.5f}")
    after = [one for one in commands[begin + 1 :] if re.match(r"G1 .*E", one)]
    assert after[0] == f"G1 E{at:.5f} F30"
    lowered = [k for k, one in enumerate(commands) if re.match(r"G1 Z[\d.]+ F", one) and k > begin]
    assert lowered  # the plunger is counted above the gel, before the needle comes down
    [alarm] = [one for one in bench.alarms if "the plunger is at E" in one]
    assert f"moved by {moved_mm:+.2f} mm during the pause" in alarm


@pytest.mark.parametrize(("every", "expected"), [(0.0, 6), (1.5, 3), (None, 0)])
def test_checkpoints_are_made_at_marks_as_often_as_requested(every, expected):
    bench = Bench(layers(6, 8), care=Care(checkpoint_s=every))
    assert_exact(bench)
    made = [record["done"] for record in bench.recorded("checkpoint")]
    ends = {mark.index for mark in bench.job.marks.of(MarkKind.LAYER)}
    assert len(set(made) & ends) == expected
    assert made[-1] == len(bench.job)  # at the end alone it is held up for it
    assert bench.printer.numbered.count("M400") == 3  # the job's, and before and behind it


def test_checkpoint_finds_a_position_that_is_not_the_jobs():
    bench = Bench(layers(6, 8), care=Care(checkpoint_s=0.0))
    bench.on_line(ENDS[0] - 1, lambda _: bench.printer.at.update(Y=bench.printer.at["Y"] + 3.0))
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert re.search(r"Y is 5\d\.\d\d", status.message)


@pytest.mark.parametrize("firmware", FAKES)
def test_other_families_pause_and_change_the_syringe_as_well(firmware):
    fake = FAKES[firmware]()
    care = Care(checkpoint_s=0.0, reload_at=(RELOADS[0],))
    bench = Bench(layers(2, 8), Instant(fake), care, profile=facts(firmware))
    bench.when(LinkState.PAUSED, lambda streamer: streamer.resume(NewSyringe()))
    assert bench.run().state is LinkState.DONE
    assert [one.lines_done for one in bench.pauses] == [RELOADS[0]]
    assert not any(line.startswith("M84") for line in fake.executed)


# --- stops in a pause -------------------------------------------------------------------------


@pytest.mark.parametrize("seconds", [0.05, 0.35, 0.6])
def test_stop_at_any_moment_of_a_pause_leaves_a_needle_that_stands(seconds):
    bench = Bench(JOB)
    bench.on_line(10, pause)
    bench.when(LinkState.PAUSING, lambda streamer: bench.after(seconds, stop))
    status = bench.run()
    assert status.state is LinkState.STOPPED
    assert_true(bench, status)


# --- syringes ---------------------------------------------------------------------------------


def drive_and_resume(streamer: Streamer) -> None:
    """Drive the plunger back for a new syringe and forward to its ink, then say so."""
    streamer.command(b"G1 E-20 F60", lambda said: None)
    streamer.command(b"G1 E-17.5 F60", lambda said: streamer.resume(NewSyringe(2.5)))


@pytest.mark.parametrize("planned", [True, False])
def test_syringe_is_changed_at_a_reload_point_and_the_plunger_counted_anew(planned):
    bench = Bench(JOB, care=replace(CALM, reload_at=(RELOADS[0],) * planned))
    if not planned:
        bench.on_line(4, reload)
    bench.when(LinkState.PAUSED, drive_and_resume)
    assert_exact(bench)
    assert "change the syringe" in bench.pauses[0].message
    [syringe] = bench.recorded("syringe")
    assert syringe["done"] == RELOADS[0]
    assert syringe["command"].startswith("G92 E")
    assert bench.printer.by_number[syringe["n"]] == syringe["command"]
    assert max(one.end["Z"] for one in bench.printer.made) == 16.25  # parked 6 mm above
    history = bench.journal.history()
    assert (history.reloaded, history.reload) == (RELOADS[0], None)


def test_resume_from_a_change_of_syringe_wants_to_know_what_was_put_in():
    bench, refusals = Bench(JOB), list[str]()

    def unsaid(streamer: Streamer) -> None:
        with pytest.raises(Refused, match="--plunger-mm") as refused:
            streamer.resume()
        refusals.append(str(refused.value))
        streamer.print.queue.add(ResumeRequest())  # the printer's own button

    def unchanged(streamer: Streamer) -> None:
        assert "not resumed" in streamer.status.message
        streamer.resume(unchanged=True)

    bench.on_line(4, reload)
    bench.when(LinkState.PAUSED, unsaid, unchanged)
    assert_exact(bench)
    assert refusals
    assert not bench.recorded("syringe")


def test_new_syringe_is_refused_where_none_is_changed_or_room_is_being_made():
    refused = []

    def early(streamer: Streamer) -> None:
        if streamer.print.change.going_on and streamer.status.state is LinkState.PAUSING:
            with pytest.raises(LinkError, match="isn't paused yet"):
                streamer.resume(NewSyringe())
            refused.append(streamer.status)

    def unasked(streamer: Streamer) -> None:
        with pytest.raises(LinkError, match="`printctl reload RUN` first"):
            streamer.resume(NewSyringe())
        streamer.resume()

    bench = Bench(JOB, care=replace(CALM, reload_at=(RELOADS[0],)))
    bench.on_line(5, pause)
    bench.when(LinkState.PAUSED, unasked, drive_and_resume)
    soon = [0.1 * k for k in range(1, 20)]
    bench.when(LinkState.PAUSING, *[lambda _: [bench.after(s, early) for s in soon]] * 9)
    assert_exact(bench)
    assert refused
    assert len(bench.pauses) == 2


def test_pause_becomes_a_change_of_syringe_where_it_stands():
    bench = Bench(JOB)
    bench.on_line(8, pause)
    bench.when(LinkState.PAUSED, reload, drive_and_resume)
    assert_exact(bench)
    assert len(bench.pauses) == 2
    assert bench.recorded("syringe")[0]["done"] == bench.pauses[0].lines_done


def test_syringe_that_does_not_last_to_the_next_reload_point_is_not_gone_on_with():
    answers: list[str] = []
    used = iter([0.95, 0.0])
    bench = Bench(JOB, care=replace(CALM, reload_at=(RELOADS[0],), capacity_mm=1.0))
    bench.when(
        LinkState.PAUSED,
        *[lambda streamer: streamer.resume(NewSyringe(next(used)), answer=answers.append)] * 2,
    )
    assert_exact(bench)
    assert "the syringe has 0.05 mm left" in bench.pauses[1].message
    assert answers == [bench.pauses[1].message, ""]


@pytest.mark.parametrize("dies", [False, True])
def test_a_refill_is_of_the_syringe_that_was_put_in_last(dies):
    """Told by its used travel alone: its capacity isn't the one's that the print began with."""
    put_in = iter([NewSyringe(0.0, "small", 0.525), NewSyringe(0.02)])
    job = parse_job(layers(3, 8), "bench.gcode")
    reloads = tuple(one.index for one in job.marks.of(MarkKind.RELOAD))[:2]
    care = replace(CALM, reload_at=reloads, syringe="large", capacity_mm=50.0)
    bench = Bench(job, care=care)
    bench.when(LinkState.PAUSED, *[lambda streamer: streamer.resume(next(put_in))] * 2)
    if dies:
        bench.on_line(reloads[0] + 3, die)
        with pytest.raises(HostDiedError):
            bench.run()
        bench = Bench(job, bench.printer, care, bench.journal, resume=True)
        bench.when(LinkState.PAUSED, lambda streamer: streamer.resume(next(put_in)))
    assert_exact(bench)
    told = [(one["name"], one["capacity_mm"]) for one in bench.recorded("syringe")]
    assert told == [("small", 0.525)] * 2


# --- commands that a person types -------------------------------------------------------------


@pytest.mark.parametrize(
    "line",
    ["G0 Z15 F60", "G 1 Z-50", "g1z2", "G1 F60", "G1 E5 F60", "G28", "G92 Z0", "G91", "M28", "M84"]
    + ["M104 S250", "M92 X1", "M221 S50", "M206 X1", "M211 S0", "M502", "M500", "M111 S8", "T1"]
    + ["M400", "M118 ok", "M112", "M999", "M410", "M108", "M85 S0", "M204 P1", "M302 P0"],
)
def test_what_moves_or_sets_is_refused_in_a_print_which_goes_on(line):
    bench = Bench(JOB)
    bench.on_line(9, lambda _: bench.typed(line))
    assert_exact(bench)
    [refusal] = bench.refusals
    assert "printctl station" not in refusal  # it has no print to act on
    assert ("`printctl emergency-stop`" in refusal) == (line == "M112")


def test_questions_fans_and_warmth_within_limits_go_out_in_a_print():
    bench = Bench(JOB)
    lines = ["M105", "M114", "M106 P0 S128", "M104 S37", "M140 S30"]
    bench.on_line(9, lambda _: bench.typed("m 105", *lines[1:]))
    assert_exact(bench)
    assert (bench.refusals, len(bench.answers)) == ([], 5)
    at = bench.printer.numbered.index("M106 P0 S128")
    assert bench.printer.numbered[at - 2 : at + 3] == lines


def test_a_question_that_the_firmware_doesnt_know_ends_no_print():
    class Terse(ScriptedPrinter):
        def _reply(self, word: str, command: str) -> str:
            unknown = 'echo:Unknown command: "M119"\nok\n'
            return unknown if word == "M119" else super()._reply(word, command)

    bench = Bench(JOB, Terse())
    bench.on_line(9, lambda _: bench.typed("M119"))
    assert_exact(bench)
    assert b"unknown command" in b" ".join(bench.answers[0])


@pytest.mark.parametrize(
    ("lines", "refused", "sent", "state"),
    [
        (["M105", "M500"], 1, "M105", LinkState.DONE),
        (["G1 E-5 F60", "G1 E0 F60000", "G1 E900 F60", "G1 X51 E0 F60"], 3, "G1 E-5 F60",
         LinkState.DONE),
        (["G1 X60", "G1 Z1", "G1 X900", "G1 Z500", "G0 F60000 X61", "G28"], 5, "G1 X60 F300",
         LinkState.STOPPED),
    ],
)  # fmt: skip
def test_commands_in_a_pause_go_by_limits_and_a_feed_of_their_own(lines, refused, sent, state):
    bench = Bench(JOB)

    def typed(streamer: Streamer) -> None:
        bench.typed(*lines)
        bench.after(60.0, resume)

    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, typed, stop)  # it isn't gone on with from elsewhere
    status = bench.run()
    assert status.state is state, status.message
    assert len(bench.refusals) == refused
    assert len(bench.answers) == 1
    before = bench.printer.numbered.index(JOB.lines[4].decode())
    ours = [line for line in bench.printer.numbered[before:] if line in (*lines, sent)]
    assert ours.count(sent) >= 1
    assert set(ours) == {sent}


# --- a printer whose count of lines is set back while the needle is away -----------------------


@pytest.mark.parametrize(
    ("typed", "later_s", "changing"),
    [
        (["G1 X51 F600"], 0.0, False),
        (["G1 Z20 F600"], 0.0, False),
        (["G1 E-0.01 F60"], 0.0, True),
        (["M114", "G1 X1 F600"], 30.0, False),  # the sign of life has found it by then
        ([], 0.0, False),
    ],
)
def test_a_board_that_was_reset_without_a_word_in_a_pause_moves_nothing(typed, later_s, changing):
    bench = Bench(JOB)

    def lose_place(_: Streamer) -> None:
        bench.printer.reset_now(silently=True)
        bench.after(later_s, lambda _: bench.typed(*typed))

    bench.on_line(9, reload if changing else pause)
    bench.when(LinkState.PAUSED, lambda _: bench.after(1.0, lose_place))
    assert_lost_unmoved(bench)


@pytest.mark.parametrize("state", [LinkState.PAUSING, LinkState.RESUMING])
@pytest.mark.parametrize("seconds", [0.01, 0.1, 0.25, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7])
def test_a_board_that_was_reset_without_a_word_on_the_links_own_way_moves_nothing(state, seconds):
    bench = Bench(JOB, retreat=Retreat(lift_mm=8.0, park_mm=6.0))
    reset = [lambda _: bench.after(seconds, lambda _: bench.printer.reset_now(silently=True))]
    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, resume)
    bench.when(state, *reset)
    assert_lost_unmoved(bench)


def assert_lost_unmoved(bench: Bench) -> None:
    """The print ends with an unknown position, and nothing was moved since the board's reset."""
    moved, reset_now = list[int](), bench.printer.reset_now

    def count(silently: bool) -> None:
        reset_now(silently)
        moved.append(len(bench.printer.taken))

    bench.printer.reset_now = count
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.POSITION_UNKNOWN, False), status
    assert moved == [len(bench.printer.taken)], bench.printer.taken[moved[0] :]


def test_a_count_of_lines_set_back_by_another_program_in_a_pause_ends_no_print():
    """The place is still where the needle was led to."""
    bench = Bench(JOB)

    def set_back(_: Streamer) -> None:
        bench.printer.last = 0
        bench.after(60.0, resume)

    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, set_back)
    status = bench.run()
    assert status.state is LinkState.DONE, status.message
    assert made_of(bench.printer, JOB.lines) == CLEAN
    assert any("line counter became 0" in text for text in bench.alarms)
