"""Import the finite-element library NGSolve on demand, with a given number of threads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from design.errors import FlowError

THREADS: Final = 1
"""How many it works on unless told. Results are the same to the last digit only for the same
number; on two cores that others use too, a second makes it slower (measured: 3.3 s for 1.1)."""

CURVED: Final = 4
"""Degrees by which integrals are taken finer than the engine does by itself: it doesn't count the
deformation that curves the elements. Without, pressures are off by 2e-4 (against FEniCSx, which
does; with it they agree to 1.5e-8)."""

_BLAS: Final = "OPENBLAS_NUM_THREADS"


def load_engine() -> Any:
    """The module ngsolve.

    Raises
    ------
    FlowError
        When the extra isn't installed.
    """
    # Its BLAS reads this once, as it is loaded. Threads of its own for blocks of some 50 rows
    # make a factorisation eight times slower (measured).
    asked = os.environ.get(_BLAS)
    os.environ.setdefault(_BLAS, "1")
    try:
        import ngsolve
    except ImportError as exc:
        raise FlowError(
            "3D flow needs the finite-element engine NGSolve, which isn't installed; "
            "pip install 'printctl[flow3d]', or stay with 0D and 1D"
        ) from exc
    finally:
        if asked is None:
            os.environ.pop(_BLAS, None)
    return ngsolve


@contextmanager
def engine_threads(threads: int = THREADS) -> Iterator[Any]:
    """The engine, with so many threads."""
    ngsolve = load_engine()
    ngsolve.SetNumThreads(threads)
    ngsolve.ngsglobals.msg_level = 0
    with ngsolve.TaskManager():
        yield ngsolve
