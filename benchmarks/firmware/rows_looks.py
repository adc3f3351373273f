"""Benchmark rows: prints on a real Marlin that are held for looks and mended, and disturbed."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.common import Row, limited
from benchmarks.firmware.board import AvrBoard
from benchmarks.firmware.files import Followed, LayeredFile, follow, way_points
from benchmarks.firmware.product import environment, stand_still
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import LinkError
from printctl.machine.job.care import Care
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import resume_print, start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState

LIFT_MM = 3.0
HELD_S = 0.5
LATE_MS = 5000
NOISE = 0.003


@dataclass
class Held:
    """One print that is held for looks.

    ``watched``: when the motors must have stood, `time.monotonic_ns`; ``disturbed``: looks at which
    something has happened already.
    """

    board: AvrBoard
    file: LayeredFile
    client: PrintClient
    watched: list[tuple[int, int]] = field(default_factory=list)
    disturbed: set[int] = field(default_factory=set)

    def watch(self) -> None:
        """Let the needle be held for a while."""
        begin = time.monotonic_ns()
        time.sleep(HELD_S)
        self.watched.append((begin, time.monotonic_ns()))

    def first(self, look: int) -> bool:
        """Whether nothing has happened at this look yet."""
        new = look not in self.disturbed
        self.disturbed.add(look)
        return new

    def kill(self) -> None:
        """Kill the link with signal 9."""
        with suppress(ProcessLookupError):
            os.kill(self.client.record.pid, signal.SIGKILL)

    def mend(self, look: int) -> None:
        """Insert a stroke, and have the print go on."""
        self.client.insert(look, self.file.mend(look), "a gap")
        self.client.decide(look, LookDecision.GO_ON, "mended")

    def until_across(self) -> None:
        """Wait until the insert moves across."""
        begin, until = self.board.positions()["X"], time.monotonic() + 60
        while self.board.positions()["X"] == begin and time.monotonic() < until:
            time.sleep(0.02)


def mended(held: Held, look: int) -> None:
    """Mend, and nothing else."""
    held.mend(look)


def killed_in_look(held: Held, look: int) -> None:
    """Kill the link once the insert is answered, before a decision."""
    if held.first(look):
        held.client.insert(look, held.file.mend(look), "a gap")
        held.kill()
    else:
        held.mend(look)


def killed_in_insert(held: Held, look: int) -> None:
    """Kill the link while the motors make the insert."""
    held.mend(look)
    if held.first(look):
        held.until_across()
        held.kill()


def late(held: Held, look: int) -> None:
    """Hold back all that the board says, from the decision on."""
    held.board.tell(f"hold {LATE_MS}")
    held.mend(look)


def noisy(held: Held, look: int) -> None:
    """Garble bytes from the first look on, and lose oks."""
    held.board.tell(f"noise both {NOISE} {10 * held.file.seed + look}")
    held.board.tell("lostok 0.03")
    held.mend(look)


def renamed(held: Held, look: int) -> None:
    """Have another program rename the plunger's place."""
    if look == 2:
        other = os.open(held.board.port, os.O_WRONLY | os.O_NOCTTY)
        os.write(other, b"G92 E7\n")
        os.close(other)
        time.sleep(1.0)
    held.client.decide(look, LookDecision.GO_ON, "")


def stopped(held: Held, look: int) -> None:
    """Stop while the motors make the insert."""
    held.mend(look)
    if look == 2:
        held.until_across()
        held.client.stop()


EVENTS: dict[str, tuple[Callable[[Held, int], None], LinkState]] = {
    "a mend at each look": (mended, LinkState.DONE),
    "kill -9 of the link in a look": (killed_in_look, LinkState.DONE),
    "kill -9 of the link in an insert": (killed_in_insert, LinkState.DONE),
    "answers 5 s late at the insert": (late, LinkState.DONE),
    "0.3 % of bytes garbled from the look on": (noisy, LinkState.DONE),
    "another program's G92 E in a look": (renamed, LinkState.POSITION_UNKNOWN),
    "a stop in an insert": (stopped, LinkState.STOPPED),
}
"""What happens, and how the print must end."""


def see_to_the_end(held: Held, link: Path, happens: Callable[[Held, int], None]) -> LinkState:
    """Look, go on after pauses and with a dead link's print; return how it ended."""
    while True:
        for status in held.client.events():
            look = status.look
            if status.state is LinkState.PAUSED:
                with suppress(LinkError):  # it goes on already
                    held.client.resume()
            if status.state is LinkState.LOOKING and look is not None and not look["decision"]:
                held.watch()
                happens(held, int(look["number"]))
        if held.client.wait(60).state is not LinkState.INTERRUPTED:
            return held.client.wait(60).state
        held.client = resume_print(link, str(held.board.port))


def one(image: Path, folder: Path, seed: int, event: str) -> tuple[LinkState, Followed, int]:
    """Print; return how it ended, how far the motors follow, and edges while it was held."""
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.update(environment(folder))  # the link's process isn't the user's
    file, link, job = LayeredFile(seed), folder / f"{seed}.print", folder / f"{seed}.gcode"
    job.write_text(file.text())
    care = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=60)
    with AvrBoard(image, folder / f"board-{seed}") as board:
        client = start_print(
            Order(
                job,
                "marlin_avr",
                str(board.port),
                link,
                retreat=Retreat(lift_mm=LIFT_MM),
                care=care,
            )
        )
        held = Held(board, file, client)
        state = see_to_the_end(held, link, EVENTS[event][0])
        stand_still(board)
        log = board.log()
    ns = log.steps()["ns"]
    moved = sum(int(((ns > begin) & (ns < end)).sum()) for begin, end in held.watched)
    found = follow(log, way_points(file.grown()))
    return state, found, moved


def look_rows(image: Path, folder: Path, runs: int) -> Iterator[Row]:
    """Measure each event in so many prints."""
    for event, (happens, wanted) in EVENTS.items():
        found = [one(image, folder / happens.__name__, seed, event) for seed in range(runs)]
        name = f"real Marlin, {runs} prints held for looks, {event}: "
        others = sum(state is not wanted for state, _, _ in found)
        yield limited(name + f"ended otherwise than {wanted}", others, "prints", 0)
        moved = sum(moved for _, _, moved in found)
        yield limited(name + "edges while the needle was held", moved, "edges", 0)
        if wanted is LinkState.DONE:
            wrong = sum(not followed.exact for _, followed, _ in found)
            name += "a move of file or insert lost, doubled or beside"
            yield limited(name, wrong, "prints", 0)
