"""Prints on printers and lines that aren't as they should be, by events alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import reduce
from operator import xor

import pytest

from firmware_profiles.families.timing import MAX_REFUSALS
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.detection import PortPrograms
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import (
    JOB,
    PRINTER,
    Bench,
    HostDiedError,
    Wire,
    assert_exact,
    assert_true,
    clean_run,
    layers,
    made_of,
    pause,
    resume,
    stop,
)
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.jobs import parse_job

LONG = parse_job(layers(4, 100), "bench.gcode")
STOPPED = "Printer stopped due to errors. Fix the error and use M999 to restart."


class Answering(ScriptedPrinter):
    """Answers some commands in other words: by their first word, or the command itself."""

    def __init__(self, **answers: str | Callable[[str], str]) -> None:
        super().__init__()
        self.answers = answers

    def _reply(self, word: str, command: str) -> str:
        answer = self.answers.get(word)
        said = super()._reply(word, command)
        return said if answer is None else answer if isinstance(answer, str) else answer(said)


# --- before the first line --------------------------------------------------------------------


def silent() -> ScriptedPrinter:
    printer = ScriptedPrinter()
    printer.mute = True
    return printer


def other_steps() -> ScriptedPrinter:
    printer = ScriptedPrinter()
    printer.steps = "  M92 X80.00 Y80.00 Z400.00 E500.00"
    return printer


def resetting() -> ScriptedPrinter:
    printer = ScriptedPrinter()
    printer.reset_at = 11
    return printer


class Refusing(ScriptedPrinter):
    """Doesn't take line ``at``, ``times`` times: ``how`` it answers."""

    def __init__(self, at: int, times: float, how: str) -> None:
        super().__init__()
        self.at_number, self.times, self.how, self.tries = at, times, how, 0

    def _take(self, line: str) -> bytes:
        if self.last != self.at_number - 1 or not line.startswith(f"N{self.last + 1} "):
            return super()._take(line)
        self.tries += 1
        if self.tries > self.times:
            return super()._take(line)
        says = {"oks": b"ok\n", "swallows": b""}
        return says[self.how] if self.how in says else self._refuse("checksum mismatch")


@pytest.mark.parametrize(
    ("printer", "words"),
    [
        (silent, ["no firmware replies at bench", "baud rate (profile: 115200)"]),
        (other_steps, ["E has 500 steps/mm in the firmware, 6400 in the profile"]),
        (resetting, ["reset during the handshake"]),
        (lambda: Refusing(2, 1e9, "refuses"), ["(a command, sent as N2)"]),
        (lambda: Answering(M92=lambda said: f"Error:Heating failed\n{said}"), ["Heating failed"]),
    ],
    ids=["silent", "steps", "reset", "refuses", "error"],
)
def test_printer_that_doesnt_agree_is_refused_before_the_first_line(printer, words):
    bench = Bench(JOB, printer())
    status = bench.run()
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert all(one in status.message for one in words), status.message
    assert bench.printer.taken == []
    assert bench.exchange.now_s < 30 or "sent as" in status.message


# --- lines that aren't taken ------------------------------------------------------------------


@pytest.mark.parametrize("how", ["refuses", "swallows", "oks"])
def test_a_line_that_is_never_taken_ends_the_print(how):
    bench = Bench(LONG, Refusing(60, 1e9, how))
    bench.when(LinkState.PAUSED, *[resume] * 200)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    words = ["sent as N60)", f"{MAX_REFUSALS} attempts", "check cable, grounding and firmware"]
    assert all(one in status.message for one in [*words, "needle wasn't lifted"])
    assert ("checksum mismatch" in status.message) == (how == "refuses")
    again = Bench(LONG, bench.printer, journal=bench.journal, resume=True)
    status = again.run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert "sent as N60)" in status.message
    assert "`printctl recover`" in status.message
    assert bench.printer.last == 59


@pytest.mark.parametrize("how", ["refuses", "swallows"])
def test_a_line_that_is_refused_for_long_but_taken_ends_no_print(how):
    bench = Bench(LONG, Refusing(60, MAX_REFUSALS - 1, how))
    bench.when(LinkState.PAUSED, *[resume] * 200)
    assert_exact(bench)


class SurplusInPause(Wire):
    """The line by which the plunger comes back from a pause is lost, and a stray ok heard."""

    plunger_moves = stray = 0

    def down(self, data: bytes) -> bytes:
        if b" G1 E" in data and b" F30*" in data:
            self.plunger_moves += 1
            if self.plunger_moves == 2:
                self.stray = 1
                return b""
        return data

    def up(self, data: bytes) -> bytes:
        stray, self.stray = self.stray, 0
        return b"ok\n" * stray + data


