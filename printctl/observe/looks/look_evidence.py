"""Convert gaps, widths and lumens seen in a layer's pictures to evidence for the decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from firmware_profiles.materials.bead import BeadSection
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection import Gap, LayerFindings, Stations, Stretch, Unseen
from printctl.observe.deciding import Evidence, FlowBlocks, InkSupply, SupplyState, judge_supply
from printctl.observe.deciding.evidence import (
    BARE_INK_SHARE,
    NarrowedLumen,
    ThinStretch,
    UnseenPath,
    confirm_thin,
)
from printctl.observe.looks.expected_ink import ExpectedInk, LayerInk

_WINDOW_STATIONS: Final = 5
"""Stations whose mean tells whether a place still belongs to a thin stretch."""
_END_WIDTHS: Final = 1.5
"""Widths from a line's end within which no width counts."""


def thin_lines(
    stretches: Sequence[Stretch],
    stations: Stations,
    measured: BoolArray,
    area_ratio: FloatArray,
    below: float,
) -> tuple[tuple[ThinStretch, ...], tuple[ThinStretch, ...]]:
    """Return thin stretches as far as they go: sure ones, and those that seem so.

    A stretch is where a line is *surely* beyond the tolerance; around it, the line is as thin in
    truth where the mean of some stations lies nearer to the stretch's ratio than to 1. It seems
    thin where that mean lies below a level, for lines of a flow that is known to be too small.

    Parameters
    ----------
    stretches : sequence of Stretch
    stations : Stations
    measured : (m,) bool
        Stations whose width counts: not beside places without ink.
    area_ratio : (m,) float64
        Cross-section seen over the requested one, where measured.
    below : float
    """
    thin, seem = list[ThinStretch](), list[ThinStretch]()
    for stroke in np.unique(stations.stroke[measured]).tolist():
        rows = np.flatnonzero(measured & (stations.stroke == stroke))
        if len(rows) < _WINDOW_STATIONS:
            continue
        along, ratio = stations.along_mm[rows], area_ratio[rows]
        mean = _moving_mean(ratio)
        is_thin, sure = np.zeros((2, len(rows)), dtype=np.bool_)
        for one in stretches:
            within = (along >= one.from_mm) & (along <= one.to_mm)
            if one.kind == "thin" and one.stroke == stroke and within.any():
                sure |= within
                is_thin |= within | (mean < (1.0 + float(ratio[within].mean())) / 2)
        thin += _runs(is_thin, sure, stations, rows, ratio)
        seem += _runs(mean < below, mean < below, stations, rows, ratio)
    return tuple(thin), tuple(seem)


