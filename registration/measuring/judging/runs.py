"""List a vessel's findings: runs of sections out of tolerance, and local diameter changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, IntArray
from registration.json_ready import Record
from registration.measuring.judging.decisions import ORDER, decide, single_width
from registration.measuring.judging.features import Band, worst_section
from registration.measuring.judging.tolerance import Limit, Rule

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


BARE: dict[str, object] = {
    "decision": None, "deviation_um": None, "deviation_percent": None, "u_um": None,
    "tolerance_um": None, "limit": None,
}  # fmt: skip
"""What judging adds to a finding, of one without a diameter."""
_CLOSED = ("occlusion", "missing")


def findings(
    row: Record, band: Band, limit: Limit, rule: Rule, records: Sequence[Record]
) -> list[dict[str, object]]:
    """List what isn't a pass on a vessel, and what stands out from it; one place is one finding.

    Parameters
    ----------
    row : mapping
        The vessel, as in registration.json.
    band : Band
        Its sections.
    limit : Limit
        Of their diameters.
    rule : Rule
    records : sequence of mapping
        Its bulges, stenoses and closures that were found without a tolerance. A change whose own
        interval includes zero isn't listed (`is_refuted`).
    """
    changes = [
        change
        for change in (
            judged_change(row, band, limit, rule, one) for one in records if one["kind"] in SIGN
        )
        if not is_refuted(band, change)
    ]
    # What is known of a junction's own wall is measured otherwise than the sections beside it.
    alone = [one for one in changes if apart_from_sections(band, one)]
    within = [one for one in changes if one not in alone]
    runs = [_finding(row, band, limit, run) for run in _runs(row, band, _closed(band, records))]
    return [*alone, *(_joined(band, limit, group) for group in groups(within, runs))]


def _joined(band: Band, limit: Limit, group: Sequence[Record]) -> dict[str, object]:
    """Make one finding of runs and changes of one place: numbers of the worst, then the longest.

    Its ``changes`` are those that stand out within it, as they were found.
    """
    lead = max(group, key=lambda one: (ORDER.index(one["decision"]), length(one)))
    if len(group) == 1:
        return dict(lead)
    changes = [one for one in group if one["local"]]
    outward = max(changes, key=lambda one: one["significance"] or math.inf)["wall_um"]
    extent = {
        "from_mm": min(one["from_mm"] for one in group),
        "to_mm": max(one["to_mm"] for one in group),
    }
    return {
        **lead,
        **extent,
        "wall_um": outward if lead["wall_um"] is None else lead["wall_um"],
        "local": True,
        **_judged(band, limit, _inside(band, extent)),
        "changes": [_as_found(one) for one in changes],
    }


def _as_found(change: Record) -> dict[str, object]:
    return {key: value for key, value in change.items() if key not in BARE}


def _closed(band: Band, records: Sequence[Record]) -> BoolArray:
    """Closed sections that a closure accounts for."""
    series, half = band.series, band.series.spacing_mm / 2
    out = np.zeros(len(series.along_mm), dtype=np.bool_)
    for one in records:
        if one["kind"] in _CLOSED:
            out |= (series.along_mm >= one["from_mm"] - half) & (
                series.along_mm <= one["to_mm"] + half
            )
    return out & (series.measured_um == 0)


def _runs(row: Record, band: Band, explained: BoolArray) -> list[IntArray]:
    """Sections of each run: not a pass, off to one side, gaps up to a diameter closed.

    An undecided stretch within a diameter of a fail is part of it; what goes on is its own run.
    """
    open_ = (band.code > 0) & ~explained
    side = _sides(band)
    gap = max(1.5 * band.series.spacing_mm, float(row["designed_um"]) * 1e-3)
    runs: list[list[int]] = []
    sign = 0
    for k in np.flatnonzero(open_).tolist():
        near = runs and band.series.along_mm[k] - band.series.along_mm[runs[-1][-1]] <= gap + 1e-9
        if near and sign * side[k] >= 0:
            runs[-1].append(k)
            sign = sign or int(side[k])
        else:
            runs.append([k])
            sign = int(side[k])
    return [part for run in runs for part in _parts(np.array(run), band, gap)]


def _parts(run: IntArray, band: Band, gap: float) -> list[IntArray]:
    """Split a run into its fails, each with its undecided brink, and longer undecided flanks."""
    along = band.series.along_mm[run]
    failed = along[band.code[run] == 2]
    if not len(failed):
        return [run]
    near = np.abs(along[:, None] - failed).min(axis=1) <= gap
    edges = np.flatnonzero(np.diff(near.astype(np.int64))) + 1
    for flank in np.split(np.arange(len(run)), edges):
        if np.ptp(along[flank]) <= gap:
            near[flank] = True
    return np.split(run, np.flatnonzero(np.diff(near.astype(np.int64))) + 1)


def _sides(band: Band) -> IntArray:
    """1 where only the upper limit is in question, -1 the lower, 0 where both are."""
    error, u = band.series.error_um, np.nan_to_num(band.series.u_um, nan=np.inf)
    high, low = error + u > band.above_um, error - u < -band.below_um
    return high.astype(np.int64) - low.astype(np.int64)


def _finding(row: Record, band: Band, limit: Limit, run: IntArray) -> dict[str, object]:
    series, half = band.series, band.series.spacing_mm / 2
    inside = np.zeros(len(band.code), dtype=np.bool_)
    inside[run] = True
    k = worst_section(band, inside)
    assert k is not None  # a run has sections
    size, u = float(series.error_um[k]), float(series.u_um[k])
    length = float(row["length_mm"])
    extent = (
        max(0.0, float(series.along_mm[run[0]]) - half),
        min(length, float(series.along_mm[run[-1]]) + half),
    )
    return {
        "kind": "bulge" if size > 0 else "stenosis",
        "vessel": series.vessel,
        "other": None,
        "from_mm": extent[0],
        "to_mm": extent[1],
        "at_mm": float(series.along_mm[k]),
        "point_mm": series.place_mm[k].tolist(),
        "size_um": size,
        "error_um": u,
        "percent": 100 * size / float(series.designed_um[k]),
        "wall_um": None,
        "significance": 1.96 * abs(size) / u if u > 0 else None,
        "seen": not any(
            first < extent[1] + 2 * half and last > extent[0] - 2 * half
            for first, last in row.get("unseen_mm") or ()
        ),
        "local": False,
        **_judged(band, limit, inside),
    }


def judged_change(
    row: Record, band: Band, limit: Limit, rule: Rule, change: Record
) -> dict[str, object]:
    """Return a change of a vessel with the decision on its sections."""
    own = {**change, "local": True}
    inside = _inside(band, own)
    if inside.any():
        return own | _judged(band, limit, inside)
    return own | _alone(row, limit, rule, own)


def is_refuted(band: Band, change: Record) -> bool:
    """Return whether a judged change is no change by its own 95 % interval.

    Its sections that aren't a pass are listed as runs. Where none counts, as within a junction,
    the change stays unless it is a pass: nothing else would tell of it.
    """
    half = change["error_um"]
    if half is None or abs(float(change["size_um"])) > float(half):
        return False
    return change["decision"] == "pass" or not apart_from_sections(band, change)


def apart_from_sections(band: Band, finding: Record) -> bool:
    """Whether a finding is a change where no section counts, as within a junction."""
    return finding["kind"] in SIGN and not _inside(band, finding).any()


def _alone(row: Record, limit: Limit, rule: Rule, change: Record) -> dict[str, object]:
    """Decide on such a change by its own size and interval."""
    size, u = float(change["size_um"]), float(change["error_um"] or math.nan)
    percent = float(change["percent"] or math.nan)
    designed = 100 * size / percent if math.isfinite(percent) else float(row["designed_um"])
    below, above = limit.around(np.array([designed]))
    half = np.array([u])
    code = decide(rule, np.array([size]), half, np.array([single_width(u)]), below, above)
    return {
        "decision": ORDER[int(code[0])],
        "deviation_um": size,
        "deviation_percent": 100 * size / designed,
        "u_um": u if math.isfinite(u) else None,
        "tolerance_um": [-float(below[0]), float(above[0])],
        "limit": str(limit),
    }


def _inside(band: Band, extent: Record) -> BoolArray:
    along, edge = band.series.along_mm, 1e-6
    return np.asarray((along >= extent["from_mm"] - edge) & (along <= extent["to_mm"] + edge))


def _judged(band: Band, limit: Limit, inside: BoolArray) -> dict[str, object]:
    """Decision on some sections, and the numbers of the worst."""
    k = worst_section(band, inside)
    assert k is not None  # asked only where there are sections
    series = band.series
    return {
        "decision": ORDER[int(band.code[k])],
        "deviation_um": float(series.error_um[k]),
        "deviation_percent": 100 * float(series.error_um[k] / series.designed_um[k]),
        "u_um": float(series.u_um[k]),
        "tolerance_um": [-float(band.below_um[k]), float(band.above_um[k])],
        "limit": str(limit),
    }
