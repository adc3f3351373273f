"""Kernels compiled before a command begins, on all cores, with a bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from kernels import cache_dir
from kernels.in_advance import compile_in_advance, missing, processes
from kernels.needed import Needed, needed
from printctl.cli.options import messages
from printctl.progress import Listener, StageBars

FEWEST: Final = 20
"""Fewer are compiled when they are called: processes of their own take seconds to begin."""


def have_kernels(*works: str, listener: Listener | None = None) -> None:
    """Compile what these kinds of work need (`kernels.needed`) and the store lacks.

    Parameters
    ----------
    works : str
        Names in the list of kernels.
    listener : Listener, optional
        Is told of a stage "kernels" if there is anything to compile.
    """
    rows = missing(needed(*works))
    if len(rows) >= FEWEST:
        compile_with_bar(rows, listener)


def compile_with_bar(rows: Sequence[Needed], listener: Listener | None = None) -> None:
    """Compile ``rows``, saying how far it is."""
    bars = StageBars(messages(), listener)
    if listener is not None:
        listener.begin(("kernels",), "kernels")
    note = f"{len(rows)} to compile, once for this version, on {processes()} cores"
    with bars.all(), bars.stage("kernels") as report:
        if not messages().is_terminal:
            messages().print(f"{'kernels':<14} {note} ...")
        report(0.0, note)
        failed = compile_in_advance(rows, lambda done: report(done / len(rows), note))
    left = f", {failed} left to their first call" if failed else ""
    bars.say("kernels", f"{len(rows) - failed} compiled, kept in {cache_dir()}{left}")
