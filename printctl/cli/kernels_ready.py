"""Compile missing numba kernels before a command starts, with a progress bar.

`kernels` is imported when called: a command that refuses its input, or prints its help, waits for
no compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from printctl.cli.options import messages
from printctl.progress import Listener, StageBars

if TYPE_CHECKING:
    from kernels.ahead import NeededKernel

MIN_KERNELS: Final = 20
"""Fewer are compiled when they are called: processes of their own take seconds to begin."""


def have_kernels(*works: str, listener: Listener | None = None) -> None:
    """Compile what these kinds of work need (`kernels.ahead`) and the store lacks.

    Parameters
    ----------
    works : str
        Names in the list of kernels.
    listener : Listener, optional
        Notified of a stage "kernels" if there is anything to compile.
    """
    from kernels.ahead import missing, needed_kernels

    rows = missing(needed_kernels(*works))
    if len(rows) >= MIN_KERNELS:
        compile_with_bar(rows, listener)


def compile_with_bar(rows: Sequence[NeededKernel], listener: Listener | None = None) -> None:
    """Compile ``rows``, showing progress."""
    from kernels import cache_dir
    from kernels.ahead import compile_ahead, processes

    bars = StageBars(messages(), listener)
    if listener is not None:
        listener.begin(("kernels",), "kernels")
    note = f"{len(rows)} to compile, once for this version, on {processes()} cores"
    with bars.all(), bars.stage("kernels") as report:
        if not messages().is_terminal:
            messages().print(f"{'kernels':<14} {note} ...")
        report(0.0, note)
        failed = compile_ahead(rows, lambda done: report(done / len(rows), note))
    left = f", {failed} left to their first call" if failed else ""
    bars.say("kernels", f"{len(rows) - failed} ready, kept in {cache_dir()}{left}")
