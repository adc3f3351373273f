"""Inspect an aligned scan: vessels, defects, topology, volume overlap, perfusion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels import helper_thread
from kernels.arrays import FloatArray
from registration.alignment import Alignment
from registration.measuring.gauging import (
    ContrastGauge,
    Defect,
    Ends,
    Perfusion,
    VesselGauge,
    VesselTrace,
    drop_edge_changes,
    find_changes,
    find_closures,
    find_junction_changes,
    gauge_vessels,
    liquid_level,
    trace_vessels,
    with_designed_walls,
    with_interval,
    with_mouths,
    with_own_levels,
    with_told_walls,
    withdraw_sections,
    without_gel_like,
    without_resistance,
)
from registration.measuring.gauging.perfusion import perfusion
from registration.measuring.gauging.resolution import edge_blur_mm, resolved_um, without_unresolved
from registration.measuring.topology import (
    Faults,
    LeakSearch,
    LumenGrid,
    Overlap,
    Topology,
    compare_topology,
    find_leaks,
    lay_grid,
    overlap,
    scanned_with,
)
from registration.measuring.topology.gel_paths import LEAST_MM
from registration.prepared import PreparedScan
from registration.segmentation import GelEvidence

RIM_BLURS = 3.0
"""So many standard deviations of the blur a face is rounded off beside a sharp edge."""
LUMEN_REACH_MM = 1.0
"""How far around lumens scanned without their construct a leak is followed."""


@dataclass(frozen=True)
class Findings:
    """See the fields of `registration.result.RegistrationReport` of the same names."""

    vessels: tuple[VesselGauge, ...]
    defects: tuple[Defect, ...]
    topology: Topology
    overlap_rigid: Overlap
    overlap_scaled: Overlap
    perfusion: Perfusion | None
    contrast: ContrastGauge


@dataclass(frozen=True)
class Inspection(PreparedScan):
    """An aligned scan.

    Attributes
    ----------
    alignment : Alignment
        Scan to part.
    deviation_mm : (n,) float64, mm
        Of the segmentation's vertices after the scaled fit.
    evidence : GelEvidence
        Of the scan.
    """

    alignment: Alignment
    deviation_mm: FloatArray
    evidence: GelEvidence


def inspect(case: Inspection) -> Findings:
    """Gauge every vessel, look for defects, compare topology and volume, solve the flow."""
    field, fit = case.segmentation.field, case.alignment.scaled
    part = None if case.is_lumen else case.surface
    traces = trace_vessels(case.network, case.segmentation, fit, case.section_mm, part)
    traces = with_designed_walls(traces, fit, case.surface, case.is_lumen)
    traces = with_mouths(traces, case.segmentation, fit, part)
    traces, errors, wall_mm = with_told_walls(traces, case.segmentation, case.errors, case.is_lumen)
    margin = _margin(case)
    grid = _grid(case, margin)
    evidence = case.evidence
    liquid = liquid_level(traces, evidence, fit)
    seen = sum(int(trace.seen.sum()) for trace in traces)
    traces = withdraw_sections(traces, evidence, liquid)
    traces = without_unresolved(traces, field.blur_mm)
    untold = seen - sum(int(trace.seen.sum()) for trace in traces)
    traces = without_gel_like(case.network, traces, evidence, fit)
    traces = with_own_levels(traces, case.segmentation, fit, part)
    # Fronts that look for leaks run on one core; what needs none of them is done beside.
    with helper_thread() as other:
        search = LeakSearch(grid, case.surface, case.is_lumen, _wall(case),
                            case.options.false_alarm, field, evidence, liquid, fit,
                            case.network)  # fmt: skip
        leaking = other.submit(find_leaks, search, traces)
        closures = find_closures(traces, Ends(field, fit, wall_mm, errors))
        scale = float(np.mean(fit.scale))
        hidden = _in_junctions(case, traces)
        changes = [
            *find_changes(traces, scale, case.options.false_alarm, field.blur_mm),
            *hidden,
        ]
        near = max(margin, float(case.network.radius.min()) / 2)
        vessels = gauge_vessels(
            case.network, traces, case.segmentation, fit, case.deviation_mm, errors,
            case.alignment.uncertainty,
        )  # fmt: skip
        vessels = without_resistance(vessels, hidden)
        flow = _perfusion(case, traces, vessels, not hidden)
        rigid = overlap(scanned_with(grid, field, case.alignment.rigid), near)
        leaks = leaking.result()
    blur_mm = edge_blur_mm(case.segmentation)
    through = [*closures, *leaks.defects]
    changes = [*changes, *leaks.swellings]
    defects = (*through, *drop_edge_changes(changes, through, traces))
    return Findings(
        vessels=vessels,
        defects=tuple(sorted(defects, key=lambda defect: (defect.vessel, defect.at_mm))),
        topology=compare_topology(
            case.network,
            grid,
            near,
            _faults(through),
            leaks.bridges,
            all(bool(trace.seen.all()) for trace in traces),
        ),
        overlap_rigid=rigid,
        overlap_scaled=overlap(grid, near),
        perfusion=flow,
        contrast=ContrastGauge(
            liquid,
            untold / max(seen, 1),
            leaks.examined,
            leaks.unresolved,
            1e3 * blur_mm,
            max(resolved_um(blur_mm), 1e3 * LEAST_MM),
        ),
    )


def _in_junctions(case: Inspection, traces: tuple[VesselTrace, ...]) -> list[Defect]:
    """Changes of walls that no whole section has; away from edges, which a blur rounds."""
    segmentation, fit = case.segmentation, case.alignment.scaled
    points = fit.apply(segmentation.surface.vertices[segmentation.seen])
    clear = ~case.surface.near_rims(points, RIM_BLURS * segmentation.field.blur_mm)
    off = case.deviation_mm[segmentation.seen]
    return find_junction_changes(traces, points[clear], off[clear], case.options.false_alarm)


def _perfusion(
    case: Inspection,
    traces: tuple[VesselTrace, ...],
    vessels: tuple[VesselGauge, ...],
    known: bool,
) -> Perfusion | None:
    """Solve the flow; its pressure ratio has no interval where a junction's lumen isn't known."""
    flow = perfusion(case.network, traces, case.options.flow, case.alignment.scaled.scale)
    if flow is None or not known:
        return flow
    return with_interval(flow, [vessel.errors for vessel in vessels])


def _faults(defects: list[Defect]) -> Faults:
    return Faults(
        occluded=[defect.vessel for defect in defects if defect.kind == "occlusion"],
        missing={defect.vessel for defect in defects if defect.kind == "missing"},
        bridges=[
            (d.vessel, d.other) for d in defects if d.kind == "bridge" and d.other is not None
        ],
    )


def _margin(case: Inspection) -> float:
    """How far free space may lie from the designed wall without being a leak, mm."""
    usual = np.abs(case.deviation_mm[case.segmentation.seen])
    return 2 * _step(case) + (float(np.percentile(usual, 99)) if len(usual) else 0.0)


def _wall(case: Inspection) -> float:
    """How far the scanned walls usually lie from the design's, mm, robustly."""
    usual = np.abs(case.deviation_mm[case.segmentation.seen])
    return 1.4826 * float(np.median(usual)) if len(usual) else 0.0


def _step(case: Inspection) -> float:
    """Edge of the grid's voxels, mm: an eighth of the thinnest lumen is enough to tell it whole."""
    voxel = float(case.segmentation.field.voxel_mm.min())
    return max(voxel, float(case.network.radius.min()) / 4)


def _grid(case: Inspection, margin: float) -> LumenGrid:
    network, reach = case.network, max(LUMEN_REACH_MM, 2 * margin)
    bounds = case.surface.bounds
    if case.is_lumen:
        around = network.radius.max() + reach
        bounds = np.stack(
            [network.points.min(axis=0) - around, network.points.max(axis=0) + around]
        )
    else:
        reach = 2 * margin
    field, fit = case.segmentation.field, case.alignment.scaled
    return lay_grid(network, field, fit, bounds, _step(case), reach)
