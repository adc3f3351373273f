"""Bench: sends events to a print's steps in virtual time, without port, thread or file.

It does what the shell does (`printctl.machine.control.board.shell`), with a scripted printer for
the port and a list for the journal. The next event is whatever comes first: the printer's next
word, the time that the steps wait for, or a request that the test has planned.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from firmware_profiles import Printer, load
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.shell import write_down
from printctl.machine.control.board.steps import Record, Urgent
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import JournalError, PortLost, Refused
from printctl.machine.job.care import Care
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.detection import PortPrograms
from printctl.machine.records.replay import JournalledPrint, replay
from printctl.machine.records.states import LinkState, Status
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.fake_families import FakePrinter
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.looking import patch_at

PRINTER = load(Printer, "generic_marlin")
QUIET_S = 0.05
SHORT = Retreat(lift_mm=4.0, park_mm=6.0)


class HostDiedError(BaseException):
    """In place of kill -9."""


@dataclass
class MemoryJournal:
    """Journal in memory; at its ``full_at``-th record the disk is full, the reserve apart.

    From ``room_at_s`` on there is room again.
    """

    records: list[dict[str, Any]] = field(default_factory=list)
    full_at: float = math.inf
    reserve: int = 1  # records
    room_at_s: float = math.inf
    now_s: float = 0.0
    path: Path = Path("memory")
    lost: bool = False  # a record wasn't added at once

    def add(self, sort: str, **values: Any) -> None:
        if len(self.records) >= self.full_at and self.now_s < self.room_at_s:
            self.lost |= not self.reserve
            raise JournalError("journal memory can't be written: disk full; free space")
        self.records.append({"t": sort, "at": self.now_s, **values})

    def use_reserve(self) -> bool:
        if self.reserve:
            self.full_at, self.reserve = len(self.records) + self.reserve, 0
            return True
        return False

    def keep_reserve(self) -> bool:
        return self.now_s >= self.room_at_s

    def free_bytes(self) -> int:
        return 1 << 40

    def recorded(self, sort: str) -> list[dict[str, Any]]:
        """Records of one sort."""
        return [record for record in self.records if record["t"] == sort]

    def history(self) -> JournalledPrint:
        return replay(self.records)


class Wire:
    """What becomes of bytes on their way; a test overrides it."""

    def down(self, data: bytes) -> bytes:
        return data

    def up(self, data: bytes) -> bytes:
        return data

    def late_s(self) -> float:
        """By how much the next words come late; they come in their order."""
        return 0.0


class Instant:
    """Printer of another family in virtual time: a fake that answers at once."""

    def __init__(self, fake: FakePrinter) -> None:
        self.fake, self.now, self._out = fake, 0.0, b""

    @property
    def due_s(self) -> float:
        return self.now if self._out else math.inf

    def take(self, data: bytes, now: float) -> None:
        self.now = now
        self._out += self.fake.receive(data)

    def said(self, now: float) -> bytes:
        said, self._out = self._out, b""
        return said


class Bench:
    """One process's print of a job, on a printer and a journal that may outlive it."""

    def __init__(
        self,
        job: Job | bytes,
        printer: ScriptedPrinter | Any = None,  # or another family's, by `Instant`
        care: Care | None = None,
        journal: MemoryJournal | None = None,
        wire: Wire | None = None,
        profile: Printer = PRINTER,
        resume: bool = False,
        retreat: Retreat = SHORT,
        fresh: bool = True,
    ) -> None:
        self.job = parse_job(job, "bench.gcode", profile) if isinstance(job, bytes) else job
        self.printer, self.wire = printer or ScriptedPrinter(), wire or Wire()
        self.journal = journal or MemoryJournal()
        self.statuses: list[Status] = []
        self.answers: list[Any] = []  # to what was requested
        self.refusals: list[str] = []
        self.sent: list[bytes] = []
        self.known_at: list[int] = []  # records in the journal when each left
        self.events = self.effects = 0
        self.dies_at: float = math.inf  # the host, in the effect of this number
        self.lost_at: float = math.inf  # the port, in the effect of this number
        self._late: deque[tuple[float, bytes]] = deque()
        self._planned: list[tuple[float, int, Callable[[Streamer], None]]] = []
        self._order = itertools.count()
        self._when: dict[LinkState, list[Callable[[Streamer], None]]] = {}
        self._at_line: dict[int, Callable[[Streamer], None]] = {}
        history = self.journal.history() if resume else None
        if history is not None:
            self.job = self.job.grown_by(history.inserts)
        record = {"id": "1", "name": self.job.name, "sha256": self.job.sha256}
        self.journal.records.append({"t": "job", "at": 0.0, **record, "started": 0.0})
        port = SimpleNamespace(name="bench", stolen=0, programs=PortPrograms)
        wiring = Wiring(
            transport=port,  # type: ignore[arg-type]
            protocol=protocol_for(profile, QUIET_S, care),
            clock=SimpleNamespace(now=lambda: self.exchange.now_s),  # type: ignore[arg-type]
            journal=self.journal,  # type: ignore[arg-type]
            printer=profile,
            retreat=retreat,
            fresh=fresh,
            on_status=self._on_status,
            wall_s=lambda: self.exchange.now_s,
        )
        self.wiring, self.exchange = wiring, wiring.exchange
        self.exchange.now_s = self.printer.now
        self.streamer = Streamer(wiring, self.job, care or Care(checkpoint_s=None))
        self._steps = self.streamer.steps(history)

    # --- what a test plans -------------------------------------------------------------------

    def at(self, time_s: float, act: Callable[[Streamer], None]) -> None:
        """Have something done at a time, s."""
        self._planned.append((time_s, next(self._order), act))
        self._planned.sort()

    def after(self, seconds: float, act: Callable[[Streamer], None]) -> None:
        """Have something done so much later."""
        self.at(self.exchange.now_s + seconds, act)

    def when(self, state: LinkState, *acts: Callable[[Streamer], None]) -> None:
        """Have things done in turn each time that the print passes to a state."""
        self._when[state] = list(acts)

    def on_line(self, done: int, act: Callable[[Streamer], None]) -> None:
        """Have something done once so many of the job's lines are acknowledged."""
        self._at_line[done] = act

    # --- events ------------------------------------------------------------------------------

    def run(self, limit_s: float = 100_000.0) -> Status:
        """Send events to the end of the print; return its last status."""
        try:
            wait = next(self._steps)
            while True:
                try:
                    self._carry_out()
                except PortLost as exc:
                    wait = self._steps.throw(exc)
                    continue
                now, data = self._next(wait.until_s)
                assert now < limit_s, f"it hangs: {self.streamer.status}"
                self.events += 1
                self.exchange.now_s = self.journal.now_s = now
                wait = self._steps.send((now, data))
                self._look_at_lines()
        except StopIteration as end:
            self._carry_out()
            status: Status = end.value
            return status

    def _next(self, until_s: float) -> tuple[float, bytes]:
        now = self.exchange.now_s
        if until_s == -math.inf:
            return now, b""
        planned = self._planned[0][0] if self._planned else math.inf
        late = self._late[0][0] if self._late else math.inf
        at = max(now, min(self.printer.due_s, until_s, planned, late))
        assert at < math.inf, "nothing will ever happen"
        if planned <= at:
            self._planned.pop(0)[2](self.streamer)
        said = self.printer.said(at)
        if said:
            before = self._late[-1][0] if self._late else at
            self._late.append((max(at + self.wire.late_s(), before), said))
        data = b""
        while self._late and self._late[0][0] <= at:
            data += self._late.popleft()[1]
        return at, self.wire.up(data) if data else b""

    def _carry_out(self) -> None:
        effects = self.exchange.effects
        while effects:
            effect = effects.popleft()
            self.effects += 1
            if self.effects == self.dies_at:
                if isinstance(effect, bytes):
                    self.printer.take(effect[: len(effect) // 2], self.exchange.now_s)
                raise HostDiedError
            if isinstance(effect, Record):
                write_down(effect, self.wiring)
            elif isinstance(effect, (bytes, Urgent)):
                self._write(effect if isinstance(effect, bytes) else effect.data)
            else:
                effect()

    def _write(self, data: bytes) -> None:
        if self.effects >= self.lost_at:
            raise PortLost("the cable was pulled")
        self.sent.append(data)
        self.known_at.append(len(self.journal.records))
        self.printer.take(self.wire.down(data), self.exchange.now_s)

    def _on_status(self, status: Status) -> None:
        entered = not self.statuses or self.statuses[-1].state is not status.state
        entered |= not self.statuses or self.statuses[-1].message != status.message
        self.statuses.append(status)
        acts = self._when.get(status.state, []) if entered else []
        if acts:
            acts.pop(0)(self.streamer)

    def _look_at_lines(self) -> None:
        done = self.streamer.protocol.lines_done
        for line in [line for line in self._at_line if line <= done]:
            self._at_line.pop(line)(self.streamer)

    # --- what came of it ---------------------------------------------------------------------

    @property
    def pauses(self) -> list[Status]:
        """First status of each pause."""
        found = [one for one in self.statuses if one.state is LinkState.PAUSED]
        return [one for one, last in zip(found, [None, *found], strict=False) if one != last]

    @property
    def alarms(self) -> list[str]:
        return self.journal.history().alarms

    @property
    def states(self) -> list[LinkState]:
        """States in their order, each once in a row."""
        states = [status.state for status in self.statuses]
        return [state for state, _ in itertools.groupby(states)]

    def typed(self, *lines: str) -> None:
        """Type commands as a person does; see `answers` and `refusals`."""
        for line in lines:
            try:
                self.streamer.typed(line, self.answers.append, self.refusals.append)
            except Refused as exc:
                self.refusals.append(str(exc))

    def recorded(self, sort: str) -> list[dict[str, Any]]:
        """The journal's records of one sort."""
        return self.journal.recorded(sort)


# --- jobs and what their motors must make -----------------------------------------------------


def layers(count: int, moves: int) -> bytes:
    """Zigzag layers with marks; each motion line is unique, so that a doubled one shows."""
    text, e = ["G90", "M82", "G92 X50 Y50 Z10 E0"], 0.0
    for layer in range(count):
        z = 10.0 + 0.25 * layer
        if layer:
            text += [f"G0 X50 Y{50 + layer * 0.06:.3f} F6000", f"G1 E{e + 0.25 - 0.001:.5f} F120"]
        for k in range(moves):
            e += 0.0035
            x, y = 50 + (k + layer + 1) % 2 * 3.5, 50 + k * 0.25 + layer * 0.03
            text.append(f"G1 X{x:.3f} Y{y:.3f} E{e:.5f} F1800")
        text += [f"G1 E{e - 0.25:.5f} F120", f"G0 Z{z + 0.25:g} F600"]
        text += [f";LAYER_END:{layer}", ";RELOAD"]
    return ("\n".join(text) + "\nM400\n").encode()


def lines_of(data: bytes) -> list[bytes]:
    """The commands of G-code, read without the product."""
    rows = (row.partition(b";")[0].strip() for row in data.split(b"\n"))
    return [row for row in rows if row]


def lines_apart(layers: int, lines: int, relieves: bool = True) -> Job:
    """Layers of lines that are each left by a travel."""
    text, e = ["G90", "M82", "G92 X50 Y50 Z10 E0"], 0.0
    for layer in range(layers):
        for k in range(lines):
            text += [f"G0 X50 Y{50 + k + layer * 0.1:g} F6000", f"G0 Z{10 + 0.25 * layer:g} F300"]
            text += [f"G1 E{e:.5f} F60"] * relieves
            e += 0.0035
            text.append(f"G1 X53.5 E{e:.5f} F1800")
            text += [f"G1 E{e - 0.25:.5f} F60"] * relieves
            text.append(f"G0 Z{11 + 0.25 * layer + 0.001 * k:g} F300")
        text.append(f";LAYER_END:{layer}")
    return parse_job(("\n".join(text) + "\nG0 Z20 F300\nM400\n").encode(), "bench.gcode")


def motion(lines: Iterable[bytes]) -> list[str]:
    """The motion lines among a job's, by the commands that are sent."""
    return [line.decode() for line in lines if moves(line)]


def moves(line: bytes) -> bool:
    """Whether a line moves an axis; one with a feed rate alone may be the link's own, too."""
    return line.startswith((b"G0 ", b"G1 ")) and not line.startswith(b"G1 F")


def clean_run(lines: Iterable[bytes]) -> list[tuple[str, dict[str, float], dict[str, float]]]:
    """Each motion line of a job (absolute), from where to where it leads; without a printer."""
    at = {"X": 50.0, "Y": 50.0, "Z": 10.0, "E": 0.0}
    run = []
    for line in lines:
        if not line.startswith((b"G0 ", b"G1 ", b"G92 ")):
            continue
        words = {word[0]: float(word[1:]) for word in line.decode().split()[1:]}
        end = {axis: words.get(axis, mm) for axis, mm in at.items()}
        if moves(line):
            run.append((line.decode(), at, end))
        at = end
    return run


def made_of(printer: ScriptedPrinter, lines: Iterable[bytes]) -> list[tuple[str, Any, Any]]:
    """What the motors made of a job's own lines, in their order; the link's own moves aside."""
    own = set(motion(lines))
    return [(one.line, one.start, one.end) for one in printer.made if one.line in own]


JOB = parse_job(layers(2, 8), "bench.gcode")
CLEAN = clean_run(JOB.lines)
ENDS = [mark.index for mark in JOB.marks.of(MarkKind.LAYER)]
RELOADS = [mark.index for mark in JOB.marks.of(MarkKind.RELOAD)]
CALM = Care(checkpoint_s=None)
LOOKS = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=60.0)


def mend(index: int, job: Job = JOB) -> tuple[str, ...]:
    """A stroke beside the job behind so many of its lines, and the way back."""
    return tuple(patch_at(b"\n".join(job.lines), index))


# --- what people and observers do -------------------------------------------------------------


def resume(streamer: Streamer) -> None:
    streamer.resume()


def stop(streamer: Streamer) -> None:
    streamer.stop()


def pause(streamer: Streamer) -> None:
    streamer.pause()


def pause_after_layer(streamer: Streamer) -> None:
    streamer.pause(MarkKind.LAYER)


def reload(streamer: Streamer) -> None:
    streamer.reload()


def die(_: Streamer) -> None:
    raise HostDiedError


def observe(
    bench: Bench,
    inserts: Mapping[int, Mapping[str, Any]] | None = None,
    decide: Callable[[int], LookDecision | None] = lambda number: LookDecision.GO_ON,
    again: Container[int] = (),
) -> None:
    """Have looks decided by their number, behind what is inserted; those of ``again`` fail."""

    def act(streamer: Streamer) -> None:
        look = streamer.status.look
        assert look is not None
        number, decision = look["number"], decide(look["number"])
        if number in (inserts or {}):
            insert(bench, number, **(inserts or {})[number])
        if decision is not None:
            ends = LookRequest(
                number, bench.answers.append, bench.refusals.append, "seen", decision,
                again=number in again,
            )  # fmt: skip
            streamer.look(ends)

    bench.when(LinkState.LOOKING, *[act] * 20)


def insert(bench: Bench, number: int, lines: Sequence[str] = (), **given: Any) -> None:
    """Request an insert in a look."""
    answers = bench.answers.append, bench.refusals.append
    bench.streamer.look(LookRequest(number, *answers, "a gap", lines=tuple(lines), **given))


# --- what must be true ------------------------------------------------------------------------


def assert_exact(bench: Bench, status: Status | None = None) -> None:
    """The job as it has grown was made once, and that is what is reported."""
    status = status or bench.run()
    assert (status.state, status.position_known) == (LinkState.DONE, True), status.message
    job, history = bench.streamer.job, bench.journal.history()
    assert list(job.inserts) == history.inserts
    assert made_of(bench.printer, job.lines) == (
        CLEAN if job.lines == JOB.lines else clean_run(job.lines)
    )
    assert status.lines_done == status.lines_executed == len(job)
    own = {line.decode() for line in job.lines}
    sent = {n: text for n, text in bench.printer.by_number.items() if n and text not in own}
    assert {n: text for n, text in history.controls.items() if text not in own} == sent, sent


def assert_crosses_high(bench: Bench, park: tuple[float, float, float]) -> None:
    """The needle was parked, and went there and back high above the job."""
    ends = [tuple(one.end[axis] for axis in "XYZ") for one in bench.printer.made]
    assert park in ends
    aside = [math.dist(end[:2], park[:2]) > 0.1 for end in ends]
    crossed = [
        end for end, now, last in zip(ends[1:], aside[1:], aside, strict=False) if now != last
    ]
    assert all(end[2] > 13.9 for end in crossed)


def assert_true(bench: Bench, status: Status) -> None:
    """What was made is a beginning of the job, and no more is reported than is true."""
    made = made_of(bench.printer, bench.job.lines)
    assert made == CLEAN[: len(made)]
    assert len(motion_until(bench, status.lines_executed)) <= len(made)
    own = set(motion(bench.job.lines))
    taken = [line for line in bench.printer.taken if line in own]
    assert len(motion_until(bench, status.lines_done)) <= len(taken)


def assert_stood(bench: Bench) -> None:
    """The line to go on with is the one after those that were wholly made.

    Where others pass the same place, within two decimals, it is the first of them.
    """
    [stood] = bench.recorded("stood")
    made, reported = len(made_of(bench.printer, JOB.lines)), len(motion_until(bench, stood["line"]))
    assert reported == made if stood["certain"] else made - 2 <= reported <= made


def motion_until(bench: Bench, done: int) -> list[bytes]:
    return [line for line in bench.streamer.job.lines[:done] if line.startswith((b"G0", b"G1"))]
