"""Looks and inserts through kill -9: every stroke of the grown job once, in order.

A link process prints to the simulated printer, both real processes, and is held for a look at the
end of each layer. A scripted observer, in this process, inserts a stroke in every second look,
corrects the flow of the rest in every fourth, and then has the print go on. The link process is
killed by SIGKILL about these words, at a random moment up to 0.15 s behind one of: the print is
held, the insert was sent (not answered), it was answered, the decision was sent, it was answered,
lines behind it were taken. Then the print is gone on with. What the motors did is compared with the
file and the inserts as this program knows them (`benchmarks.checkers.grown_strokes`), which reads
no journal.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.checkers.grown_strokes import Compared, compared
from benchmarks.common import Row, row, scratch
from benchmarks.link.printers import profile, simulated
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care
from printctl.machine.job.marks import MarkKind
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import resume_print, start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState

START = (50.0, 50.0, 10.0)
LAYERS, MOVES, KILLS = 8, 12, 10
MOMENTS = ("held", "insert sent", "inserted", "decision sent", "decided", "behind it")
LATEST_S = 0.15


@dataclass(frozen=True)
class Layered:
    """A file of layers, and the place at each one's end."""

    commands: list[str]
    text: str
    ends: list[tuple[int, dict[str, float]]]


def layered(rng: np.random.Generator) -> Layered:
    """Random strokes in steps of 0.05 mm, in layers that end relieved, lifted and marked."""
    commands = ["G21", "G90", "M82", "M302 P1", "G92 X50 Y50 Z10 E0"]
    text, ends, e = "\n".join(commands) + "\n", [], 0.0
    for layer in range(LAYERS):
        new, z = [f"G1 E{e:.5f} F60"], 10.0 + 0.25 * layer
        x = y = 50.0
        for _ in range(MOVES):
            x, y = (50 + 0.05 * int(v) for v in rng.integers(0, 160, 2))
            e += 0.01
            new.append(f"G1 X{x:.2f} Y{y:.2f} E{e:.5f} F1800")
        new += [f"G1 E{e - 0.2:.5f} F60", f"G0 Z{z + 0.25:.2f} F300"]
        commands += new
        text += "\n".join(new) + f"\n;LAYER_END:{layer}\n"
        ends.append((len(commands), {"X": x, "Y": y, "Z": z + 0.25, "E": e - 0.2}))
    return Layered([*commands, "M400"], text + "M400\n", ends)


def mend(at: dict[str, float], rng: np.random.Generator) -> list[str]:
    """A stroke within the file's own space, and back to ``at``.

    Marlin joins a move of less than six steps to the next one, so the way back is longer.
    """
    (x, y), (to_x, to_y) = 52 + 0.05 * rng.integers(0, 80, (2, 2))
    while math.hypot(to_x + 0.05 - at["X"], to_y - at["Y"]) < 0.2:
        to_x, to_y = 52 + 0.05 * rng.integers(0, 80, 2)
    z, e = at["Z"], at["E"]
    return [
        f"G1 Z{z + 1:.2f} F300",
        f"G1 X{x:.2f} Y{y:.2f} F3000",
        f"G1 Z{z - 0.25:.2f} F300",
        f"G1 E{e + 0.2:.5f} F60",
        f"G1 X{to_x + 0.05:.2f} Y{to_y:.2f} E{e + 0.21:.5f} F600",
        f"G1 E{e + 0.01:.5f} F60",
        f"G1 Z{z + 1:.2f} F300",
        f"G1 X{at['X']:.2f} Y{at['Y']:.2f} F3000",
        f"G1 Z{z:.2f} F300",
        f"G92 E{e:.5f}",
        "G1 F300",
    ]


@dataclass
class Counted:
    """The plunger's count by the file, and by what is sent of it."""

    file_e: float = 0.0
    sent_e: float = 0.0

    def scaled(self, command: str, factor: float) -> str:
        """A command of the file with its dose, if it goes across, times ``factor``."""
        e = _e_of(command)
        if e is None:
            return command
        if command.startswith("G92"):
            self.file_e = self.sent_e = e
            return command
        writes = e > self.file_e and " X" in command
        self.sent_e += (e - self.file_e) * (factor if writes else 1.0)
        self.file_e = e
        words = command.split()
        return " ".join(f"E{self.sent_e:.5f}" if one[0] == "E" else one for one in words)


def _e_of(command: str) -> float | None:
    words = [one for one in command.split()[1:] if one[0] == "E"]
    return float(words[0][1:]) if words else None


