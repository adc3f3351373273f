"""Prints in the simulated printer's virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.common import Row, all_of, limited, row, scratch
from benchmarks.link.files import zigzag
from benchmarks.link.runs import BreakingTroubles, Ledger, Run, Wire, run
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.timing import Timing
from printctl.machine.ports.clock import VirtualClock

VIRTUAL = {"clock": "virtual"}
MILD = BreakingTroubles(noise=0.0004, drop_ok=0.001, delay=0.001, breaks=0.0002)
HARD = BreakingTroubles(noise=0.003, drop_ok=0.001, delay=0.001, breaks=0.0002)


def noise_rows(quick: bool) -> Iterator[Row]:
    """Yield noisy prints whose cable is pulled out now and then, judged line by line."""
    lines, seeds = (1000, 1) if quick else (20_000, 50)
    with scratch() as folder:
        yield from _noisy("0.04 % noise", lines, seeds, MILD, folder, 10.0)
        hard, few = max(1, 2 * seeds // 5), max(1, seeds // 6)
        yield from _noisy("0.3 % noise", lines, hard, HARD, folder, None)
        name = "two lines in flight, 0.3 % noise"
        yield from _noisy(name, lines, few, HARD, folder, None, reckless_pairs)


def reckless_pairs() -> MarlinProtocol:
    """Return two in flight again right after each doubt: the most that noise can be made of."""
    return MarlinProtocol(Timing(calm_lines=0), Pairing(128))


def _noisy(
    name: str,
    lines: int,
    seeds: int,
    troubles: BreakingTroubles,
    folder: Path,
    gap_s: float | None,
    protocol: Callable[[], MarlinProtocol] = MarlinProtocol,
) -> Iterator[Row]:
    file = zigzag(lines)
    runs = [run(file, folder, seed, troubles, protocol=protocol) for seed in range(seeds)]
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
    made = limited(measure, wrong, "", 0)
    states = sorted({str(r.status.state) for r in runs})
    halted = sum(r.halted and r.ledger.forged > 0 for r in runs)
    yield made | about | {"states": states, "halted by an M112 that noise made": halted}
    early = [r.status.message for r in runs if r.early and r.slipped]
    made = row(f"{name}: prints ended early, a line having slipped", len(early), "")
    yield made | {"of": len(runs), "messages": sorted(set(early))}
    strays = sum(r.order.strays for r in runs)
    blind = sum(r.order.unverified for r in runs)
    measure = f"{name}: stray commands after which no M114 was asked before going on"
    yield limited(measure, blind, "", 0) | {"unnumbered fragments in all": strays}


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
    made = limited(f"{name}: longest time without progress", longest, "s", gap_s)
    slow = max((r.order.longest_gap_s for r in runs if r.slipped), default=0.0)
    return made | VIRTUAL | {"prints with a slipped line (it may be a slow move)": slow}


def kill_rows(quick: bool) -> Iterator[Row]:
    """Yield hosts that die at random moments, half of them soon after they were started again."""
    with scratch() as folder:
        for protocol in (MarlinProtocol, reckless_pairs):
            yield _killed(8 if quick else 100, folder, protocol)


def _killed(prints: int, folder: Path, protocol: Callable[[], MarlinProtocol]) -> Row:
    file, exact, deaths = zigzag(120), 0, 0
    for seed in range(prints):
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
    name = f"host killed at random moments and resumed{two}: prints exact"
    return all_of(name, exact, prints) | VIRTUAL | {"deaths": deaths}
