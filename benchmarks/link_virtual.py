"""Link benchmark rows in the simulated printer's virtual time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.link_order import since_renumbering
from benchmarks.link_files import PrintFile, hatching, zigzag
from benchmarks.link_runs import DONE, Run, new_printer, run
from benchmarks.link_wire import BreakingTroubles, Ledger, Wire
from benchmarks.machine import row
from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.machine.link.clock import VirtualClock
from sim.gcode.dry_run.run import dry_run

Row = dict[str, Any]
VIRTUAL = {"clock": "virtual"}
M85_S = 600.0
"""The firmware's own switch-off after its last move, as the file sets it."""


def noise_rows(
    name: str,
    lines: int,
    seeds: int,
    troubles: BreakingTroubles,
    folder: Path,
    gap_s: float | None,
    protocol: Callable[[], MarlinProtocol] = MarlinProtocol,
) -> Iterator[Row]:
    """Noisy prints, judged line by line."""
    file, runs = zigzag(lines), []
    for seed in range(seeds):
        runs.append(run(file, folder, seed, troubles, protocol=protocol))
        if seed % 5 == 4:
            print(f"{name}: {seed + 1} of {seeds}", file=sys.stderr, flush=True)
    about = VIRTUAL | {"seeds": seeds, "lines": lines, "troubles": troubles.model_dump()}
    about |= {
        "connections lost and gone on": sum(r.begun - 1 for r in runs),
        "lines sent again": sum(r.again for r in runs),
        "pauses for noise": sum(r.pauses for r in runs),
    }
    yield from _once_rows(name, runs, about)
    yield from _slipped_rows(name, runs, len(file.lines))
    if gap_s is not None:
        yield _gap_row(name, runs, gap_s)


def _once_rows(name: str, runs: list[Run], about: Row) -> Iterator[Row]:
    """Was every line done once and in order; which prints ended early, and why."""
    wrong = sum(r.faults for r in runs)
    measure = f"{name}: lines lost, doubled or swapped; prints ended early without a slipped line"
    made = row(measure, wrong, "", "0", not wrong)
    states = sorted({str(r.status.state) for r in runs})
    halted = sum(r.halted and r.ledger.forged > 0 for r in runs)
    yield made | about | {"states": states, "halted by an M112 that noise made": halted}
    early = [r.status.message for r in runs if r.early and r.slipped]
    made = row(f"{name}: prints ended early, a line having slipped", len(early), "")
    yield made | {"of": len(runs), "messages": sorted(set(early))}
    strays = sum(r.order.strays for r in runs)
    blind = sum(r.order.unverified for r in runs)
    measure = f"{name}: stray commands after which no M114 was asked before going on"
    yield row(measure, blind, "", "0", not blind) | {"unnumbered fragments in all": strays}


def _slipped_rows(name: str, runs: list[Run], lines: int) -> Iterator[Row]:
    """How many lines came through the checksum garbled, and how far the motors went astray."""
    slipped = sum(r.order.slipped for r in runs)
    taken = sum(lines - r.order.unfinished for r in runs)
    share = round(1e6 * slipped / taken, 1)
    made = row(f"{name}: lines that an 8-bit XOR let through", share, "in 10^6 taken")
    beside = sum(r.order.slipped_beside for r in runs)
    expected = "about 13 in 10^6 at 0.04 %"
    yield made | {"lines": slipped, "of the host's own beside": beside, "expected": expected}
    astray = [max(r.unreached - r.order.slipped - r.order.unfinished, 0) for r in runs]
    dropped = sum(n for n, r in zip(astray, runs, strict=True) if r.halted)
    goal = "0 beyond those lines"
    made = row(f"{name}: moves not made by the motors", sum(astray), "", goal, not sum(astray))
    yield made | {"of them in the planner when the firmware halted": dropped}


def _gap_row(name: str, runs: list[Run], gap_s: float) -> Row:
    """The longest time between two lines of a file."""
    clean = [r.order.longest_gap_s for r in runs if not r.slipped]
    longest = max(clean, default=0.0)
    measure, goal = f"{name}: longest time without progress", f"<= {gap_s:g}"
    made = row(measure, longest, "s", goal, longest <= gap_s)
    slow = max((r.order.longest_gap_s for r in runs if r.slipped), default=0.0)
    return made | VIRTUAL | {"prints with a slipped line (it may be a slow move)": slow}


