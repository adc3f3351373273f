"""Random lives of small prints with faults, against an oracle: what the printer's motors made.

A life is one print from its first process to its end: its host may die in any effect, its port be
lost, its disk be full; it is gone on with as often as the product allows that. Whatever happens,
the lines that the motors made are a beginning of the job, each made once from its own start to its
own end, and no more is reported than is true.
"""

from __future__ import annotations

import contextlib
import math
import re
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.process.outcome import resumable
from printctl.machine.records.journal import RESERVE, encode
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.states import EARLY, LinkState, Status
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
    moves,
)
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.fake_marlin import slips_through
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.looking import patch_at

FAULTS = ("noise", "lost", "doubled", "late", "mute", "reset", "full", "port", "dies")
REQUESTS = ("pause", "pause after", "reload", "stop", "resume", "typed")
ROUNDED_MM = 0.006
MOST_ATTEMPTS, MOST_TRIES = 6, 60
LIFTED_MM = 13.9
"""Height that each way out ends above: of the job's lowest layer and the lift."""


@cache
def job_of(count: int, moves: int) -> tuple[list[bytes], Job]:
    """Commands as they stand in the file, and the product's job of it."""
    data = layers(count, moves)
    return lines_of(data), parse_job(data, "model.gcode")


expected_of = lru_cache(maxsize=64)(clean_run)


class RandomWire(Wire):
    """Spoils bytes by chance, in both directions."""

    def __init__(self, rng: np.random.Generator, faults: set[str]) -> None:
        self.rng, self.faults = rng, faults
        self.rate = 3.0 if faults == {"doubled", "lost"} else 1.0

    def _hit(self, fault: str, chance: float) -> bool:
        return fault in self.faults and self.rng.random() < chance * self.rate

    def _garbled(self, data: bytes) -> bytes:
        at, bit = int(self.rng.integers(len(data))), 1 << int(self.rng.integers(8))
        return data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :]

    def down(self, data: bytes) -> bytes:
        if self._hit("noise", 0.03):
            garbled = self._garbled(data)
            while slips_through(data, garbled):  # of that only a comparison of places can know
                garbled = self._garbled(data)
            return garbled
        return b"" if self._hit("lost", 0.01) else data

    def up(self, data: bytes) -> bytes:
        if self._hit("noise", 0.02):
            return self._garbled(data)
        if self._hit("doubled", 0.03) and data.endswith(b"ok\n"):
            return data + b"ok\n"
        if self._hit("lost", 0.015) and data.endswith(b"ok\n"):
            return data[: -len(b"ok\n")]
        return data

    def late_s(self) -> float:
        return float(self.rng.uniform(0.1, 9.0)) if self._hit("late", 0.01) else 0.0


