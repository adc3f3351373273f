"""Match defects by location over several prints of a design: shared by several, or in one only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from registration.comparison.scans import GaugedScan, Record


@dataclass(frozen=True)
class SharedDefect:
    """A place where at least one print is defective.

    Attributes
    ----------
    kind : str
        See `registration.measuring.gauging.Defect`.
    vessel : int
    other : int or None
        The vessel that a bridge leads to.
    from_mm, to_mm : float, mm
        Along the vessel, over all prints.
    prints : tuple of int
        Those that have it, counted from 0.
    seen : int
        Prints in which the whole place was in view.
    scans : int
        Scans that show it.
    sizes_um : tuple of float, µm
        By scan, in the scans' order.
    """

    kind: str
    vessel: int
    other: int | None
    from_mm: float
    to_mm: float
    prints: tuple[int, ...]
    seen: int
    scans: int
    sizes_um: tuple[float, ...]

    @property
    def common(self) -> bool:
        """Whether more than one print has it."""
        return len(self.prints) > 1


def shared_defects(scans: Sequence[GaugedScan], prints: Sequence[int]) -> tuple[SharedDefect, ...]:
    """Gather defects of one kind and vessel whose extents overlap.

    Extents half a designed diameter apart count as overlapping: the end of a defect is no better
    known than that. Common ones first, then by vessel and place.
    """
    rows = [(row, n) for n, scan in enumerate(scans) for row in scan.defects]
    rows.sort(key=lambda pair: (_who(pair[0]), pair[0]["from_mm"], pair[1]))
    groups: list[list[tuple[Record, int]]] = []
    for row, n in rows:
        reach = scans[0].designed_um[row["vessel"]] / 2e3
        last = groups[-1] if groups else None
        if last and _who(last[0][0]) == _who(row) and row["from_mm"] <= _end(last) + reach:
            last.append((row, n))
        else:
            groups.append([(row, n)])
    shared = [_shared(group, scans, prints) for group in groups]
    return tuple(sorted(shared, key=lambda d: (not d.common, d.vessel, d.from_mm)))


def _who(row: Record) -> tuple[Any, ...]:
    other = row.get("other")
    return row["vessel"], row["kind"], -1 if other is None else other


def _end(group: list[tuple[Record, int]]) -> float:
    return max(float(row["to_mm"]) for row, _ in group)


def _shared(
    group: list[tuple[Record, int]], scans: Sequence[GaugedScan], prints: Sequence[int]
) -> SharedDefect:
    first = group[0][0]
    low, high = min(float(row["from_mm"]) for row, _ in group), _end(group)
    having = {prints[n] for _, n in group}
    seen = {
        number
        for scan, number in zip(scans, prints, strict=True)
        if not any(a < high and b > low for a, b in scan.unseen_mm[first["vessel"]])
    }
    return SharedDefect(
        kind=first["kind"],
        vessel=first["vessel"],
        other=first.get("other"),
        from_mm=low,
        to_mm=high,
        prints=tuple(sorted(having)),
        seen=len(seen | having),
        scans=len({n for _, n in group}),
        sizes_um=tuple(float(row["size_um"]) for row, _ in sorted(group, key=lambda p: p[1])),
    )
