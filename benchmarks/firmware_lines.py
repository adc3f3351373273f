"""Compare a real Marlin with the simulated one on generated lines.

``python -m benchmarks.firmware_lines --marlin IMAGE --lines 10000``; the image as for
`benchmarks.firmware_bench`. Two passes: *sent* sends what the product's reader renders of each line
(refused lines are left out) and compares motors, simulated printer and dry run; *raw* sends lines
as they were generated, malformed ones too, and compares motors and simulated printer. Differences
are printed by line. The last line is a JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.marlin_plunger import MarlinPlunger
from benchmarks.firmware_bench.avr_board import AvrBoard
from benchmarks.firmware_bench.serial_host import SerialHost
from benchmarks.machine import commit, machine, row
from firmware_profiles import Printer, load
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.errors import LineError
from sim.gcode.dry_run.run import dry_run
from sim.gcode.program.modal import BAD
from sim.gcode.program.read_program import read_written
from sim.gcode.reading import read_line

PRINTER = load(Printer, "marlin_avr")
STEPS = {"X": 80, "Y": 80, "Z": 400, "E": 500}
EVERY = 20
"""Lines between two looks at the motors."""
SETTLED = 1.5
"""Steps that two roundings may be apart."""


class Lines:
    """Lines from a seed; most are lawful, some are odd or malformed.

    Moves are short, so that ten thousand of them take minutes.
    """

    def __init__(self, seed: int, malformed: float) -> None:
        self.rng = np.random.default_rng(seed)
        self.malformed = malformed
        self.relative = False

    def __iter__(self) -> Iterator[str]:
        """Yield lines without end."""
        while True:
            yield self.spelled(self.line())

    def number(self, low: float, high: float) -> str:
        """Return a number, in one of several spellings."""
        value = float(self.rng.uniform(low, high))
        text = f"{value:.{int(self.rng.integers(0, 6))}f}"
        if self.rng.random() < 0.1 and not text.startswith("-"):
            text = "+" + text
        if self.rng.random() < 0.1 and text.startswith("0."):
            text = text[1:]
        return text + ("." if "." not in text and self.rng.random() < 0.1 else "")

    def word(self, axis: str) -> str:
        """Return a letter with a number that fits."""
        span = {"X": (40, 50), "Y": (40, 50), "Z": (0, 0.5), "E": (-0.2, 0.5), "F": (3000, 9000)}
        low, high = (-1, 1) if self.relative and axis in "XYZ" else span[axis]
        return axis + self.number(low, high)

    def line(self) -> list[str]:
        """Return the words of one line."""
        kind = self.rng.random()
        if kind < 0.62:
            axes = [a for a in "XYZEF" if self.rng.random() < 0.4]
            self.rng.shuffle(axes)
            return [str(self.rng.choice(["G0", "G1", "G1", "G01"])), *map(self.word, axes)]
        if kind < 0.78:
            return self.arc()
        if kind < 0.86:
            axes = [a for a in "XYZE" if self.rng.random() < 0.4]
            return ["G92", *(self.word(a) for a in axes)]
        if kind < 0.92:
            self.relative = bool(self.rng.random() < 0.3)
            return ["G91" if self.relative else "G90"]
        codes = ("M82", "M83", "G21", "M400", "G4 P1", "M105", "M117 X50 Y1", "M220 S100", "M114")
        return str(self.rng.choice(codes)).split()

    def arc(self) -> list[str]:
        """Return the words of an arc, or of what is nearly one."""
        words = [str(self.rng.choice(["G2", "G3"])), self.word("X"), self.word("Y")]
        if self.rng.random() < 0.4:  # a sound one, by radius: the chord is short of it
            words += [f"R{self.number(15, 30)}"]
            return words + [self.word(a) for a in "ZEF" if self.rng.random() < 0.3]
        ways = (["I", "J"], ["I"], ["J"], ["R"], [], ["R", "I"], ["I", "J", "P"])
        for letter in ways[int(self.rng.choice(7, p=(0.45, 0.1, 0.1, 0.2, 0.05, 0.05, 0.05)))]:
            span = (5, 15) if letter == "R" else (-3, 3)
            words.append(f"{letter}{1 if letter == 'P' else self.number(*span)}")
        return words + [self.word(a) for a in "ZEF" if self.rng.random() < 0.3]

    def spelled(self, words: list[str]) -> str:
        """Return a line with blanks, case and remarks of all sorts."""
        chance = self.rng.random
        if chance() < self.malformed:
            words = self.spoiled(words)
        blanks = ("", " ", " ", "  ")
        text = "".join(str(self.rng.choice(blanks)) + word for word in words).strip()
        if chance() < 0.1:
            text = text.replace("X", "X ").replace("G", "G ")
        if chance() < 0.1:
            text = "  " + text
        if chance() < 0.1:
            text += " ; a remark G1 X5"
        return text.lower() if chance() < 0.05 else text

    def spoiled(self, words: list[str]) -> list[str]:
        """Return the words with one that is malformed."""
        junk = "X--5|X1.2.3|Xnan|Xinf|X|Y5mm|X30e1|Q7|A-3|X40 X50|Y+-3|X30 40|Y.|Z-|E1E|X4,5|"
        junk += "	Y44|X33	Z1|(Y22)|I3|F0|F-5"
        at = int(self.rng.integers(1, len(words) + 1))
        return [*words[:at], str(self.rng.choice(junk.split("|"))), *words[at:]]


def numbered(text: str, number: int) -> str:
    """The line with number and checksum."""
    body = f"N{number} {text.split(';')[0].rstrip()}".encode()
    return f"{body.decode()}*{reduce(xor, body, 0)}"


class Both:
    """A real board and a simulated one, told the same."""

    def __init__(self, image: Path, folder: Path) -> None:
        self.board = AvrBoard(image, folder, 0.0).__enter__()
        self.host = SerialHost(self.board.port)
        time.sleep(1.5)
        self.twin = MarlinPrinter(PRINTER, (0.0, 0.0, 0.0))
        for text in ("M302 P1", "G92 X0 Y0 Z0 E0", "M204 S3000", "M201 X3000 Y3000 Z3000 E3000"):
            self.tell(text)

    def tell(self, text: str) -> tuple[list[str], list[str]]:
        """Send a line to both; what each says."""
        said = self.host.ask(text, 300)
        twin = self.twin.exchange(text.encode() + b"\n").decode("latin-1").splitlines()
        return said, twin

    def steps(self) -> tuple[dict[str, int], dict[str, int]]:
        """Motors' steps of both, at rest."""
        self.tell("M400")
        self.twin.finish()
        counts = [int(count) for count in self.twin.machine.motion.planner["position"][0]]
        pushed = self.twin.executed().plunger_end
        counts[3] = round(float(pushed[-1]) * STEPS["E"]) if len(pushed) else 0
        return self.board.positions(), dict(zip("XYZE", counts, strict=True))

    def close(self) -> None:
        """Stop the board."""
        self.host.close()
        self.board.__exit__(None, None, None)