@dataclass
class Life:
    """One print's life by its seed."""

    seed: int
    events: int = 0
    attempts: int = 0
    tries: int = 0
    stopped: bool = False
    reset_in: LinkState | None = None
    status: Status | None = None
    log: list[str] = field(default_factory=list)
    sent: list[bytes] = field(default_factory=list)
    asked: dict[int, tuple[int, list[bytes]]] = field(default_factory=dict)
    """Inserts that were asked for: behind how many lines of the job, which; by look."""
    confirmed: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        rng = self.rng = np.random.default_rng(self.seed)
        self.faults = {one for one in FAULTS if rng.random() < (0.1 if one == "full" else 0.3)}
        if rng.random() < 0.1:  # an answer too many may stand for a line that was lost
            self.faults = {"doubled", "lost"}
        self.requests = [one for one in REQUESTS if rng.random() < 0.4]
        self.lines, self.job = job_of(int(rng.integers(1, 4)), int(rng.integers(3, 9)))
        looks = MarkKind.LAYER if rng.random() < 0.3 else None
        checkpoint_s = 0.0 if rng.random() < 0.3 else None
        self.care = Care(
            checkpoint_s=checkpoint_s,
            look_after=looks,
            look_limit_s=40.0,
            noise_limit=int(rng.choice([4, 30])),
        )
        in_flight = int(rng.integers(1, 3))
        self.profile = PRINTER.model_copy(update={"lines_in_flight": in_flight})
        self.printer, self.journal = ScriptedPrinter(rng), MemoryJournal()
        self.wire = RandomWire(rng, self.faults)
        if "full" in self.faults:
            self.journal.full_at = float(rng.integers(10, 80))
            self.journal.reserve = 60 * int(rng.random() < 0.8)

    def live(self) -> Life:
        """Print, go on where that is possible, and check after each process's end."""
        again = False
        while self.attempts < MOST_ATTEMPTS:
            self.attempts += 1
            bench = Bench(
                self.job,
                self.printer,
                self.care,
                self.journal,
                self.wire,
                self.profile,
                resume=again,
            )
            self._plan(bench)
            try:
                self.status = bench.run()
                self.log.append(f"{self.status.state}: {self.status.message}")
            except HostDiedError:
                self.status = None
                self.log.append("host died")
            finally:
                self.events += bench.events
            self._check(bench)
            if not self._resumable(bench):
                break
            again = True
            self.printer.mute = False
            self.printer.said(self.printer.now + float(self.rng.choice([0.01, 1.0, 60.0])))
        return self

    def _resumable(self, bench: Bench) -> bool:
        """Ask the product; check its word by what was sent and told."""
        self.sent += bench.sent
        self.stopped |= LinkState.STOPPING in {*bench.states, bench.streamer.status.state}
        ended = self.status is not None and (
            self.status.state is not LinkState.FAILED or self.status.position_known
        )
        begun = any(line in self.printer.taken for line in motion(self.lines))
        lost, scarce = self.journal.lost, not self.journal.reserve
        with TemporaryDirectory() as name:
            folder = Path(name)
            (folder / JOURNAL).write_bytes(b"".join(map(encode, self.journal.records)))
            (folder / RESERVE).write_bytes(bytes(self.journal.reserve))
            refused = ""
            try:
                resumable(folder, self.job.sha256)
            except Refused as exc:
                refused = str(exc)
        if refused:
            over = ended or self.stopped or lost or scarce
            assert over or not begun, self._report("can't be gone on with", refused)
            return False
        over = ended or lost or any(b"M140 S0" in data for data in self.sent)
        assert not over, self._report("can be gone on with", ended, lost)
        return True

    # --- what happens to it ------------------------------------------------------------------

    def _plan(self, bench: Bench) -> None:
        rng = self.rng
        for request in self.requests:
            for _ in range(int(rng.integers(1, 3))):
                chance = 0.3 if request == "stop" else 1.0
                if rng.random() < chance:
                    bench.at(self._moment(bench), lambda s, do=request: self._request(s, do))
        if "mute" in self.faults and rng.random() < 0.5:
            bench.at(self._moment(bench), lambda _: self._mute(bench))
        if "reset" in self.faults and rng.random() < 0.15:
            silently = rng.random() < 0.5
            bench.at(self._moment(bench), lambda _: self._reset(bench, silently))
        if "port" in self.faults and rng.random() < 0.4:
            bench.lost_at = int(rng.integers(20, 250))
        if "dies" in self.faults and rng.random() < 0.6:
            bench.dies_at = int(rng.integers(1, 250))
            if rng.random() < 0.5:  # where the link moves the needle, or counts a syringe
                bench.dies_at = math.inf
                state = LinkState.RESUMING if rng.random() < 0.5 else LinkState.PAUSING
                bench.when(state, lambda _: self._doom(bench))
        bench.when(LinkState.PAUSED, *[lambda s: self._held(bench, s)] * 50)
        bench.when(LinkState.LOOKING, *[lambda s: self._looked(bench, s)] * 50)

    def _doom(self, bench: Bench) -> None:
        bench.dies_at = bench.effects + int(self.rng.integers(1, 40))

    def _moment(self, bench: Bench) -> float:
        return bench.exchange.now_s + float(self.rng.uniform(0.0, 12.0))

    def _reset(self, bench: Bench, silently: bool) -> None:
        at = bench.streamer.status.state
        self.log.append(f"reset{' silently' * silently} in {at}")
        self.reset_in = at
        self.printer.reset_now(silently)

    def _mute(self, bench: Bench) -> None:
        self.printer.mute = True
        seconds = float(self.rng.choice([0.5, 3.0, 10.0, 45.0, 200.0]))
        bench.after(seconds, lambda _: setattr(self.printer, "mute", False))

    def _request(self, streamer: Streamer, do: str) -> None:
        self.log.append(f"{do} in {streamer.status.state}")
        try:
            if do == "pause after":
                streamer.pause(MarkKind.LAYER)
            elif do == "typed":
                streamer.typed("M105", lambda lines: None, lambda why: None)
            elif do == "resume":
                streamer.resume(unchanged=streamer.print.change.going_on)
            else:
                getattr(streamer, do)()
        except Refused as exc:
            self.log.append(f"refused: {exc}")

    def _held(self, bench: Bench, streamer: Streamer) -> None:
        """Resume a pause after a while, with a syringe where one is changed."""

        def go_on(streamer: Streamer) -> None:
            changing = streamer.print.change.going_on
            syringe = NewSyringe() if changing and self.rng.random() < 0.7 else None
            try:
                unchanged = changing and syringe is None
                streamer.resume(syringe, unchanged, unobserved=bool(self.rng.random() < 0.3))
            except Refused as exc:
                self.log.append(f"refused: {exc}")
            self.tries += 1  # it may not have been granted, where the place isn't the job's
            bench.after(50.0, go_on if self.tries < MOST_TRIES else Streamer.stop)

        bench.after(float(self.rng.choice([0.0, 0.3, 25.0])), go_on)

    def _looked(self, bench: Bench, streamer: Streamer) -> None:
        rng, look = self.rng, streamer.status.look
        if look is None or rng.random() < 0.1:
            return
        number, done = look["number"], streamer.status.lines_done
        choices = [LookDecision.GO_ON] * 8 + [LookDecision.PAUSE, LookDecision.STOP]
        decision = choices[int(rng.integers(len(choices)))]
        told = self.log.append
        lines: tuple[str, ...] = ()
        if rng.random() < 0.4 and number not in streamer.print.book.inserts:
            lines = tuple(patch_at(b"\n".join(self._grown()), done, number))
            self.asked[number] = done, lines_of("\n".join(lines).encode())

        def decide(streamer: Streamer) -> None:
            def answered(answer: Any) -> None:
                told(f"look {number}: {answer}")

            def taken(answer: Any) -> None:
                self.confirmed.add(number)
                answered(answer)

            if lines:
                streamer.look(LookRequest(number, taken, answered, "a gap", lines=lines))
            streamer.look(LookRequest(number, answered, answered, "seen", decision=decision))

        bench.after(float(rng.choice([0.0, 1.0, 45.0])), lambda s: _unless_ended(s, decide))

    # --- the oracle --------------------------------------------------------------------------

    def _grown(self) -> list[bytes]:
        """The file's commands with what was asked for in looks, where the journal has it."""
        lines = list(self.lines)
        for record in self.journal.recorded("insert"):
            after, inserted = self.asked[record["look"]]
            lines[after:after] = inserted
        return lines

    def _check(self, bench: Bench) -> None:
        history = self.journal.history()
        inserted = {record["look"] for record in self.journal.recorded("insert")}
        assert self.confirmed <= inserted, self._report("insert lost", inserted)
        grown = self._grown()
        expected, made = expected_of(tuple(grown)), made_of(self.printer, grown)
        status = self.status
        exact = not self.printer.fragments
        if not exact and status is not None and status.position_known:
            # a line whose number was cut off: an alarm names it
            alarms = [one for one in self.journal.records if one["t"] in ("alarm", "repeated")]
            named = re.findall(r"\d+", " ".join(a["text"] for a in alarms if "twice" in a["text"]))
            number = self.job.grown_by(history.inserts) if history.inserts else self.job
            twice = {one for one in self.printer.fragments if one.encode() in grown}
            lines = {str(number.file_line(grown.index(one.encode()) + 1)) for one in twice}
            assert lines <= set(named), self._report("made twice without a word", lines, named)
            exact = not lines
        if exact:
            assert made == expected[: len(made)], self._report("lost or doubled", made, expected)
        if status is None:
            return
        own = set(motion(grown))
        taken = [line for line in self.printer.taken if line in own]
        claims = (_moves(grown, status.lines_executed), _moves(grown, status.lines_done))
        assert claims[0] <= len(made), self._report("made less than reported", claims, len(made))
        assert claims[1] <= len(taken), self._report("took less", claims, len(taken))
        if status.state is LinkState.DONE:
            assert len(made) == len(expected) or not exact, self._report(
                "done and not made", made, expected
            )
        if made and self.reset_in not in (None, *EARLY, LinkState.STOPPING):
            assert not status.position_known, self._report("the place was lost")
        stood = history.stood
        if status.state is LinkState.STOPPED and status.position_known and made:
            height = self.printer.place["Z"]
            assert height >= LIFTED_MM, self._report("the needle isn't up", height)
        if stood is not None and stood["certain"] and status.position_known:
            told, at = _moves(grown, stood["line"]), stood["begin_at"]
            if told == len(made) - 1 and at is not None:  # at its end, within M114's decimals
                end = made[-1][2]
                told += all(abs(at[axis.lower()] - end[axis]) < ROUNDED_MM for axis in "XYZE")
            assert told == len(made), self._report("stood elsewhere", stood, len(made))

    def _report(self, what: str, *values: Any) -> str:
        facts = [f"seed {self.seed}: {what}", f"faults {sorted(self.faults)}", *self.log]
        return "\n".join([*facts, *map(str, values)])


def _unless_ended(streamer: Streamer, act: Any) -> None:
    with contextlib.suppress(Refused):
        act(streamer)


def _moves(lines: list[bytes], done: int) -> int:
    return sum(map(moves, lines[:done]))


def live_through(events: int, seed: int) -> list[Life]:
    """Live lives until so many events have happened."""
    lives, left = list[Life](), float(events)
    while left > 0 and left < math.inf:
        lives.append(Life(seed + len(lives)).live())
        left -= lives[-1].events
    return lives
