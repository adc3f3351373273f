"""Prints on the simulated printer over a faulty line in virtual time, gone on with when it breaks.

Every line that the printer takes is written down beside what the host meant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.link_order import Order, Taken, body_of, judge, unreached
from benchmarks.link.files import START_MM, STEPS_PER_MM, PrintFile
from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import PortLost
from printctl.machine.job.job import parse_job
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import PermanentFaults
from tests.printctl.machine.link.simulated_transport import HostDiedError, SimulatedTransport


@dataclass
class Ledger:
    """What the printer took, when it halted, and how often noise made an M112 on its way."""

    printer: MarlinPrinter
    taken: list[Taken] = field(default_factory=list)
    kills: list[float] = field(default_factory=list)
    forged: int = 0
    meant: dict[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        printer: Any = self.printer
        self._accept, self._kill = printer.lines.accept, printer.kill
        printer.lines.accept, printer.kill = self._on_line, self._on_kill

    def sent(self, data: bytes) -> None:
        """The host writes lines."""
        for line in data.split(b"\n"):
            number, text = body_of(line)
            if number is not None:
                self.meant[number] = text.strip()

    def _on_line(self, line: bytes) -> Any:
        verdict = self._accept(line)
        if isinstance(verdict, bytes):
            number, _ = body_of(line)
            meant = None if number is None else self.meant.get(number)
            self.taken.append(Taken(self.printer.now, line, meant))
        return verdict

    def _on_kill(self, reason: str) -> None:
        self.kills.append(self.printer.now)
        self._kill(reason)


class BreakingTroubles(PermanentFaults):
    """With a chance, per line written, that the connection is lost with all that is under way."""

    breaks: float = 0.0


class Wire(SimulatedTransport):
    """Writes down what the host meant; breaks as its troubles say."""

    def __init__(
        self,
        ledger: Ledger,
        clock: VirtualClock,
        rng: np.random.Generator,
        troubles: BreakingTroubles = BreakingTroubles(),  # noqa: B008
    ) -> None:
        super().__init__(ledger.printer, clock, troubles, rng)
        self.ledger = ledger
        self._rng, self._breaks = rng, troubles.breaks
        self._broken = False

    def on_the_way(self, data: bytes) -> bytes:
        """Note what the host sends, and lose its end where the connection breaks."""
        self.ledger.sent(data)
        if self._rng.random() < self._breaks:
            self._broken = True
            data = data[: self._rng.integers(0, len(data) + 1)]
        arrives = super().on_the_way(data)
        self.ledger.forged += b"M112" in arrives and b"M112" not in data
        return arrives

    def _check(self) -> None:
        super()._check()
        if self._broken:
            raise PortLost("the simulated connection broke")


MOST_BREAKS = 200


@dataclass(frozen=True)
class Run:
    """One print, by the status of its end.

    ``unreached``, ``surplus``: ends of moves that the motors never came to in order, and moves
    beyond the file's. ``begun``, ``pauses``, ``again``: how often it was begun or gone on with, and
    paused for noise; lines sent again.
    """

    status: Status
    order: Order
    unreached: int
    surplus: int
    begun: int
    pauses: int
    again: int
    ledger: Ledger

    @property
    def early(self) -> bool:
        """Whether it ended before the file did."""
        return self.status.state is not DONE

    @property
    def slipped(self) -> bool:
        """Whether a line slipped through the checksum: a good reason to end early."""
        return self.order.slipped + self.order.slipped_beside > 0

    @property
    def halted(self) -> bool:
        """Whether the firmware halted itself."""
        return bool(self.ledger.kills)

    @property
    def faults(self) -> int:
        """Lines lost, doubled or swapped, or a print that ended early for no good reason."""
        order = self.order
        return order.lost + order.doubled + order.swapped + (self.early and not self.slipped)


DONE = LinkState.DONE


def facts() -> Printer:
    """The printer of all these runs."""
    return load(Printer, "generic_marlin")


def ends_of(motion: ExecutedMotion) -> NDArray[np.int64]:
    """Where executed moves ended, (n, 4), steps."""
    ends = np.column_stack([motion.end, motion.plunger_end])
    return np.round(ends * STEPS_PER_MM).astype(np.int64)


def new_printer() -> Ledger:
    """Make a simulated printer that is watched."""
    return Ledger(MarlinPrinter(facts(), START_MM))


def run(
    file: PrintFile,
    folder: Path,
    seed: int = 0,
    troubles: BreakingTroubles = BreakingTroubles(),  # noqa: B008
    ledger: Ledger | None = None,
    wire: Callable[[Ledger, VirtualClock, int], Wire] | None = None,
    protocol: Callable[[], MarlinProtocol] = MarlinProtocol,
) -> Run:
    """Print a file; whenever the connection breaks, go on from the journal.

    ``wire`` and ``protocol`` make those of each beginning (0, 1, ...).
    """
    rng, clock = np.random.default_rng(seed), VirtualClock()
    ledger = ledger or new_printer()
    job, path = parse_job(file.data, "bench.gcode", facts()), folder / f"journal-{seed}.log"
    path.unlink(missing_ok=True)
    pauses, again, begun = 0, 0, 0
    streamer: Streamer | None = None

    def on_status(status: Status) -> None:
        nonlocal pauses
        if status.state is LinkState.PAUSED and streamer is not None:
            pauses += 1
            streamer.resume()

    while True:
        made = wire(ledger, clock, begun) if wire else Wire(ledger, clock, rng, troubles)
        history = read_journal(path) if begun else None
        if history is not None and not history.begun:
            history = None  # it broke in the handshake: begin anew
        journal = Journal(path)
        wiring = Wiring(made, protocol(), clock, journal, facts(), on_status=on_status)
        streamer = Streamer(wiring, job)
        try:
            status = streamer.run(history)
        except HostDiedError:
            status = None
        journal.close()
        again += streamer.status.line_errors
        begun += 1
        lost = status is None or status.error == "PortLost"
        if not lost or ledger.printer.unplugged or begun > MOST_BREAKS:
            break
    if status is None:
        raise ValueError(f"the host died {begun} times and wasn't started again")
    ledger.printer.finish()  # the planner still holds moves where the host ended first
    missing, surplus = unreached(file.ends, ends_of(ledger.printer.executed()))
    order = judge(file.lines, ledger.taken)
    return Run(status, order, missing, surplus, begun, pauses, again, ledger)