def dry_run_steps(lines: list[str]) -> list[dict[str, int]]:
    """Return by line the steps of all axes after it, as the dry run's planner makes them."""
    run = dry_run("\n".join(lines).encode(), PRINTER, cold_extrusion=True)
    made = np.column_stack([run.executed.end, run.executed.plunger_end]) * list(STEPS.values())
    counts = np.vstack([np.zeros(4), made]).round().astype(int)
    command = run.program.command[np.searchsorted(run.program.line, range(1, len(lines) + 1))]
    rows = np.searchsorted(run.executed.line, command, side="right")
    return [dict(zip("XYZE", counts[at].tolist(), strict=True)) for at in rows]


def compare(
    both: Both,
    lines: list[str],
    note: list[str],
    plunger: MarlinPlunger | None = None,
    meant: list[dict[str, int]] | None = None,
) -> tuple[int, int]:
    """Send lines; note after which the board stands elsewhere.

    Returns
    -------
    differing : int
        How often the simulated printer differs anew.
    elsewhere : int
        Looks at which the dry run's steps (``meant``) differ, by more than `SETTLED`, on any axis.
    """
    differing = elsewhere = 0
    apart = dict.fromkeys("XYZE", 0)
    for number, text in enumerate(lines):
        said, twin = both.tell(text)
        here = ["Unknown" in " ".join(s) or "rror" in " ".join(s) for s in (said, twin)]
        if here[0] != here[1]:
            note.append(f"{text!r}: board {said}, simulated {twin}")
            differing += 1
        if number % 1000 == 999:
            print(f"{number + 1} of {len(lines)}: {differing}, {elsewhere}", file=sys.stderr)
        if number % EVERY == EVERY - 1 or number == len(lines) - 1:
            board, simulated = both.steps()
            if meant and (off := _apart(board, meant[number])):
                note.append(f"{number}: dry run off by {off} steps")
                elsewhere += 1
            now = {axis: board[axis] - simulated[axis] for axis in "XYZE"}
            if plunger is not None:
                by_hand = plunger.take_all(lines[number - number % EVERY : number + 1])
                if by_hand != board["E"]:
                    note.append(f"{number}: E {board['E']} on the board, {by_hand} by hand")
                    plunger.motor = board["E"]
                    plunger.apart += 1
            if any(abs(now[a] - apart[a]) > SETTLED for a in "XYZE"):
                note.append(f"{lines[max(0, number - EVERY + 1) : number + 1]}: {apart} -> {now}")
                differing += 1
            apart = now
    return differing, elsewhere


