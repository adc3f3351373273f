"""Printer link, one row per promise of its issue: ``make bench-link``.

Every row names its clock: ``virtual`` is the simulated printer's own. What was done is judged by
`benchmarks.checkers.link_order`, from what the printer took and where its motors went, against
files made from step counts. ``--quick`` takes a minute or two and has fewer seeds and lines.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import link_pairs, link_pauses, link_real, link_virtual
from benchmarks.link_peers import OCTOPRINT, PRINTCORE, peer_rows
from benchmarks.link_printers import PeerFailedError
from benchmarks.link_transcripts import transcript_rows
from benchmarks.link_wire import BreakingTroubles
from benchmarks.machine import ROOT, commit, machine
from printctl.machine.link import LinkError

Row = dict[str, Any]
MILD = BreakingTroubles(noise=0.0004, drop_ok=0.001, delay=0.001, breaks=0.0002)
HARD = BreakingTroubles(noise=0.003, drop_ok=0.001, delay=0.001, breaks=0.0002)
NOT_MEASURED = {
    "a real board": "none here: all printers are simulated or recorded",
    "dry run of files never seen": "no other recording of a real Marlin exists here",
    "slipped lines found by M114 at checkpoints": "coordinates are absolute: the next line is "
    "right again, and M114 finds a slipped line only where it was the last one before a check",
}


def jobs(asked: argparse.Namespace, folder: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """What to measure, with the name that stands in ``not_measured`` when it fails."""
    quick = asked.quick
    lines, seeds, tries = (4000, 3, 4) if quick else (20_000, 50, 40)
    yield "transcripts", lambda: transcript_rows()
    yield "dry run", lambda: link_virtual.dry_run_rows(asked.record)
    yield "faults", lambda: link_virtual.fault_rows(folder)
    yield "faults in real time", lambda: link_real.fault_rows(folder)
    yield "speed", lambda: link_real.speed_rows(20_000 if quick else 100_000, folder)
    yield "uart", lambda: link_virtual.uart_rows(500 if quick else 3000, folder)
    yield "pairs", lambda: link_pairs.gain_rows(500 if quick else 3000, folder)
    yield "kills", lambda: link_virtual.kill_rows(40 if quick else 200, folder)
    reckless = link_pairs.reckless_pairs
    moments = 40 if quick else 200
    yield "kills of pairs", lambda: link_virtual.kill_rows(moments, folder, reckless)
    yield "kill -9", lambda: link_real.kill_nine_rows(1 if quick else 8, 3, folder)
    yield "pauses", lambda: link_pauses.pause_rows(3 if quick else 20, folder)
    yield "controlled stop", lambda: link_pauses.stop_rows(3 if quick else 20, folder)
    yield "M112", lambda: link_real.stop_rows(tries, folder)
    for peer in (PRINTCORE, OCTOPRINT):
        yield peer.name, partial(peer_rows, peer, 2000 if quick else 10_000, folder)
    noisy = link_virtual.noise_rows
    yield "noise 0.04 %", lambda: noisy("0.04 % noise", lines, seeds, MILD, folder, 10.0)
    yield "noise 0.3 %", lambda: noisy("0.3 % noise", lines, 2 * seeds // 5, HARD, folder, None)
    few = (2, 2) if quick else (20, 8)
    two = "two lines in flight, {} % noise".format
    yield two(0.04), lambda: noisy(two(0.04), lines, few[0], MILD, folder, 10.0, reckless)
    yield two(0.3), lambda: noisy(two(0.3), lines, few[1], HARD, folder, None, reckless)


def main() -> None:
    """Measure and print the benchmark's one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer lines, seeds and tries")
    parser.add_argument("--only", help="only jobs whose name contains this")
    parser.add_argument("--record", type=Path, default=ROOT / "tests" / "sim" / "data" / "marlin")
    asked = parser.parse_args()
    rows: list[Row] = []
    load, measured = os.getloadavg()[0], commit()
    left_out = dict(NOT_MEASURED)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PRINTCTL_DATA"] = folder  # these prints aren't the user's
        for name, job in jobs(asked, Path(folder)):
            if asked.only and asked.only not in name:
                left_out[name] = f"--only {asked.only}"
                continue
            begin = time.monotonic()
            try:
                rows += job()
            except (PeerFailedError, LinkError, OSError, ValueError) as error:
                left_out[name] = f"{type(error).__name__}: {error}"
            print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    found: Row = {"machine": machine() | {"load_before_and_after": [load, os.getloadavg()[0]]}}
    found |= {"commit": measured, "rows": rows, "not_measured": left_out}
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