@pytest.mark.parametrize("breaks", [False, True])
def test_command_that_was_not_taken_after_all_is_counted_where_it_was(breaks):
    bench = Bench(JOB, wire=SurplusInPause())
    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, resume, resume)
    if breaks:
        bench.on_line(16, lambda _: setattr(bench, "lost_at", bench.effects))
        assert bench.run().error == "PortLost"
        bench = Bench(JOB, bench.printer, journal=bench.journal, resume=True)
    assert_exact(bench)
    if not breaks:
        assert bench.wire.plunger_moves >= 3


class Asleep(Bench):
    """A host that sleeps for an hour now and then."""

    def _next(self, until_s: float) -> tuple[float, bytes]:
        now, data = super()._next(until_s)
        return now + 3600.0 * (self.events % 37 == 36), data


def test_clock_that_jumps_does_no_harm():
    bench = Asleep(JOB)
    assert_exact(bench, bench.run(limit_s=1e9))
    assert bench.exchange.now_s > 3600


# --- complaints of the printer ----------------------------------------------------------------


class Faulty(ScriptedPrinter):
    """From the ``at``-th move on it moves no motor, and says ``words`` to each, or ``once``."""

    def __init__(self, words: str = "", at: int = 9, renames: bool = False) -> None:
        super().__init__()
        self.words, self.faulty_at, self.renames, self.once = words, at, renames, False
        self.moves = 0

    def _carry_out(self, command: str) -> None:
        self.moves += command.startswith("G1 ")
        if self.moves < self.faulty_at or not command.startswith("G1 "):
            super()._carry_out(command)
            return
        if self.renames:  # it takes the place and moves no motor
            for axis, value in re.findall(r"([XYZE])(-?[\d.]+)", command):
                self.renamed_mm[axis] += float(value) - self.at[axis]
                self.at[axis] = float(value)
        self.say(f"{self.words}\nok\n".encode() if self.words else b"ok\n")
        self.words = "" if self.once else self.words


@pytest.mark.parametrize("once", [False, True])
def test_a_stopped_printer_ends_the_print_at_the_first_move_it_ignores(once):
    """One that ignores the way out isn't said to be lifted, though it complains no more."""
    printer = Faulty(STOPPED)
    printer.once = once
    status = Bench(JOB, printer).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert "Printer stopped due to errors" in status.message
    assert status.lines_done <= 12


@pytest.mark.parametrize("renames", [True, False])
def test_a_printer_that_acknowledges_and_does_not_move_is_not_done(renames):
    bench = Bench(JOB, Faulty(at=3, renames=renames))
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert status.lines_executed <= 5
    assert not any(one["agrees"] for one in bench.recorded("checkpoint"))


def test_an_end_that_cannot_be_compared_is_done_and_says_so():
    status = Bench(JOB, Answering(M114="ok\n")).run()
    assert status.state is LinkState.DONE
    assert "not verified" in status.message


@pytest.mark.parametrize(("axis", "steps"), [("X", 4), ("Z", 6), ("X", -4), ("Z", -6)])
def test_motors_some_steps_off_behind_the_last_move_are_not_done(axis, steps):
    bench = Bench(JOB)
    shift = steps / {"X": 80, "Z": 400}[axis]

    def slip(_: Streamer) -> None:
        bench.printer.renamed_mm[axis] -= shift

    bench.on_line(len(JOB) - 1, slip)
    assert bench.run().state is LinkState.POSITION_UNKNOWN
    assert "plunger position not verified" in bench.recorded("checkpoint")[-1]["compared"]


@pytest.mark.parametrize(
    ("says", "state", "words"),
    [
        (b"some text\nError:Thermal Runaway\n", LinkState.FAILED, "Thermal Runaway"),
        (b"Wobble exceeded\n", LinkState.DONE, "Wobble exceeded"),
        (b"//action:cancel\n", LinkState.STOPPED, "cancelled by the printer (//action:cancel)"),
        (b"echo: cold extrusion prevented\n", LinkState.FAILED, "cold extrusion prevented"),
    ],
)
@pytest.mark.parametrize("where", ["print", "pause", "end"])
def test_what_a_printer_says_of_its_own_accord_is_told(says, state, words, where):
    bench = Bench(JOB)

    def say(_: Streamer) -> None:
        bench.printer.say(says)

    bench.on_line(
        {"print": 9, "pause": 8, "end": len(JOB)}[where], pause if where == "pause" else say
    )
    bench.when(LinkState.PAUSED, lambda streamer: (say(streamer), bench.after(30.0, resume)))
    status = bench.run()
    assert status.state is state, status.message
    assert words in status.message or (words.startswith("Wobble") and where != "print")
    assert_true(bench, status)


