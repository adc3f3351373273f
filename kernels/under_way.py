"""Wait for kernels that other processes are compiling, where a call needs one of them."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Future, wait
from typing import Any, Final

from kernels.needed import NeededKernel, types_text

_UNDER_WAY: Final[dict[tuple[str, str], Future[bool]]] = {}


def expect(rows: Iterable[NeededKernel], done: Iterable[Future[bool]]) -> None:
    """Take note that each of ``rows`` lies in the store, or can't be compiled, when it is done."""
    for row, future in zip(rows, done, strict=True):
        _UNDER_WAY[row.kernel, row.takes] = future


def expect_no_more() -> None:
    """Forget all that was expected: what is missing from now on is compiled by its caller."""
    _UNDER_WAY.clear()


def waited_for(kernel: str, signature: Iterable[Any]) -> bool:
    """Wait for a kernel (module, colon, function) that is expected; return whether it was."""
    if not _UNDER_WAY:
        return False
    try:
        future = _UNDER_WAY.get((kernel, types_text(signature)))
    except TypeError:  # types that the list can't hold
        return False
    if future is None or future.cancelled():
        return False
    wait([future])
    return True