def _moving_mean(ratio: FloatArray) -> FloatArray:
    """Return the mean over a window around each station."""
    ends = np.pad(ratio, _WINDOW_STATIONS // 2, mode="edge")
    return np.convolve(ends, np.ones(_WINDOW_STATIONS) / _WINDOW_STATIONS, "valid")


def _runs(
    thin: BoolArray, sure: BoolArray, stations: Stations, rows: IntArray, ratio: FloatArray
) -> list[ThinStretch]:
    """Return runs of thin stations that hold a sure one, extended to near ends of the stroke.

    Widths don't count at a line's ends, which are no thicker than the rest.
    """
    stroke, half = int(stations.stroke[rows[0]]), stations.length_mm[rows] / 2
    along, near = stations.along_mm[rows], _END_WIDTHS * float(stations.expected_mm[rows].max())
    whole = np.flatnonzero(stations.stroke == stroke)
    end = float((stations.along_mm[whole] + stations.length_mm[whole] / 2).max())
    edges = np.diff(np.concatenate([[0], thin.astype(np.int8), [0]]))
    runs = list[ThinStretch]()
    for first, past in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        part = slice(first, past)
        missing = 1.0 - float(np.average(ratio[part], weights=half[part]))
        if sure[part].any() and 0.0 < missing < 1.0:
            low, high = along[first] - half[first], along[past - 1] + half[past - 1]
            low, high = (0.0 if low < near else low), (end if end - high < near else high)
            runs.append(ThinStretch(stroke, float(low), float(high), missing))
    return runs


_BLOCK_S: Final = 1.0
"""Writing time whose widths are one reading of the flow."""
_MIN_BLOCKS: Final = 4
"""Readings of a short look: one alone would count as an outlier."""
_MIN_BLOCK_STATIONS: Final = 6
"""Stations in a reading, since neighbours share noise."""
_COMMON_U_QUANTILE: Final = 0.1
"""Quantile of the widths' uncertainties that bounds the one common to all of them."""
_BATH_LOOK_U: Final = 0.12
"""Relative standard uncertainty of filament sections in a look into a bath, beyond what their
picture says: of a simulated camera that shares no code with printctl widths scattered by 6 %."""
_TAPER_STATIONS: Final = 2
_DOUBT: Final = (Unseen.FAINT, Unseen.OLD_INK, Unseen.UNCLEAR)
"""Why a place isn't seen though the picture shows it."""


def seen_in(each: Sequence[Stations]) -> BoolArray:
    """Return which stations were seen, (n,): in a picture, while none that shows them is in doubt.

    Parameters
    ----------
    each : sequence of Stations
        Of the same lines, in one picture each.
    """
    seen = np.logical_or.reduce([one.seen for one in each])
    return np.asarray(seen & ~np.logical_or.reduce([np.isin(one.why, _DOUBT) for one in each]))


def build_evidence(
    layer: LayerInk,
    ink: ExpectedInk,
    findings: LayerFindings,
    again: LayerFindings | None,
    *,
    section: BeadSection,
    least_gap_mm: float,
    left_ul: float | None,
    unseen: tuple[UnseenPath, ...] = (),
    tolerated: float = 0.15,
) -> Evidence:
    """Return the evidence of one look.

    Parameters
    ----------
    layer : LayerInk
    ink : ExpectedInk
    findings, again : LayerFindings
        Of the first picture and a second one.
    section : BeadSection
        From widths to cross-sections in layers.
    least_gap_mm : float, mm
    left_ul : float or None, µL
        What the plunger still had.
    unseen : tuple of UnseenPath
        What no picture shows.
    tolerated : float
        Share of its ink that a line may lack.
    """
    each = [one for one in (findings, again) if one is not None]
    stations = findings.stations
    seen = seen_in([one.stations for one in each])
    row = layer.row[stations.piece]
    thin, seem_thin = _find_thin(findings, ink, layer, section, 1.0 - tolerated)
    if again is not None:
        thin = confirm_thin(thin, _find_thin(again, ink, layer, section, 1.0)[0])
    shift, u = _layer_shift(findings if again is None or findings.seen_share > 0 else again)
    layered = ink.layered and len(layer.fresh_row) > 0
    return Evidence(
        places=findings.places,
        gaps=findings.gaps,
        second_gaps=None if again is None else again.gaps,
        supply=_supply(stations, seen, ink, row, least_gap_mm, left_ul),
        flow=_flow_blocks(
            stations, ink, row, findings.u_width_ratio, section, findings.u_width_change
        ),
        seen_share=float(np.average(seen, weights=stations.length_mm)),
        way_mm=float(findings.stations.length_mm.sum()),  # mends can fail, too
        coverage=findings.coverage,
        unseen=unseen,
        shift_mm=shift,
        u_shift_mm=u,
        narrowed=_seen_lumens(findings),
        stretches=len(findings.stretches),
        thin=thin,
        seem_thin=seem_thin,
        level_mm=round(float(ink.end[layer.fresh_row, 2].max()), 3) if layered else None,
        blobs=tuple(one for one in findings.blobs if math.isfinite(one.height_mm)),
    )


def _supply(
    stations: Stations,
    seen: BoolArray,
    ink: ExpectedInk,
    row: IntArray,
    least_gap_mm: float,
    left_ul: float | None,
) -> InkSupply:
    volume = ink.area_mm2[row] * stations.length_mm
    per_mm = float(np.median(ink.area_mm2[row])) if len(row) else 0.0
    return judge_supply(
        volume, stations.present, seen, stations.stroke,
        least_ul=per_mm * least_gap_mm, left_ul=left_ul,
    )  # fmt: skip


def _seen_lumens(findings: LayerFindings) -> tuple[NarrowedLumen, ...]:
    return tuple(
        NarrowedLumen(one.name, one.width_mm / one.expected_mm, one.u_width_mm / one.expected_mm)
        for one in findings.lumens
        if one.seen
    )


def empty_evidence() -> Evidence:
    """Return the evidence of a look whose picture can't be judged."""
    none = np.zeros(0)
    supply = InkSupply(SupplyState.UNKNOWN)
    return Evidence(1, (), None, supply, FlowBlocks(none, none, none, none), 0.0)


def keep_mends_only(evidence: Evidence) -> Evidence:
    """Return the evidence of a look at mends alone: gaps, lumens and shift."""
    nothing = empty_evidence()
    return replace(
        evidence, flow=nothing.flow, supply=nothing.supply, thin=(), seem_thin=(), mends_only=True
    )


def record_figures(findings: LayerFindings, evidence: Evidence, ink: ExpectedInk) -> dict[str, Any]:
    """Return the figures of a look for its record; ``docs/run_folder.md`` lists them."""
    return {
        "seen_share": _number(evidence.seen_share),
        "width_ratio": _number(findings.width_ratio),
        "u_width_ratio": _number(findings.u_width_ratio),
        "coverage": _number(findings.coverage),
        "shift_mm": [_number(findings.shift.dx_mm), _number(findings.shift.dy_mm)],
        "level_mm": evidence.level_mm,
        "places": findings.places,
        "gaps": [
            {**locate_stretch(one, ink), "u_mm": _number(one.u_mm), "p": one.p_value}
            for one in findings.gaps
        ],
        "unseen": [{"name": one.name, **locate_stretch(one.gap, ink)} for one in evidence.unseen],
        "stretches": [
            {"kind": one.kind, **locate_stretch(one, ink)}
            | {"ratio": _number(one.ratio), "u_ratio": _number(one.u_ratio)}
            for one in findings.stretches
        ],
        "blobs": [
            {"kind": one.kind, "at_mm": [_number(place) for place in one.at_mm]}
            | {"area_mm2": _number(one.area_mm2), "height_mm": _number(one.height_mm)}
            for one in findings.blobs
        ],
        "ink": evidence.supply.state.value,
        "camera_moved_px": _number(findings.moved_px),
    }


def locate_stretch(one: Gap | Stretch, ink: ExpectedInk) -> dict[str, Any]:
    """Return a stretch's stroke, ways along it, and ends in the printer's frame, mm."""
    way = {"from_mm": _number(one.from_mm), "to_mm": _number(one.to_mm)}
    return {"stroke": one.stroke, **way, **stretch_ends(one.stroke, one.from_mm, one.to_mm, ink)}


def stretch_ends(stroke: int, from_mm: float, to_mm: float, ink: ExpectedInk) -> dict[str, Any]:
    """Return both ends of a stretch of a stroke in the printer's frame, mm."""
    path = ink.paths[stroke]
    ends = path.at(np.clip([from_mm, to_mm], 0.0, path.length_mm))
    start, end = ([_number(place) for place in end] for end in ends.tolist())
    return {"start_mm": start, "end_mm": end}


def _number(value: float) -> float | None:
    return round(float(value), 5) if math.isfinite(value) else None


def _find_thin(
    findings: LayerFindings, ink: ExpectedInk, layer: LayerInk, section: BeadSection, below: float
) -> tuple[tuple[ThinStretch, ...], tuple[ThinStretch, ...]]:
    """Return a layer's thin lines: sure ones, and those that seem below a share of their ink.

    None in a bath, where nothing can be written over a filament.
    """
    if not ink.layered:
        return (), ()
    stations = findings.stations
    row, measured = layer.row[stations.piece], _has_width(stations)
    ratio = np.full(len(row), np.nan)
    ratio[measured] = _area_ratio(stations.width_mm[measured], ink, row[measured], section)
    if stations.seam_share is not None:
        by_seams = ~measured & np.isfinite(stations.seam_share) & ~_near_absence(stations)
        measured, ratio = measured | by_seams, np.where(by_seams, stations.seam_share, ratio)
    return thin_lines(findings.stretches, stations, measured, ratio, below)


def _layer_shift(findings: LayerFindings) -> tuple[float, float]:
    """Return the shift's length and standard uncertainty along it, mm; inf without any."""
    way = np.array([findings.shift.dx_mm, findings.shift.dy_mm])
    length = float(np.linalg.norm(way))
    if not math.isfinite(length):
        return 0.0, math.inf
    along = way / length if length > 0 else np.array([1.0, 0.0])
    return length, math.sqrt(max(float(along @ findings.shift.covariance_mm2 @ along), 0.0))


def _flow_blocks(
    stations: Stations,
    ink: ExpectedInk,
    row: IntArray,
    u_common: float,
    section: BeadSection,
    u_change: float = math.inf,
) -> FlowBlocks:
    """Return cross-sections seen over expected, in blocks of a second of writing."""
    measured = _has_width(stations)
    if not measured.any():
        none = np.zeros(0)
        return FlowBlocks(none, none, none, none)
    row, width, u = row[measured], stations.width_mm[measured], stations.u_width_mm[measured]
    ratio = _area_ratio(width, ink, row, section)
    slope = _area_ratio(width + u, ink, row, section) - ratio  # of a width's uncertainty
    time = ink.time_s[row]
    block = _block_numbers(time, stations.length_mm[measured])
    count = np.bincount(block)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(block, values) / count)

    scatter = np.sqrt(np.bincount(block, slope**2)) / count
    # Lines of one look differ where the flow changes: that is no doubt that all of them share.
    u_common = min(
        u_common, float(np.quantile(u / stations.expected_mm[measured], _COMMON_U_QUANTILE))
    )
    relative = np.abs(slope / np.maximum(u, 1e-12) * stations.expected_mm[measured]) / ratio
    known = float(np.nan_to_num((u_common * relative).mean(), nan=0.0, posinf=0.0))
    u_change *= float(relative.mean())
    means = mean(ratio)
    u_block = np.hypot(scatter, known * means)
    if ink.style == "embedded":
        u_block, known = np.hypot(u_block, _BATH_LOOK_U * math.sqrt(len(means)) * means), 0.0
    return FlowBlocks(mean(time), means, u_block, mean(ink.factor[row]), known, u_change)


