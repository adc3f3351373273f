"""Summarise each lumen's predicted open diameter and flow conductance, as arrays and JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.checks.lumens.leaks import Leak
from printctl.checks.lumens.lines import WrittenLines
from printctl.checks.lumens.stations import Openings, SectionStations

NAMED: Final = 5
"""Lumens named in a refusal; the others are counted."""


def list_names(names: Sequence[str]) -> str:
    """The first few, and how many more."""
    more = len(names) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")


CLOSED_MM: Final = 0.02
"""Ink doesn't leave so thin a hole open."""
NO_LAYER: Final = -1


@dataclass(frozen=True)
class LumenReport:
    """Each lumen's openness; arrays have a row per lumen.

    Attributes
    ----------
    names : tuple of str
    designed_mm : (m,) float64, mm
        Least designed diameter (of the widest circle in a section).
    narrowest_mm : (m,) float64, mm
        Diameter of the widest circle in the narrowest section.
    at_mm : (m, 3) float64, mm
        Where that is, in the part's frame.
    layer : (m,) int64
        And in which layer, from 0.
    error_mm : (m,) float64, mm
        Median over the lumen of open minus designed diameter.
    mean_mm : (m,) float64, mm
        Diameter of the even tube of the same conductance: (L / ∫ ds / d⁴)^¼, d that of the circle
        of the open area; 0 for a closed lumen.
    conductance : (m,) float64
        Against the design's: ∫ ds / d₀⁴ over ∫ ds / d⁴. At a fork, where a section isn't the
        lumen's alone, d is at most d₀.
    conductance_least : (m,) float64
        The same of the widest circles, as if nothing flowed beside them: what no corner flatters.
    closed_layers : tuple of (k,) int64
        In which layers a section is closed.
    """

    names: tuple[str, ...]
    designed_mm: FloatArray
    narrowest_mm: FloatArray
    at_mm: FloatArray
    layer: IntArray
    error_mm: FloatArray
    mean_mm: FloatArray
    conductance: FloatArray
    conductance_least: FloatArray
    closed_layers: tuple[IntArray, ...]

    @property
    def closed(self) -> BoolArray:
        """Which lumens are closed somewhere, (m,)."""
        return np.array([len(layers) > 0 for layers in self.closed_layers])


def report_lumens(
    stations: SectionStations, openings: Openings, lines: WrittenLines | None, place_mm: FloatArray
) -> LumenReport:
    """Gather the stations' sections by lumen; ``lines`` is None where there are no layers."""
    first = stations.first
    spans = [slice(a, b) for a, b in pairwise(first.tolist())]
    layer = _layers(stations, lines)
    narrow = np.array([s.start + int(openings.diameter[s].argmin()) for s in spans])
    closed = openings.diameter < CLOSED_MM
    round_mm = np.sqrt(4 / np.pi * openings.area)
    conductance, mean = _conductance(stations, round_mm, 2 * stations.radius, closed)
    least, _ = _conductance(stations, openings.diameter, stations.designed_mm, closed)
    error = openings.diameter - stations.designed_mm
    error = np.where(stations.own, error, np.minimum(error, 0.0))
    return LumenReport(
        names=stations.names,
        designed_mm=np.array([stations.designed_mm[s].min() for s in spans]),
        narrowest_mm=openings.diameter[narrow],
        at_mm=openings.centre[narrow] - place_mm,
        layer=layer[narrow].astype(np.int64),
        error_mm=np.array([np.median(error[s]) for s in spans]),
        mean_mm=mean,
        conductance=conductance,
        conductance_least=least,
        closed_layers=tuple(np.unique(layer[s][closed[s]]).astype(np.int64) for s in spans),
    )


def _layers(stations: SectionStations, lines: WrittenLines | None) -> IntArray:
    """Layer of each station; `NO_LAYER` in a print without layers."""
    if lines is None:
        return np.full(len(stations), NO_LAYER, dtype=np.int64)
    layer = np.searchsorted(lines.high, stations.axis[:, 2], side="right")
    return np.clip(layer, 0, len(lines.high) - 1).astype(np.int64)


def _conductance(
    stations: SectionStations, opened: FloatArray, designed: FloatArray, closed: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Conductance against the design's, and the diameter of the even tube with it; (m,) each.

    Poiseuille's law: a length ds of diameter d resists as ds / d⁴, and resistances in a row add.
    """
    of, step = stations.lumen, stations.step_mm
    wide = np.where(stations.own, opened, np.minimum(opened, designed))
    each = np.divide(step, wide**4, out=np.full(len(step), np.inf), where=~closed)
    resists, planned = np.bincount(of, each), np.bincount(of, step / designed**4)
    mean: FloatArray = (np.bincount(of, step) / resists) ** 0.25
    return planned / resists, mean


def report_dict(
    ideal: LumenReport, stepped: LumenReport | None, leaks: tuple[Leak, ...]
) -> dict[str, Any]:
    """For JSON: a summary, and a row per lumen, narrowest relative to its design first."""
    worse = stepped or ideal
    order = np.argsort(worse.conductance, kind="stable")
    return {
        "summary": _summary(ideal, stepped, leaks),
        "leaks": [leak.as_dict() for leak in leaks],
        "lumens": [_row(int(k), ideal, stepped) for k in order],
    }


def _summary(
    ideal: LumenReport, stepped: LumenReport | None, leaks: tuple[Leak, ...]
) -> dict[str, Any]:
    worse = stepped or ideal
    summary: dict[str, Any] = {
        "lumens": len(ideal.names),
        "closed": int((ideal.closed | worse.closed).sum()),
        "leaks": len(leaks),
        "conductance_median": float(np.median(ideal.conductance)),
        "conductance_least": float(ideal.conductance.min()),
        "diameter_error_median_um": 1e3 * float(np.median(ideal.error_mm)),
    }
    if stepped is not None:
        summary["stepped_conductance_median"] = float(np.median(stepped.conductance))
        summary["stepped_conductance_least"] = float(stepped.conductance.min())
        summary["stepped_diameter_error_median_um"] = 1e3 * float(np.median(stepped.error_mm))
    return summary


def _row(k: int, ideal: LumenReport, stepped: LumenReport | None) -> dict[str, Any]:
    row = {
        "lumen": ideal.names[k],
        "designed_mm": float(ideal.designed_mm[k]),
        **_opening(k, ideal),
    }
    if stepped is not None:
        row["stepped"] = _opening(k, stepped)
    return row


def _opening(k: int, report: LumenReport) -> dict[str, Any]:
    return {
        "narrowest_mm": float(report.narrowest_mm[k]),
        "at_mm": [float(value) for value in report.at_mm[k]],
        "layer": None if report.layer[k] == NO_LAYER else int(report.layer[k]),
        "diameter_error_median_um": 1e3 * float(report.error_mm[k]),
        "mean_mm": float(report.mean_mm[k]),
        "conductance": float(report.conductance[k]),
        "conductance_least": float(report.conductance_least[k]),
        "closed": len(report.closed_layers[k]) > 0,
        "closed_layers": [int(n) for n in report.closed_layers[k] if n != NO_LAYER],
    }
