"""Group a vessel's out-of-tolerance runs with the bulges or stenoses that overlap them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

Record = Mapping[str, Any]

SIGN: Final = {"bulge": 1, "stenosis": -1}


def groups(changes: Sequence[Record], runs: Sequence[Record]) -> list[list[Record]]:
    """Group what tells of one place of a vessel.

    A change belongs to the run to its side with which it shares most of its length, and to all of
    which it shares half of the shorter one's length.

    Parameters
    ----------
    changes, runs : sequence of mapping
        Of one vessel: ``kind``, ``from_mm``, ``to_mm``.
    """
    out: list[list[Record]] = [[run] for run in runs]
    for change in changes:
        most = max((_shared(change, run) for run in runs), default=0.0)
        joined, apart = [change], []
        for group in out:
            if any(_same(change, one, most) for one in group):
                joined += group
            else:
                apart.append(group)
        out = [*apart, joined]
    return out


def length(one: Record) -> float:
    """Extent along the vessel, mm."""
    return float(one["to_mm"]) - float(one["from_mm"])


def _same(change: Record, other: Record, most: float) -> bool:
    shared = _shared(change, other)
    return shared > 0 and shared >= min(most, 0.5 * length(change), 0.5 * length(other))


def _shared(change: Record, other: Record) -> float:
    """Length that both share, mm; 0 to different sides."""
    if SIGN[change["kind"]] != SIGN[other["kind"]]:
        return 0.0
    ends = min(change["to_mm"], other["to_mm"]) - max(change["from_mm"], other["from_mm"])
    return max(0.0, float(ends))
