"""Scripted observer: what a client says in each look of a print on the simulated Marlin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_profiles import Printer
from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.job.job import Insert
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import PRINTER, strokes, wired

EVERY_LAYER = Care(checkpoint_s=None, look_after=MarkKind.LAYER)


def patch(data: bytes, layer: int) -> list[str]:
    """Lines that write a short stroke beside the end of a layer of `layered`, and come back."""
    job = parse_job(data, "a")
    mark = next(one for one in job.marks.of(MarkKind.LAYER) if one.number == layer)
    return patch_at(data, mark.index, layer)


def patch_at(data: bytes, done: int, layer: int = 0) -> list[str]:
    """The same behind so many command lines."""
    at = at_end(parse_job(data, "a").lines, done)
    x, y, z, e, f = at["X"], at["Y"], at["Z"], at["E"], at["F"]
    return [
        f"G1 Z{z + 0.5:.3f} F300",
        f"G1 X51.5 Y{50.25 + layer:.3f} F3000 ; beside it",
        f"G1 Z{z - 0.1:.3f} F300",
        f"G1 E{e + 0.25:.5f} F60",
        f"G1 X52.5 E{e + 0.26:.5f} F600",
        f"G1 E{e + 0.01:.5f} F60",
        f"G1 Z{z + 0.5:.3f} F300",
        f"G1 X{x:g} Y{y:g} F3000",
        f"G1 Z{z:g} F300",
        f"G92 E{e:.5f}",
        f"G1 F{f:g}",
    ]


def at_end(lines: Sequence[bytes], done: int) -> dict[str, float]:
    """Place, plunger and feed after so many lines, read word by word."""
    found = dict.fromkeys("XYZEF", 0.0)
    for line in lines[:done]:
        if line.startswith((b"G0 ", b"G1 ", b"G92 ")):
            found |= {w[0]: float(w[1:]) for w in line.decode().split()[1:] if w[0] in found}
    return found


@dataclass
class Observer:
    """Says in each look what ``says`` has for its number: an insert's lines, then go on."""

    says: dict[int, list[str]] = field(default_factory=dict)
    decides: Callable[[int], LookDecision | None] = lambda number: LookDecision.GO_ON
    answers: list[dict[str, Any]] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    seen: list[Status] = field(default_factory=list)
    streamer: Streamer | None = None
    resumes: bool = True
    seen_by: Callable[[Status], None] = lambda status: None
    flows: dict[int, float] = field(default_factory=dict)
    fails: tuple[int, ...] = ()
    looks_behind: tuple[int, ...] = ()
    unobserved: bool = False

    def status(self, status: Status) -> None:
        self.seen.append(status)
        streamer = self.streamer
        if streamer is None:
            return
        self.seen_by(status)
        if status.state is LinkState.LOOKING and status.look is not None:
            number = status.look["number"]
            if number in self.says or number in self.flows:
                self.insert(number, self.says.get(number, []))
            decision = self.decides(number)
            if decision is not None:
                self.decide(number, decision)
        elif status.state is LinkState.PAUSED and self.resumes:
            streamer.resume(unobserved=self.unobserved)

    def insert(self, number: int, lines: list[str]) -> None:
        assert self.streamer is not None
        self.streamer.look(
            LookRequest(
                number, self.answers.append, self.refusals.append, "a gap", lines=tuple(lines),
                flow=self.flows.get(number), again=number in self.looks_behind,
            )
        )  # fmt: skip

    def decide(self, number: int, decision: LookDecision) -> None:
        assert self.streamer is not None
        self.streamer.look(
            LookRequest(
                number, self.answers.append, self.refusals.append, "looked at", decision,
                again=number in self.fails,
            )
        )  # fmt: skip

    @property
    def states(self) -> list[LinkState]:
        kept = [one.state for one in self.seen]
        return [one for one, last in zip(kept, [None, *kept], strict=False) if one is not last]


@dataclass
class Dying(Observer):
    """Lets the host die in the ``last``-th write after the print begins to leave for a look."""

    transport: SimTransport | None = None
    last: int = 0
    part: float = 1.0

    def status(self, status: Status) -> None:
        if status.state is LinkState.PAUSING and self.transport is not None and self.last:
            self.transport.die_at(self.last, self.part)
            self.last = 0
        super().status(status)


def observed(
    data: bytes,
    folder: Path,
    transport: SimTransport | ScriptedTransport,
    observer: Observer,
    care: Care = EVERY_LAYER,
    resume: bool = False,
    firmware: str = "marlin",
    printer: Printer = PRINTER,
) -> Status:
    """Print with looks; with ``resume`` as a host does whose forerunner died."""
    history = read_journal(folder / "journal.log") if resume else None
    job = parse_job(data, "test.gcode", printer)
    if history is not None:
        job = job.grown_by(history.inserts)
    protocol = made_protocol(firmware)
    observer.streamer = wired(
        transport, folder, job, printer, care, protocol=protocol, on_status=observer.status
    )
    return observer.streamer.run(history)


def grown_file(data: bytes, inserts: Sequence[Insert]) -> bytes:
    """The file as if the inserts had been in it from the start."""
    lines = parse_job(data, "a").lines
    for one in inserts:
        lines[one.after : one.after] = one.lines
    return b"\n".join(lines) + b"\n"


def own_strokes(motion: ExecutedMotion) -> list[tuple[float, ...]]:
    """Ends of the moves across, with the plunger's push: the link's own go up and down alone."""
    return [(*row[4:7], round(row[7], 6)) for row in strokes(motion).tolist()]


__all__ = ["EVERY_LAYER", "LinkState", "Observer", "layered", "observed", "patch"]


def written(motion, park):
    """Strokes across, but for the way to the parking place and back."""
    return [one for one in own_strokes(motion) if park is None or one[3] or one[2] < 12]
