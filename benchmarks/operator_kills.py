"""Kill server, stop process, station and link during prints started from the web page.

``python -m benchmarks.operator_kills --kills 100`` makes up to four kills (kill -9) in each print,
in a seeded order at seeded moments: start, printing, pausing, paused, resuming, going on. Two
seconds after each, REST and command line are held against the journal, which `journal_verdict`
reads; an interrupted print is gone on with by the call that the page's two clicks make (every fifth
one by the clicks themselves, in Chromium). At the end of each print the simulated printer's step
counters tell whether every move of the file ran once. The last output is a JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.executed_once import executed_ends, lost_and_doubled, off_the_file
from benchmarks.link_files import STEPS_PER_MM
from benchmarks.link_printers import PeerFailedError, simulated
from benchmarks.machine import commit, machine, row
from benchmarks.operator_kills_job import short_job
from benchmarks.operator_kills_print import Kill, Killed, KilledPrint
from benchmarks.operator_page import PageServer

Row = dict[str, Any]
_WITHIN_S = 2.0


def plan(rng: np.random.Generator) -> list[Kill]:
    """Return the four kills of a print: the link's comes after the station's."""
    order = [str(one) for one in rng.permutation(["server", "door", "station", "link"])]
    first, second = sorted((order.index("station"), order.index("link")))
    order[first], order[second] = "station", "link"
    kills, broken_off = [], False
    for number, victim in enumerate(order):
        moments = ["printing", "pausing", "paused", "resuming"]
        moments += ["start"] * 2 if number == 0 else []
        moments += ["going on"] * 2 if broken_off and victim in ("link", "server") else []
        kills.append(Kill(victim, str(rng.choice(moments)), float(rng.random())))
        broken_off = victim in ("station", "link")
    return kills


def one_print(page: PageServer, seed: int, folder: Path) -> tuple[list[Killed], list[str]]:
    """Print once; return what each kill showed, and what was wrong with the lines at the end."""
    file, record = short_job(seed), folder / f"{seed}.npz"
    link = folder / f"tty-{seed}"
    with simulated("generic_marlin", "--speed", "2", "--record", str(record), "--link", str(link)):
        print_ = KilledPrint(page, file, seed, str(link))
        try:
            for kill in plan(np.random.default_rng(seed)):
                if not print_.kill(kill):
                    break
            wrong = print_.finish()
        except PeerFailedError as exc:
            print_.leave()
            return print_.killed, [f"print {seed}: {exc}"]
    # The record is written when the printer's process ends.
    begin, end = executed_ends(record, STEPS_PER_MM)
    lost, doubled = lost_and_doubled(file.ends, begin, end)
    beside = off_the_file(file.ends, begin, end)
    if (lost, doubled, beside) != (0, 0, 0):
        wrong.append(f"print {seed}: {lost} moves lost, {doubled} doubled, {beside} beside it")
    return print_.killed, wrong


def rows(killed: Sequence[Killed], wrong: list[str], prints: int) -> Iterator[Row]:
    """Judge all kills."""
    agreed = sum(not one.wrong and one.agreed_s <= _WITHIN_S for one in killed)
    count = len(killed)
    by = Counter(f"{one.kill.victim}, {one.kill.moment}" for one in killed)
    found = [one.agreed_s for one in killed]
    facts = {
        "kills": dict(sorted(by.items())),
        "longest_s": round(max(found), 2),
        "median_s": round(float(np.median(found)), 2),
        "server_up_again_s": round(max((one.restart_s for one in killed), default=0.0), 1),
    }
    name = f"{count} kills in {prints} prints from the page"
    made = row(
        f"{name}: page and command line tell what the journal tells within {_WITHIN_S:g} s",
        agreed,
        "kills",
        f">= {count}",
        agreed == count,
    )
    yield made | facts | {"clock": "wall"}
    clicked = sum(one.clicked for one in killed)
    goes = sum(one.went_on for one in killed)
    could = sum(one.resumable for one in killed)
    made = row(f"{name}: resumable prints gone on with", goes, "", f">= {could}", goes == could)
    yield made | {"by_clicks_in_chromium": clicked}
    made = row(f"{name}: prints with a move lost, doubled or beside the file", len(wrong), "", "0")
    yield made | {"met": not wrong, "by": "the simulated printer's step counters"}


def main() -> None:
    """Kill, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--quick", action="store_true", help="8 kills")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    killed: list[Killed] = []
    wrong: list[str] = []
    seed = asked.seed
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        os.environ["PRINTCTL_DATA"] = str(folder / "data")
        (folder / "workspace").mkdir()
        page = PageServer(folder / "workspace")
        page.start()
        try:
            while len(killed) < (8 if asked.quick else asked.kills):
                more, bad = one_print(page, seed, folder)
                killed += more
                wrong += bad
                for text in [*(text for one in more for text in one.wrong), *bad]:
                    print(text, file=sys.stderr, flush=True)
                print(f"print {seed}: {len(more)} kills", file=sys.stderr, flush=True)
                seed += 1
        except KeyboardInterrupt:  # what was found so far is told
            pass
        finally:
            page.end()
    found = {
        "machine": machine(),
        "commit": commit(),
        "rows": list(rows(killed, wrong, seed - asked.seed)),
    }
    print(json.dumps(found, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
