"""Pauses, syringe changes and stops in noisy prints, checked against the motors' positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.link_join import Strokes, astray
from benchmarks.checkers.link_order import judge
from benchmarks.link_files import PrintFile, layers
from benchmarks.link_runs import facts, new_printer
from benchmarks.link_wire import BreakingTroubles, Ledger, Wire
from benchmarks.machine import row
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.machine.link import Care, LinkState, NewSyringe, Status
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.job import parse_job
from printctl.machine.link.journal import Journal
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring

Row = dict[str, Any]
VIRTUAL = {"clock": "virtual"}
NOISE = BreakingTroubles(noise=0.0004, drop_ok=0.001, delay=0.001)


@dataclass
class User:
    """Requests something at random whenever there is news, and answers each pause.

    Attributes
    ----------
    rng : Generator
    requests : int
        How many are left.
    pauses, changes : int
        Pauses that were resumed; of them those with a new syringe.
    """

    rng: np.random.Generator
    requests: int
    streamer: Streamer | None = None
    pauses: int = 0
    changes: int = 0

    def hear(self, status: Status) -> None:
        """Be told how the print stands."""
        streamer = self.streamer
        if streamer is None:
            return
        if status.state is LinkState.PAUSED:
            self._answer(streamer)
        elif status.state is LinkState.PRINTING and self.requests and self.rng.random() < 0.05:
            self.requests -= 1
            last = status.lines_done > 0.8 * status.lines_total  # no mark may be ahead
            request = "now" if last else self.rng.choice(["now", "layer", "reload"])
            if request == "now":
                streamer.pause()
            elif request == "layer":
                streamer.pause(MarkKind.LAYER)
            else:
                streamer.reload()

    def _answer(self, streamer: Streamer) -> None:
        self.pauses += 1
        if streamer.status.waits_for != "syringe":
            streamer.resume()
            return
        self.changes += 1
        back = float(self.rng.uniform(-30.0, -5.0))  # the empty one is drawn back and taken off,
        streamer.command(b"G1 E%.3f F600" % back, lambda lines: None)
        primed = b"G1 E%.3f F60" % (back + 1.0)  # a new one put in and primed
        streamer.command(primed, lambda lines: streamer.resume(NewSyringe(1.0)))


@dataclass
class Print:
    """One print of a file with a user beside it.

    Attributes
    ----------
    ledger : Ledger
    clock : VirtualClock
    streamer : Streamer
    """

    file: PrintFile
    folder: Path
    seed: int
    on_status: Callable[[Status], None]
    troubles: BreakingTroubles = field(default_factory=BreakingTroubles)

    def __post_init__(self) -> None:
        self.ledger: Ledger = new_printer()
        self.clock = VirtualClock()
        path = self.folder / f"pauses-{self.seed}.log"
        path.unlink(missing_ok=True)
        rng = np.random.default_rng(self.seed)
        wire = Wire(self.ledger, self.clock, rng, self.troubles)
        wiring = Wiring(
            wire, MarlinProtocol(), self.clock, Journal(path), facts(), on_status=self.on_status
        )
        job = parse_job(self.file.data, "bench.gcode", facts())
        self.streamer = Streamer(wiring, job, Care(checkpoint_s=10.0))

    def run(self) -> Status:
        """Print, and let the motors end what they hold."""
        status = self.streamer.run()
        self.streamer.wiring.journal.close()
        self.ledger.printer.finish()
        return status


def pause_rows(seeds: int, folder: Path) -> Iterator[Row]:
    """Noisy prints that are paused and get new syringes at random join where they were left."""
    file = layers(12, 60)
    beside = slipped = pauses = changes = done = 0
    for seed in range(seeds):
        user = User(np.random.default_rng(1000 + seed), requests=8)
        made = Print(file, folder, seed, user.hear, NOISE)
        user.streamer = made.streamer
        status = made.run()
        order = judge(file.lines, made.ledger.taken)
        done += status.state is LinkState.DONE
        slipped += order.slipped
        found = astray(Strokes.of(file.ends), made.ledger.printer.executed(), order.unfinished)
        beside += max(found - order.slipped, 0)
        pauses, changes = pauses + user.pauses, changes + user.changes
    about = VIRTUAL | {"prints": seeds, "done": done, "pauses": pauses, "changes": changes}
    measure = "noisy prints paused and given new syringes: strokes begun, ended or dosed elsewhere"
    made_row = row(measure, beside, "", "0 beyond slipped lines", not beside)
    yield made_row | about | {"slipped lines": slipped, "troubles": NOISE.model_dump()}


def stop_rows(tries: int, folder: Path) -> Iterator[Row]:
    """How long a controlled stop takes, the planner being full of short moves."""
    file = layers(2, 600)
    relieved, lifted, over = [], [], []
    for seed in range(tries):
        at = 100 + int(np.random.default_rng(seed).integers(0, 800))
        asked: list[float] = []

        def hear(status: Status) -> None:
            if status.lines_done >= at and not asked:  # noqa: B023
                asked.append(made.clock.now())  # noqa: B023
                made.streamer.stop()  # noqa: B023

        made = Print(file, folder, seed, hear)
        status = made.run()
        if status.state is not LinkState.STOPPED or not asked:
            raise ValueError(f"the stop ended as {status}")
        motion = made.ledger.printer.executed()
        relieved.append(float(motion.time_end[-2]) - asked[0])
        lifted.append(float(motion.time_end[-1]) - asked[0])
        over.append(made.clock.now() - asked[0])
    about = VIRTUAL | {"tries": tries, "in the planner": "up to 16 moves of 0.12 s"}
    for what, times in (("plunger relieved", relieved), ("needle lifted 20 mm", lifted)):
        measure = f"controlled stop, planner full: {what} after, median"
        yield row(measure, round(float(np.median(times)), 2), "s") | about | {"most": max(times)}
    late = max(a - b for a, b in zip(over, lifted, strict=True))
    yield row("controlled stop: known after the last move, most", round(late, 3), "s") | about