@dataclass
class Run:
    """One print, its observer and its killer."""

    file: Layered
    folder: Path
    port: str
    printer: str
    rng: np.random.Generator
    kills: int
    mends: dict[int, list[str]] = field(default_factory=dict)
    flows: dict[int, float] = field(default_factory=dict)
    killed: dict[str, int] = field(default_factory=lambda: dict.fromkeys(MOMENTS, 0))

    def run(self, job: Path) -> LinkState:
        """Print to the end; return how it ended."""
        care = Care(checkpoint_s=None, look_after=MarkKind.LAYER, look_limit_s=60)
        client = start_print(Order(job, self.printer, self.port, self.folder, care=care))
        looks = np.sort(self.rng.integers(1, LAYERS + 1, self.kills))  # some in the same look
        self._ahead = [(int(n), str(self.rng.choice(MOMENTS))) for n in looks]
        while True:
            moment = self._follow(client)
            if moment is None:
                return client.wait(60).state
            time.sleep(float(self.rng.uniform(0, LATEST_S)) if self.rng.random() < 0.7 else 0.0)
            with contextlib.suppress(ProcessLookupError):
                os.kill(client.record.pid, signal.SIGKILL)
                self.killed[moment] += 1
            client.wait(30)
            if client.status.state is not LinkState.INTERRUPTED:
                return client.status.state
            client = resume_print(self.folder, self.port)

    def _dies(self, look: int, moment: str) -> bool:
        dies = (look, moment) in self._ahead
        if dies:
            self._ahead.remove((look, moment))
        return dies

    def _follow(self, client: PrintClient) -> str | None:
        """Say what the observer says; return the moment of a kill, None at the end."""
        behind = 0
        for status in client.events():
            if status.ended:
                return None
            if status.state is not LinkState.LOOKING or status.look is None:
                if behind and self._dies(behind, "behind it"):
                    return "behind it"
                continue
            look = int(status.look["number"])
            if status.look["decision"]:
                continue
            with contextlib.suppress(LinkError):
                moment = self._look(client, look)
                if moment:
                    return moment
            behind = look
        return None

    def _look(self, client: PrintClient, look: int) -> str:
        if self._dies(look, "held"):
            return "held"
        if look % 2 or look % 4 == 2:
            lines, flow = self._insert(look)
            if self._dies(look, "insert sent"):
                said = {"look": look, "lines": lines, "why": "a gap", "flow": flow}
                client.send("insert", **said)
                return "insert sent"
            try:
                client.insert(look, lines, "a gap", flow)
            except Refused:  # a flow at which a short move would push too fast for the drive
                self.flows.pop(look)
            if self._dies(look, "inserted"):
                return "inserted"
        if self._dies(look, "decision sent"):
            client.send("look_done", look=look, decision="go_on", why="")
            return "decision sent"
        client.decide(look, LookDecision.GO_ON, "mended")
        return "decided" if self._dies(look, "decided") else ""

    def _insert(self, look: int) -> tuple[list[str], float | None]:
        """What this look inserts, the same each time that it is asked."""
        if look % 2 == 0:
            flow = self.flows.setdefault(look, float(self.rng.choice([0.75, 0.9, 1.2])))
            return [], flow
        if look not in self.mends:
            after, at = self.file.ends[look - 1]
            commands = self.grown()
            behind = self.file.commands[after:]
            told = [_e_of(one) for one in commands[: len(commands) - len(behind)]]
            e = next(value for value in reversed(told) if value is not None)
            self.mends[look] = mend(at | {"E": e}, self.rng)
        return self.mends[look], None

    def grown(self) -> list[str]:
        """The file's commands with what the observer sent, in its own words."""
        begin, commands, factor, count = 0, list[str](), 1.0, Counted()
        for look, (after, _) in enumerate(self.file.ends, 1):
            commands += [count.scaled(one, factor) for one in self.file.commands[begin:after]]
            factor = self.flows.get(look, factor)
            commands += self.mends.get(look, [])
            begin = after
        return commands + [count.scaled(one, factor) for one in self.file.commands[begin:]]


def one_print(seed: int, folder: Path, kills: int) -> tuple[Run, LinkState, Compared]:
    """Print once with kills; compare what the motors did."""
    rng = np.random.default_rng(seed)
    file, place = layered(rng), folder / f"print-{seed}"
    place.mkdir()
    job, record = place / "job.gcode", place / "executed.npz"
    job.write_text(file.text)
    words = ("--job", str(job), "--journal", str(place / "link" / "journal.log"))
    quick = profile(folder, "no_reset", resets_on_connect=False)
    with simulated(quick, "--record", str(record), *words) as port:
        run = Run(file, place / "link", port, quick, rng, kills)
        state = run.run(job)
    return run, state, compared(run.grown(), START, ExecutedMotion.load(record))


def rows(quick: bool) -> Iterator[Row]:
    """Yield 200 kills, 20 if quick."""
    kills, total, exact, prints, inserts = (10 if quick else 200), 0, 0, 0, 0
    by_moment, wrong = dict.fromkeys(MOMENTS, 0), []
    with scratch() as folder:
        while total < kills and prints < 5 * kills:
            run, state, found = one_print(prints, folder, min(KILLS, kills - total))
            good = state is LinkState.DONE and found.exact
            exact, prints = exact + good, prints + 1
            total += sum(run.killed.values())
            inserts += len(run.mends) + len(run.flows)
            for moment, count in run.killed.items():
                by_moment[moment] += count
            if not good:
                wrong.append({"seed": prints - 1, "state": state.value, **vars(found)})
    more = {"kills": total, "inserts": inserts, "by_moment": by_moment, "not_exact": wrong}
    name = "prints exact through kills about looks"
    yield row(name, exact, f"of {prints}", "all", not wrong) | more