# --- stops on odd printers --------------------------------------------------------------------


def test_stop_after_homing_asks_where_the_needle_is():
    job = parse_job(b"G28\n" + b"M105\n" * 60, "bench.gcode")
    bench = Bench(job, retreat=Retreat())
    bench.printer.at.update(Z=3.0, E=1.0)
    bench.on_line(10, stop)
    assert bench.run().state is LinkState.STOPPED
    assert bench.printer.numbered[-3:] == ["G1 E0.90000 F30", "G1 Z23.00000 F300", "M400"]


@pytest.mark.parametrize("bed", [True, False])
@pytest.mark.parametrize("known", [True, False])
def test_heater_that_the_firmware_does_not_have_leaves_the_place_known(bed, known):
    """A real Marlin without a bed quoted M140 S0 as unknown on the way out (2026-11-28)."""
    unknown = 'echo:Unknown command: "M104 S0"\nok\n'
    printer = Answering(
        M105=lambda said: said if bed else said.replace(" B:21.00 /0.00", "").replace(" B@:0", ""),
        **{} if known else {"M104": unknown, "M140": unknown},
    )
    bench = Bench(JOB, printer, profile=PRINTER.model_copy(update={"safe_state_on": ()}))
    bench.on_line(15, stop)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True)
    assert ("M140 S0" in bench.printer.numbered) is bed


# --- words that slip through their checksums --------------------------------------------------


class Slips(Wire):
    """Words of some numbers are changed on their way, and the checksum is right."""

    def __init__(self, slips: Callable[[int], bool], pattern: bytes, by: bytes, noisy: int = 0):
        self.slips, self.pattern, self.by, self.noisy = slips, pattern, by, noisy

    def down(self, data: bytes) -> bytes:
        number = re.match(rb"N(\d+) G1 X", data)
        if number is None:
            return data
        if int(number[1]) == self.noisy:
            self.noisy = 0
            return data.replace(b"G1", b"G3")
        if not self.slips(int(number[1])):
            return data
        body = re.sub(self.pattern, self.by, data.split(b"*")[0])
        return b"%b*%d\n" % (body, reduce(xor, body))


def test_controlled_stop_never_lowers_a_needle_that_stands_higher_than_the_job_says():
    bench = Bench(LONG, wire=Slips(lambda n: n == 10, rb"X\S+", b"Z60.000"))
    bench.on_line(30, stop)
    assert bench.run().state is LinkState.STOPPED
    assert "G1 Z64.00000 F300" in bench.printer.numbered
    assert any("Z is 60.00 mm" in text for text in bench.alarms)


def test_height_that_slipped_behind_noise_ends_the_print_at_the_first_comparison():
    bench = Bench(LONG, care=Care(), wire=Slips(lambda n: n == 63, rb"X", b"Z", noisy=55))
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 5" in status.message
    assert status.lines_done < 100


def test_word_that_slipped_through_and_was_given_again_is_told():
    bench = Bench(
        LONG, care=Care(), wire=Slips(lambda n: n % 7 == 0, rb" X\S+", b" X51.000", noisy=55)
    )
    status = bench.run()
    assert status.state is LinkState.DONE or "X is 51.00 mm where" in status.message
    told = [text for text in bench.alarms if "slipped through its checksum" in text]
    assert all("X is 51.00 mm where the job says 5" in text for text in told)
    assert told or status.state is not LinkState.DONE


def test_answers_that_are_all_doubled_make_one_alarm_with_a_count():
    class Doubling(Wire):
        def up(self, data: bytes) -> bytes:
            return re.sub(rb"(ok[^\n]*\n)", rb"\1\1", data)

    bench = Bench(JOB, wire=Doubling())
    bench.when(LinkState.PAUSED, *[resume] * 99)
    status = bench.run()
    assert status.state is LinkState.DONE
    assert status.alarms == 1
    [text] = bench.alarms
    assert "another program or noise wrote to this printer" in text
    assert int(text.rsplit("(", 1)[1].removesuffix(" times)")) > 15
    assert len(bench.recorded("alarm") + bench.recorded("repeated")) < 12


# --- other programs ---------------------------------------------------------------------------

OTHERS = "another program or noise wrote to this printer: 1 reply more than lines sent"


