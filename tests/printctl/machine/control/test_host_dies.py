"""Prints whose host dies in any effect, twice, or loses the port, and that are gone on with.

As kill -9 at any write of the port, any record and any word to a client.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest

from printctl.machine.control.look_book import LookDecision
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import (
    CALM,
    ENDS,
    JOB,
    LOOKS,
    RELOADS,
    SHORT,
    Bench,
    HostDiedError,
    assert_crosses_high,
    assert_exact,
    die,
    insert,
    layers,
    lines_apart,
    mend,
    observe,
    pause,
    pause_after_layer,
    reload,
)
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter
from tests.printctl.machine.link.jobs import parse_job
from tests.slower import first_rows

PARK = (20.0, 30.0, 40.0)


APART = lines_apart(2, 3)
TRAVELS = [k for k, line in enumerate(APART.lines) if line.startswith(b"G0 X")]
WITHIN = [line.replace("Z10.900", "Z10.000") for line in mend(TRAVELS[2], APART)]

MARKED = layers(2, 8).replace(b";LAYER_END", b";PASS_END").splitlines()
PARTED = parse_job(b"\n".join([*MARKED[:6], b";PART_END:0", *MARKED[6:]]) + b"\n", "bench.gcode")
INSIDE = [line.replace("Z9.900", "Z10") for line in mend(6, PARTED)]


class WithoutParser(ScriptedPrinter):
    """Its profile says that it has one."""

    def _reply(self, word: str, command: str) -> str:
        said = super()._reply(word, command)
        return said.replace("PARSER:1", "PARSER:0") if word == "M115" else said


def test_firmware_is_halted_by_what_it_has_reported_also_by_a_second_host():
    first = Bench(JOB, WithoutParser())
    first.on_line(5, die)
    with pytest.raises(HostDiedError):
        first.run()
    assert first.journal.history().capabilities == {"EMERGENCY_PARSER": False}
    second = Bench(JOB, first.printer, journal=first.journal, resume=True)
    assert_exact(second)
    assert not second.streamer.print.channel.kill.halting.first


@dataclass
class Case:
    """A print, what is requested of it, and what must be in its journal in the end."""

    care: Care = CALM
    at: tuple[int, Callable[[Streamer], None]] | None = None
    inserts: dict[int, dict[str, Any]] | None = None
    pauses_in_look: bool = False
    job: Job = JOB
    retreat: Retreat = SHORT
    records: dict[str, int] | None = None

    def bench(self, before: Bench | None = None) -> Bench:
        """A process that prints, or goes on after another, with the same requests."""
        if before is None:
            bench = Bench(self.job, care=self.care, retreat=self.retreat)
            if self.at is not None:
                bench.on_line(*self.at)
        else:
            printer = before.printer
            printer.said(printer.now + 30.0)
            bench = Bench(
                self.job, printer, self.care, before.journal, resume=True, retreat=self.retreat
            )
        bench.when(LinkState.PAUSED, *[lambda streamer: self.held(bench)] * 5)
        if self.pauses_in_look:
            observe(bench, decide=lambda number: LookDecision.PAUSE)
        else:
            observe(bench, self.inserts)
        return bench

    def held(self, bench: Bench) -> None:
        streamer = bench.streamer
        if streamer.print.change.going_on:
            streamer.command(b"G1 E-2 F60", lambda said: None)
            streamer.command(b"G1 E-1.5 F60", lambda said: streamer.resume(NewSyringe(1.0)))
            return
        look = streamer.status.look
        if look is not None and self.inserts and not bench.journal.history().inserts:
            insert(bench, look["number"], **self.inserts[1])
        streamer.resume()


MENDED = {1: {"lines": mend(ENDS[0])}}
CASES = {
    "nothing": Case(),
    "pause": Case(at=(12, pause)),
    "pause in a layer, primed": Case(
        at=(8, pause_after_layer), retreat=Retreat(lift_mm=4.0, relief_mm=0.3, prime_mm=0.02)
    ),
    "syringe": Case(at=(4, reload), records={"syringe": 1}),
    "planned syringe": Case(replace(CALM, reload_at=(RELOADS[0],)), records={"syringe": 1}),
    "look": Case(LOOKS, records={"looked": 2}),
    "mend": Case(LOOKS, inserts=MENDED, records={"insert": 1, "looked": 2}),
    "mend and flow": Case(
        LOOKS, inserts={1: {"lines": mend(ENDS[0]), "flow": 1.25}}, records={"insert": 1}
    ),
    "look behind the mend": Case(
        LOOKS, inserts={1: {**MENDED[1], "again": True}}, records={"insert": 1, "looked": 3}
    ),
    "parked": Case(replace(LOOKS, look_park_mm=PARK), inserts=MENDED, records={"insert": 1}),
    "look between lines": Case(
        replace(LOOKS, look_every_written_s=0.2),
        inserts={1: {"lines": WITHIN}},
        job=APART,
        records={"insert": 1},
    ),
    "look within a stroke": Case(
        replace(CALM, look_after=MarkKind.VESSEL),
        inserts={1: {"lines": INSIDE}},
        job=PARTED,
        records={"insert": 1, "looked": 3},
    ),
    "mend in a pause of a look": Case(LOOKS, inserts=MENDED, pauses_in_look=True),
}


def begin_of(bench: Bench) -> int:
    """The effect in which the print begins: what is before it is the same in all."""
    found: list[int] = []
    bench.when(LinkState.PRINTING, lambda _: found.append(bench.effects))
    assert_exact(bench)
    return found[0]


def assert_all_made(case: Case, bench: Bench) -> None:
    assert_exact(bench)
    for sort, count in (case.records or {}).items():
        requested = sort != "syringe" or case.at is None or bench.recorded("wanted")
        # one whose command didn't leave is written down again
        places = {one.get("look", one.get("done")) for one in bench.recorded(sort)}
        assert len(places) == (count if requested else 0), sort
    if case.care.look_park_mm:
        assert_crosses_high(bench, case.care.look_park_mm)


def effects(case: Case, first: int = 0, step: int = 1) -> range:
    """Effects of a whole print, from its beginning on."""
    whole = case.bench()
    begin = 1 if case is CASES["nothing"] else begin_of(whole)
    if case is CASES["nothing"]:
        assert_all_made(case, whole)
    return range(begin + first, whole.effects + 1, step)


def died(bench: Bench, effect: int) -> Bench:
    bench.dies_at = effect
    with pytest.raises(HostDiedError):
        bench.run()
    return bench


SHORT_CASES = [name for name, case in CASES.items() if case.care is not LOOKS and case.job is JOB]
EVERY = [(name, 0, 1) for name in SHORT_CASES if "park" not in name]
THIRD = [(name, first, 3) for first in range(3) for name in CASES if (name, 0, 1) not in EVERY]


@pytest.mark.parametrize(("name", "first", "step"), [*EVERY, *first_rows(THIRD, len(THIRD) // 3)])
def test_host_that_dies_in_any_effect_is_gone_on_with_exactly(name, first, step):
    case = CASES[name]
    for effect in effects(case, first, step):
        bench = died(case.bench(), effect)
        if bench.journal.history().begun:  # else no line of the job may have left
            assert_all_made(case, case.bench(bench))


@pytest.mark.parametrize("name", ["pause", "syringe", "mend"])
def test_host_that_dies_again_soon_is_gone_on_with_exactly(name):
    case = CASES[name]
    for effect in effects(case, step=2):
        second = case.bench(died(case.bench(), effect))
        second.dies_at = 1 + 7 * effect % 60
        try:
            status = second.run()
        except HostDiedError:
            second, status = case.bench(second), None
        assert_exact(second, status)


@pytest.mark.parametrize("name", ["pause", "syringe", "mend"])
def test_port_that_is_lost_in_any_effect_is_gone_on_with_exactly(name):
    case = CASES[name]
    for effect in effects(case, step=2):
        bench = case.bench()
        bench.lost_at = effect
        status = bench.run()
        if status.state is not LinkState.DONE:  # else no byte left behind it
            assert (status.error, status.position_known) == ("PortLost", False)
            assert_all_made(case, case.bench(bench))