def _apart(board: dict[str, int], meant: dict[str, int]) -> dict[str, int]:
    """Return the axes on which two counts differ by more than rounding."""
    off = {axis: board[axis] - meant[axis] for axis in "XYZE"}
    return off if max(map(abs, off.values())) > SETTLED else {}


def sent_pass(image: Path, folder: Path, count: int, note: list[str]) -> dict[str, int]:
    """Lines as the product's reader renders them, until ``count`` of them were sent."""
    lines: list[str] = []
    refused = Counter[str]()
    for number, text in enumerate(Lines(1, 0.1)):
        if len(lines) >= 1.15 * count:
            break
        written = numbered(text, number) if number % 7 == 0 else text
        try:
            line = read_line(written.encode(), PRINTER)
        except LineError as error:
            refused[error.sort] += 1
            continue
        if line:
            lines.append(line.text.decode())
    program = read_written("\n".join(lines).encode(), PRINTER, (0.0, 0.0, 0.0)).program
    bad = set(program.line[program.kind == BAD].tolist())  # they move nothing: left out
    refused["bad_arc"] = len(bad)
    lines = [line for number, line in enumerate(lines, 1) if number not in bad][:count]
    meant = dry_run_steps(lines)
    both = Both(image, folder)
    try:
        plunger = MarlinPlunger(STEPS["E"])
        differing, elsewhere = compare(both, lines, note, plunger, meant)
    finally:
        both.close()
    note.append(f"sent {len(lines)}, refused {dict(refused)}")
    looks = -(-len(lines) // EVERY)
    return {
        "lines": len(lines),
        "looks": looks,
        "differing": differing,
        "dry run": elsewhere,
        "e": plunger.apart,
    }


def raw_pass(image: Path, folder: Path, count: int, note: list[str]) -> int:
    """Lines as they were generated."""
    lines = [
        text
        for text, _ in zip(Lines(2, 0.4), range(count), strict=False)
        if text.split(";")[0].strip()
    ]
    both = Both(image, folder)
    try:
        return compare(both, lines, note)[0]
    finally:
        both.close()


def main() -> None:
    """Run both passes and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--marlin", type=Path, required=True)
    parser.add_argument("--lines", type=int, default=10_000)
    asked = parser.parse_args()
    note: list[str] = []
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sent = sent_pass(asked.marlin, folder / "sent", asked.lines, note)
        raw = raw_pass(asked.marlin, folder / "raw", asked.lines // 4, note)
    for text in note:
        print(text)
    what = f"{sent['lines']} lines as sent, {sent['looks']} looks at X, Y, Z, E, real Marlin: "
    for key, words in (
        ("differing", "simulated printer elsewhere"),
        ("dry run", "dry run's steps elsewhere"),
        ("e", "E motor beside Marlin's own arithmetic, done by hand"),
    ):
        rows.append(row(what + words, sent[key], "", "0", sent[key] == 0))
    rows.append(
        row(f"{asked.lines // 4} raw lines: simulated printer elsewhere", raw, "", "0", raw == 0)
    )
    print(json.dumps({"machine": machine(), "commit": commit(), "rows": rows}))


if __name__ == "__main__":
    main()