@pytest.mark.parametrize(
    ("writes", "words"),
    [
        (b"G1 Z60 F600\n", "Z is 60"),
        (b"G92 X0\n", "X is offset by"),
        (b"G92 Y-3 X20\n", "Y is offset by"),
    ],
)
def test_what_another_program_moves_or_renames_ends_the_print(writes, words):
    bench = Bench(LONG)
    bench.on_line(20, lambda _: bench.printer.take(writes, bench.exchange.now_s))
    bench.when(LinkState.PAUSED, resume)
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert words in status.message
    assert any(OTHERS in text for text in bench.alarms)


def test_place_renamed_without_an_answer_that_is_noticed_ends_the_print():
    bench = Bench(JOB)

    def rename(_: Streamer) -> None:
        bench.printer._carry_out("G92 X1")
        bench.printer._out.pop()

    bench.on_line(9, rename)
    status = bench.run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "X is offset by" in status.message


@pytest.mark.parametrize("complete", [True, False])
def test_missing_answers_on_a_clean_wire_are_told_as_perhaps_read(complete):
    class Robbed(Wire):
        count = 0

        def up(self, data: bytes) -> bytes:
            self.count += data == b"ok\n"
            return b"" if data == b"ok\n" and self.count % 9 == 8 else data

    bench = Bench(LONG, wire=Robbed())
    bench.wiring.transport.programs = lambda: PortPrograms(complete=complete)
    status = bench.run()
    assert status.state is LinkState.DONE
    told = any("another program may be reading this port" in text for text in bench.alarms)
    assert told is not complete


@pytest.mark.parametrize("other", ["reset", "G92 Z15", "G92 Z5", "G92 X57"])
@pytest.mark.parametrize("effect", [55, 80])
def test_printer_that_isnt_as_it_was_when_the_host_died_is_not_gone_on_with(other, effect):
    first = Bench(JOB)
    first.dies_at = effect
    with pytest.raises(HostDiedError):
        first.run()
    printer = first.printer
    printer.said(printer.now + 30.0)
    if other == "reset":
        printer.reset_now()
    else:
        printer.take(f"\n{other}\n".encode(), printer.now)
    printer.said(printer.now + 1.0)
    before = dict(printer.place)
    counts = dict(printer.renamed_mm)
    status = Bench(JOB, printer, journal=first.journal, resume=True).run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert other == "reset" or f"{other.split()[1][0]} is offset by" in status.message
    assert (printer.place, printer.renamed_mm) == (before, counts)


# --- true causes ------------------------------------------------------------------------------


class GarbledPlaces(Wire):
    """The first answers to M114 lose their places on the way."""

    left = 2

    def up(self, data: bytes) -> bytes:
        if b"Count X:" in data and self.left:
            self.left -= 1
            return data.replace(b"X:", b"\x7f").replace(b"Y:", b"\x7f")
        return data


def test_garbled_answers_at_the_start_are_asked_again():
    bench = Bench(JOB, wire=GarbledPlaces())
    assert_exact(bench)
    assert not any("still moving" in one.message for one in bench.statuses)


def test_a_fault_of_the_printer_s_own_is_no_refusal_of_the_line_in_flight():
    said = "Error:MINTEMP triggered, system stopped! Heater_ID: bed\n"
    bench = Bench(LONG)
    bench.on_line(46, lambda _: bench.printer.say(said.encode()))
    status = bench.run()
    assert status.state is LinkState.FAILED
    assert "the printer reports 'Error:MINTEMP triggered, system stopped! Heater_ID: bed'" in (
        status.message
    )
    assert "refused" not in status.message


class NoisyFor(Wire):
    """Garbles every third line to the printer from ``begin`` to ``end``, s."""

    def __init__(self, begin: float, end: float) -> None:
        self.begin, self.end, self.count = begin, end, 0

    bench: Bench

    def down(self, data: bytes) -> bytes:
        self.count += 1
        noisy = self.begin < self.bench.exchange.now_s < self.end and self.count % 3 == 0
        return data.replace(b"*", b"?") if noisy and data.startswith(b"N") else data


def test_a_print_paused_by_noise_goes_on_by_itself_once_errors_are_few():
    wire = NoisyFor(5.0, 200.0)
    bench = Bench(LONG, care=Care(checkpoint_s=None, noise_window=50, noise_limit=4), wire=wire)
    wire.bench = bench
    assert_exact_long(bench)
    assert len(bench.pauses) == 1
    assert "the print resumes by itself once errors are rare" in bench.pauses[0].message
    assert bench.exchange.now_s > 200.0


def assert_exact_long(bench: Bench) -> None:
    status = bench.run()
    assert status.state is LinkState.DONE, status
    assert made_of(bench.printer, LONG.lines) == clean_run(LONG.lines)
