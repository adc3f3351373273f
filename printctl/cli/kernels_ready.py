"""Compile missing numba kernels before a command starts, with a progress bar.

`kernels` is imported when called: a command that refuses its input, or tells its help, waits for no
compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from printctl.cli.options import messages
from printctl.progress import Listener, StageBars

if TYPE_CHECKING:
    from kernels.needed import NeededKernel

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
    from kernels.in_advance import missing
    from kernels.needed import needed_kernels

    rows = missing(needed_kernels(*works))
    if len(rows) >= FEWEST:
        compile_with_bar(rows, listener)


def compile_with_bar(rows: Sequence[NeededKernel], listener: Listener | None = None) -> None:
    """Compile ``rows``, saying how far it is."""
    from kernels import cache_dir
    from kernels.in_advance import compile_in_advance, processes

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
