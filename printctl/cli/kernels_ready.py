"""Compile missing numba kernels before a command starts, with a progress bar.

`kernels` is imported when called: a command that refuses its input, or prints its help, waits for
no compiler.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING, Final

from printctl.cli.options import messages
from printctl.progress import Listener, StageBars, draws_bars

if TYPE_CHECKING:
    from kernels.ahead import NeededKernel

MIN_KERNELS: Final = 20
"""Fewer are compiled when they are called: processes of their own take seconds to begin."""
_CALLED_LAST: Final = "registration."
"""Packages that a run's last stage alone calls: a quarter of what a run compiles."""


def have_kernels(*works: str, listener: Listener | None = None, fewest: int | None = None) -> None:
    """Compile what these kinds of work need (`kernels.ahead`), or all, and the store lacks.

    ``listener`` is notified of a stage "kernels" if there is anything to compile; fewer than
    ``fewest`` (`MIN_KERNELS` if not given) are left.
    """
    if rows := _missing(works, fewest):
        with _compiling(rows, (), listener):
            pass


@contextmanager
def kernels_for_a_run(*works: str, listener: Listener | None = None) -> Iterator[None]:
    """Do the same, and compile what only registration needs while the stages before it run."""
    rows = _missing(works)
    late = [one for one in rows if one.kernel.startswith(_CALLED_LAST)]
    soon = [one for one in rows if one not in late]
    with _compiling(soon or late, late if soon else (), listener) if rows else nullcontext():
        yield


def _missing(works: Sequence[str], fewest: int | None = None) -> list[NeededKernel]:
    from kernels.ahead import missing, needed_kernels

    rows = missing(needed_kernels(*works))
    return rows if len(rows) >= (MIN_KERNELS if fewest is None else fewest) else []


@contextmanager
def _compiling(
    rows: Sequence[NeededKernel], late: Sequence[NeededKernel], listener: Listener | None
) -> Iterator[None]:
    """Compile ``rows``, showing progress, then ``late`` while the body runs."""
    from kernels import cache_dir
    from kernels.ahead import compiling, processes

    bars = StageBars(messages(), listener)
    if listener is not None:
        listener.begin(("kernels",), "kernels")
    note = f"{len(rows)} to compile, once for this version, on {processes()} cores"
    note += f"; {len(late)} more while stages run" if late else ""
    with ExitStack() as stack:
        with bars.all(), bars.stage("kernels") as report:
            if not draws_bars(messages()):
                messages().print(f"{'kernels':<14} {note} ...")
            report(0.0, note)
            work = compiling(rows, late, lambda done: report(done / len(rows), note))
            failed = stack.enter_context(work)
        left = f", {failed} left to their first call" if failed else ""
        bars.say("kernels", f"{len(rows) - failed} ready, kept in {cache_dir()}{left}")
        yield
