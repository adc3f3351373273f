"""Run a design search: evaluate new candidates, store each result, rank all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from design.files import write_text
from printctl.pipeline.running.lock import run_lock
from printctl.progress import Report, StageBars
from printctl.search.candidates import Candidate, CandidateSet, draw_candidates
from printctl.search.model import SearchFile
from printctl.search.rank import RankedCandidate, ranked
from printctl.search.workers import Workers

FOLDER: Final = "candidates"


class Store:
    """The results in a search's folder.

    A file is there whole or not at all, so that a search can be killed at any time and goes on
    with what is missing. Results of other keys stay: a search file that is changed, and changed
    back, finds them again.
    """

    def __init__(self, out: Path) -> None:
        self._folder = out / FOLDER

    def path(self, key: str) -> Path:
        """Where a candidate's result is."""
        return self._folder / f"{key}.json"

    def read(self, key: str) -> dict[str, Any] | None:
        """A candidate's result as `evaluate` gave it; None where there is none to rely on."""
        try:
            record = json.loads(self.path(key).read_text(encoding="utf-8"))
            if isinstance(record["result"], dict) and record["result"].keys() & {
                "numbers",
                "refused",
            }:
                return dict(record["result"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return None

    def write(self, key: str, values: dict[str, Any], result: dict[str, Any]) -> None:
        """Keep a result; ``values`` tell a reader of the file which candidate it is."""
        text = json.dumps({"values": values, "result": result}, indent=1, allow_nan=False)
        write_text(self.path(key), text + "\n")


@dataclass(frozen=True)
class SearchResult:
    """Results of a search.

    Attributes
    ----------
    drawn : CandidateSet
    rows : sequence of RankedCandidate
        The best first.
    made, kept : int
        Results made now, and known from before.
    broken : mapping of int to str
        Candidate's number to what went wrong; such a candidate is tried again next time.
    """

    drawn: CandidateSet
    rows: Sequence[RankedCandidate]
    made: int
    kept: int
    broken: Mapping[int, str]

    @property
    def left(self) -> int:
        """Candidates that no result is known of."""
        return len(self.drawn.candidates) - len(self.rows)

    @property
    def best(self) -> RankedCandidate | None:
        """The best candidate that keeps all limits, if there is one."""
        first = self.rows[0] if self.rows else None
        return first if first is not None and first.state == "good" else None


def run_search(
    search: SearchFile,
    folder: Path,
    out: Path,
    console: Console,
    workers: Workers | None = None,
    limit: int | None = None,
) -> SearchResult:
    """Search, as far as ``limit`` new candidates, and rank what is known.

    Parameters
    ----------
    search : SearchFile
    folder : Path
        Of the search file.
    out : Path
        Where results are kept; those that are there aren't made again.
    console : Console
        For progress.
    workers : Workers, optional
        One process a core of this machine by default.
    limit : int, optional
        Candidates grown now at most.

    Raises
    ------
    RecipeError
        When the recipe refuses a candidate, before anything is grown.
    PrintctlError, OSError
        When workers can't be reached, results can't be kept, or another search runs in ``out``.
    """
    drawn = draw_candidates(search, folder)
    with run_lock(out):
        store = Store(out)
        known = {one.key: store.read(one.key) for one in drawn.candidates}
        missing = [one for one in drawn.candidates if known[one.key] is None]
        kept = len(drawn.candidates) - len(missing)
        now = missing if limit is None else missing[:limit]
        broken = _grow(now, store, known, workers or Workers(), StageBars(console))
        results = [(one, known[one.key]) for one in drawn.candidates]
        rows = ranked(search, [(one, result) for one, result in results if result is not None])
        return SearchResult(drawn, rows, len(now) - len(broken), kept, broken)


def _grow(
    missing: Sequence[Candidate],
    store: Store,
    known: dict[str, dict[str, Any] | None],
    workers: Workers,
    bars: StageBars,
) -> dict[int, str]:
    """Grow what is missing, keep each result at once, and return what broke."""
    broken: dict[int, str] = {}
    outcomes = workers.outcomes([one.task for one in missing])
    with bars.all(), bars.stage("search") as report, closing(outcomes):
        for done, (number, result) in enumerate(outcomes, 1):
            one = missing[number]
            if "broken" in result:
                broken[one.number] = result["broken"]
            else:
                store.write(one.key, dict(one.values), result)
                known[one.key] = result
            _tell(report, done, len(missing), known, broken)
    bars.say("search", f"{len(missing) - len(broken)} candidates grown")
    return broken


def _tell(
    report: Report,
    done: int,
    count: int,
    known: Mapping[str, Mapping[str, Any] | None],
    broken: Mapping[int, str],
) -> None:
    refused = sum("refused" in result for result in known.values() if result is not None)
    more = [f"{refused} refused"] if refused else []
    more += [f"{len(broken)} broken"] if broken else []
    report(done / count, ", ".join([f"{done} of {count}", *more]))
