"""Compare prints: quantities, vessels, defects by location, gauge study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from registration.comparison.gauge_study import GaugeStudy, gauge_study
from registration.comparison.overall import (
    DAY_S,
    Quantity,
    Repeatability,
    quantities,
    repeatability,
)
from registration.comparison.scans import GaugedScan, GaugeStudyError, check_comparable
from registration.comparison.vessels import VesselSpread, vessel_spreads
from registration.json_ready import Record


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


@dataclass(frozen=True)
class Print:
    """One print and its scans.

    Attributes
    ----------
    label : str
        Of its first scan.
    print_id : str
    started : float or None
        s since 1970.
    scans : tuple of int
        Its scans, counted from 0 in the comparison's order.
    passed : bool or None
        True where every scan that has a verdict passed; None where none has one.
    undecided : bool
        Not passed, though no scan of it failed.
    """

    label: str
    print_id: str
    started: float | None
    scans: tuple[int, ...]
    passed: bool | None
    undecided: bool


@dataclass(frozen=True)
class Comparison:
    """Several prints of one design.

    Attributes
    ----------
    scans : tuple of GaugedScan
        By print, in order.
    prints : tuple of Print
        In the order of time where every print has one; else as they were given.
    by_time : bool
        Which of the two.
    tolerance_percent : float or None
        Of diameters; None: no capability.
    quantities : tuple of Quantity
    repeatability : Repeatability
    vessels : tuple of VesselSpread
    defects : tuple of SharedDefect
    gauge : GaugeStudy or None
        None: not asked for.
    """

    scans: tuple[GaugedScan, ...]
    prints: tuple[Print, ...]
    by_time: bool
    tolerance_percent: float | None
    quantities: tuple[Quantity, ...]
    repeatability: Repeatability
    vessels: tuple[VesselSpread, ...]
    defects: tuple[SharedDefect, ...]
    gauge: GaugeStudy | None = None

    def quantity(self, name: str) -> Quantity:
        """The quantity of that name."""
        return next(q for q in self.quantities if q.name == name)


def compare(
    scans: Sequence[GaugedScan], tolerance_percent: float | None = None, gauge: bool = False
) -> Comparison:
    """Compare prints of one design.

    Parameters
    ----------
    scans : sequence of GaugedScan
        Two or more; scans with the same ``print_id`` are scans of one print.
    tolerance_percent : float or None
        A vessel's diameter may be off by so much; asks for capability.
    gauge : bool
        Whether the scans are a gauge study: operators x parts x repeats.

    Raises
    ------
    ComparisonError
        For fewer than two, or for different designs.
    GaugeStudyError
        When the scans don't make a gauge study.
    """
    check_comparable(scans)
    by_time, groups = _ordered(scans)
    ordered = [scan for group in groups for scan in group]
    number = [k for k, group in enumerate(groups) for _ in group]
    prints, at = [], 0
    for group in groups:
        prints.append(_print(group, at))
        at += len(group)
    vessels = vessel_spreads(ordered, number, tolerance_percent)
    return Comparison(
        scans=tuple(ordered),
        prints=tuple(prints),
        by_time=by_time,
        tolerance_percent=tolerance_percent,
        quantities=quantities(ordered, number, _days(prints) if by_time else None),
        repeatability=repeatability(vessels, number),
        vessels=vessels,
        defects=shared_defects(ordered, number),
        gauge=_gauge(ordered, [prints[k].label for k in number]) if gauge else None,
    )


def _gauge(scans: Sequence[GaugedScan], labels: Sequence[str]) -> GaugeStudy:
    """Run the study; a scan without an operator's name is refused where others have one."""
    operators = [scan.operator for scan in scans]
    unnamed = [scan.label for scan in scans if scan.operator is None]
    if unnamed and len(unnamed) < len(scans):
        raise GaugeStudyError(
            f"no operator is named for {', '.join(unnamed[:4])}, though for other scans; name all "
            "with --operators A,A,B,..., or in each scan's record"
        )
    return gauge_study(
        scans,
        [name or "not stated" for name in operators],
        [scan.part or label for scan, label in zip(scans, labels, strict=True)],
    )


def _ordered(scans: Sequence[GaugedScan]) -> tuple[bool, list[list[GaugedScan]]]:
    """Scans by print; prints by time where all of them have one."""
    groups: dict[str, list[GaugedScan]] = {}
    for scan in scans:
        groups.setdefault(scan.print_id, []).append(scan)
    starts = [_started(group) for group in groups.values()]
    known = [start for start in starts if start is not None]
    if len(known) < len(starts):
        return False, list(groups.values())
    order = sorted(range(len(known)), key=lambda k: known[k])
    listed = list(groups.values())
    return True, [listed[k] for k in order]


def _started(group: Sequence[GaugedScan]) -> float | None:
    return next((scan.started for scan in group if scan.started is not None), None)


def _print(group: Sequence[GaugedScan], at: int) -> Print:
    verdicts = [scan.passed for scan in group if scan.passed is not None]
    return Print(
        label=group[0].label,
        print_id=group[0].print_id,
        started=_started(group),
        scans=tuple(range(at, at + len(group))),
        passed=all(verdicts) if verdicts else None,
        undecided=any(s.undecided for s in group)
        and all(s.undecided for s in group if s.passed is False),
    )


def _days(prints: Sequence[Print]) -> list[float]:
    first = prints[0].started or 0.0
    return [((each.started or 0.0) - first) / DAY_S for each in prints]