def _block_numbers(time_s: FloatArray, length_mm: FloatArray) -> IntArray:
    """Return each station's block, (n,): by the clock, or by equal ways in a short look."""
    by_time = np.unique(np.floor(time_s / _BLOCK_S), return_inverse=True)[1]
    wanted = min(_MIN_BLOCKS, len(time_s) // _MIN_BLOCK_STATIONS)
    if by_time.max() + 1 >= wanted:
        return np.asarray(by_time, dtype=np.int64)
    way = np.cumsum(length_mm) - length_mm / 2
    by_way = (way / (length_mm.sum() / wanted)).astype(np.int64)
    return np.asarray(np.unique(by_way, return_inverse=True)[1], dtype=np.int64)


def _has_width(stations: Stations) -> BoolArray:
    """Return stations whose width is known, away from where ink begins or stops."""
    measured = stations.seen & np.isfinite(stations.width_mm) & (stations.expected_mm > 0)
    return np.asarray(measured & ~_near_absence(stations))


def _near_absence(stations: Stations) -> BoolArray:
    """Return stations without ink and their neighbours, where ink tapers."""
    near = np.asarray(stations.seen & (stations.present < BARE_INK_SHARE), dtype=np.bool_)
    for _ in range(_TAPER_STATIONS):
        near = near | np.append(near[1:], False) | np.insert(near[:-1], 0, False)
    return near


def _area_ratio(
    width: FloatArray, ink: ExpectedInk, row: IntArray, section: BeadSection
) -> FloatArray:
    if not ink.layered:
        return np.asarray((width / ink.width_mm[row]) ** 2)
    height = ink.height_mm[row]
    wanted = section.area(ink.width_mm[row], height)
    return np.asarray(section.area(width, height) / np.maximum(wanted, 1e-12))