def kill_rows(
    moments: int, folder: Path, protocol: Callable[[], MarlinProtocol] = MarlinProtocol
) -> Iterator[Row]:
    """The host dies at random moments, half of them soon after it was started again."""
    file, exact, deaths = zigzag(120), 0, 0
    for seed in range(moments // 2):
        rng = np.random.default_rng(seed)
        last = (8 + int(rng.integers(1, 120)), int(rng.integers(1, 20)))
        part = rng.random()

        def wire(ledger: Ledger, clock: VirtualClock, begun: int) -> Wire:
            made = Wire(ledger, clock, np.random.default_rng(0))
            if begun < 2:
                made.die_at(last[begun], part)  # noqa: B023
            return made

        found = run(file, folder, seed, wire=wire, protocol=protocol)
        deaths += found.begun - 1
        exact += not found.faults and not found.unreached and not found.surplus
    two = "" if protocol is MarlinProtocol else ", two lines in flight"
    made = row(
        f"host killed at random moments and resumed{two}: prints exact",
        exact,
        f"of {moments // 2}",
        "all",
        exact == moments // 2,
    )
    yield made | VIRTUAL | {"deaths": deaths}


def uart_rows(lines: int, folder: Path) -> Iterator[Row]:
    """The product's time on the line against a loop by hand that has one line in flight."""
    for name, file in (("empty", hatching(lines, 3000)), ("full", zigzag(lines, 600))):
        ours = run(file, folder)
        if ours.status.state is not DONE:
            raise ValueError(f"the print ended as {ours.status}")
        known, taken = set(file.lines), since_renumbering(ours.ledger.taken)
        took = _span([t.time_s for t in taken if t.meant in known])
        least = _by_hand(file)
        ratio = took / least
        made = row(
            f"line at 115,200 Bd, queues {name}: over one line in flight by hand",
            round(ratio, 5),
            "ratio",
            "within 3 %",
            abs(ratio - 1) <= 0.03,
        )
        yield made | VIRTUAL | {"seconds": took, "by_hand_s": least, "lines": lines}


def _span(times: list[float]) -> float:
    return times[-1] - times[0]


def _by_hand(file: PrintFile) -> float:
    """Write a line, wait for its ok, write the next."""
    ledger = new_printer()
    printer = ledger.printer
    lines = [b"M110 N0", *file.lines]
    for number, text in enumerate(lines):
        body, xor = b"N%d %b" % (number, text), 0
        for byte in body:
            xor ^= byte
        printer.receive(b"%b*%d\n" % (body, xor))
        while b"ok" not in printer.take_output():
            printer.settle()
    return _span([t.time_s for t in ledger.taken[1:]])


FAULTS = {
    "reset": ("position_unknown", 0.5),
    "kill": ("killed", 0.5),
    "unplug": ("failed", 0.5),
    "runaway": ("killed", 0.5),
}
"""Fault, documented state, and the limit from the printer's stop to the host's knowing it, s."""


def fault_rows(folder: Path) -> Iterator[Row]:
    """Each fault ends in the state in `docs/link_reference.md`, in time, with heaters off."""
    file, as_documented = zigzag(1500, 1800, b"M140 S37", b"M109 S40"), 0
    for kind, (state, limit_s) in FAULTS.items():
        ledger = new_printer(f"{kind}@200")
        found = run(file, folder, ledger=ledger)
        stopped = _stopped_at(kind, found)
        late = found.ended_s - stopped
        right = found.status.state == state and late <= limit_s
        made = row(f"{kind} in mid-print: ends as", late, "s until known", f"{state}", right)
        yield made | VIRTUAL | {"state": str(found.status.state), "message": found.status.message}
        off_s = _heaters_off_after(found, stopped)
        limit = M85_S + 30.0 if kind == "unplug" else 0.0
        made = row(f"{kind}: heaters off after", off_s, "s", f"<= {limit:g}", off_s <= limit)
        yield made | VIRTUAL | ({"by": "M85, after the last move"} if kind == "unplug" else {})
        as_documented += right and off_s <= limit
    measure = "reset, kill, unplug, thermal runaway: documented state in its time, heaters off"
    made = row(measure, as_documented, f"of {len(FAULTS)}", "all", as_documented == len(FAULTS))
    yield made | VIRTUAL


def _stopped_at(kind: str, found: Run) -> float:
    ledger = found.ledger
    if kind == "unplug":
        return ledger.taken[-1].time_s
    return (ledger.resets if kind == "reset" else ledger.kills)[-1]


def _heaters_off_after(found: Run, since: float) -> float:
    """Let time pass until both heaters are off; from the fault on, s (infinite for never)."""
    printer = found.ledger.printer
    printer.finish()
    while printer.machine.heat.hotend.target_c or printer.machine.heat.bed.target_c:
        printer.advance(1.0)
        if printer.now - since > 2 * M85_S:
            return float("inf")
    return max(found.ledger.kills[-1] - since, 0.0) if found.ledger.kills else 0.0


def dry_run_rows(record: Path) -> Iterator[Row]:
    """The dry run against a real Marlin's own clock and counters."""
    words = next(
        line.split()
        for line in (record / "avr_duration.txt").read_text().splitlines()
        if line.startswith("fresh.gcode") and "M114" not in line and "," in line
    )
    seconds, steps = float(words[5]), [int(v) for v in words[6].split(",")]
    data = (record / "fresh.gcode").read_bytes()
    profile = load(Printer, "marlin_avr")
    found = dry_run(data, profile, (50.0, 50.0, 0.0), cold_extrusion=True, in_flight=2)
    off = found.duration_s / seconds - 1
    measure = "dry run of fresh.gcode against a real Marlin"
    made = row(measure, round(100 * off, 4), "%", "within 0.1", abs(off) <= 1e-3)
    yield made | VIRTUAL | {"seconds": found.duration_s, "recorded_s": seconds}
    per_mm = np.array([80, 80, 400, 500])
    begin = np.append(found.executed.start[0], found.executed.plunger_start[0])
    end = np.append(found.executed.end[-1], found.executed.plunger_end[-1])
    moved = np.round((end - begin) * per_mm).astype(int).tolist()
    worst = int(np.abs(np.subtract(moved, steps)).max())
    yield row("steps at its end, largest difference", worst, "steps", "0", worst == 0)
