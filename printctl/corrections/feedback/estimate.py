"""Derive the compensation for the next print from several registered prints of one design."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from design.toolpath.correction import Corrections, Stretch
from kernels.arrays import FloatArray
from printctl.corrections.compensation import (
    CompensationFile,
    GainPart,
    NodePart,
    RadialPart,
    StretchPart,
    VesselPart,
    corrections_of_file,
)
from printctl.corrections.feedback.evidence import Print, Reading, readings, rebase_reading
from printctl.corrections.feedback.local import Local, NodeOffset, local_excess, node_offsets
from printctl.corrections.feedback.whole_part import (
    BIAS_VOXELS,
    NORMAL_95,
    Mean,
    Radial,
    Size,
    pool_prints,
    radial,
    size_of,
    without_size,
)
from printctl.errors import UsageError


@dataclass(frozen=True)
class Depth:
    """Decision on correcting z, with its reason.

    Attributes
    ----------
    corrected : bool
    said : str
        A sentence for the file and the report.
    """

    corrected: bool
    said: str


def depth_of(prints: Sequence[Print], standard: str | None) -> Depth:
    """Decide for prints that are pooled.

    In OCT, shrinkage in depth and an error of the refractive index look the same, however much
    depth there is to fit. That a scale was fitted is therefore no reason to correct it.

    Parameters
    ----------
    prints : sequence of Print
    standard : str or None
        The user's own word for what stands behind the depth, of scans that don't say.
    """
    bare = [p.name for p in prints if not p.found["measured_by"]["depth_standard"]]
    unfitted = [p.name for p in prints if not p.found["depth_scale_fitted"]]
    if bare and standard is None:
        return Depth(
            False,
            f"Depth (z) is left as it was: no depth standard stands behind the scan of {bare[0]}"
            f"{_more(bare)}, so its scale in depth may be the refractive index' or the scanner's. "
            "Calibrate with a step of known height (printctl calibrate oct, then register "
            "--oct-calibration), or name the standard (compensate --depth-standard).",
        )
    if unfitted:
        return Depth(
            False,
            f"Depth (z) is left as it was: too little depth was in view to fit its scale "
            f"({unfitted[0]}{_more(unfitted)}).",
        )
    what = "the scans' calibration" if not bare else f"the user's word: {standard}"
    return Depth(True, f"Depth (z) is corrected; its standard: {what}.")


def _more(names: Sequence[str]) -> str:
    return f" and {len(names) - 1} more" if len(names) > 1 else ""


LEAST_UM = 1.0
"""Smaller local corrections aren't written: a tenth of a usual printer's step."""


@dataclass(frozen=True)
class Choices:
    """User's choices in deriving a compensation.

    Attributes
    ----------
    gain : GainPart
        Of scale and radial offset, and of local corrections.
    depth_standard : str or None
        What stands behind the scans' depth, in the user's words, where the scans don't say it.
    bias : Mean or None, mm
        Of the scanner's diameters, measured on a phantom.
    without : frozenset of int
        Vessels that get no correction of their own and give none.
    local : bool
        Whether single vessels and nodes are corrected.
    """

    gain: GainPart = field(default_factory=GainPart)
    depth_standard: str | None = None
    bias: Mean | None = None
    without: frozenset[int] = frozenset()
    local: bool = True


def estimate(prints: Sequence[Print], choices: Choices | None = None) -> CompensationFile:
    """Pool prints of one design and decide what to correct.

    Raises
    ------
    UsageError
        When the prints aren't of one design and method.
    ToolpathError
        When a correction is beyond its limit.
    """
    choices = choices or Choices()
    check_alike(prints)
    choices = replace(choices, bias=known_bias(prints, choices.bias))
    depth = depth_of(prints, choices.depth_standard)
    _check_depth(prints, depth)
    voxel_mm = max(max(p.found["measured_by"]["voxel_um"]) for p in prints) * 1e-3
    sizes = [_size(print_, choices, voxel_mm) for print_ in prints]
    stretch, scales = _stretch(prints, sizes, depth, choices.gain.whole)
    bases = [print_.base for print_ in prints]
    read = [
        _read(print_, stretch, size, bases, choices.without)
        for print_, size in zip(prints, sizes, strict=True)
    ]
    if not any(read):
        raise UsageError(
            "no vessel's diameter could be used: none was measured outside defects; look at the "
            "report and scan again"
        )
    read = [one for one in read if one]
    common = radial(read, voxel_mm, choices.bias or unknown_bias(prints, voxel_mm))
    own = local_excess(read, common, voxel_mm) if choices.local else ()
    moved = node_offsets(prints[0].network, read, voxel_mm) if choices.local else ()
    made = CompensationFile(
        printctl_compensation=1,
        design=prints[0].design,
        made_with=prints[0].made_with,
        simulated=any(print_.simulated for print_ in prints),
        prints=tuple(print_.facts for print_ in prints),
        gain=choices.gain,
        stretch=stretch_part(stretch, depth),
        radial=_radial_part(prints, common, choices.gain.whole),
        vessels=_vessel_parts(prints, own, choices.gain.local),
        nodes=_node_parts(prints, moved, choices.gain.local, depth),
        evidence=_evidence(scales, common, own, moved, choices),
        notes=_notes(prints, depth, common, choices),
    )
    corrections_of_file(made).check(prints[0].network)
    return made


def unknown_bias(prints: Sequence[Print], voxel_mm: float) -> Mean:
    """Return what the diameters of scans may share, by the type B terms of their budgets, mm.

    Scans of one device share it, so it isn't averaged: the widest print's, the median of its
    vessels.
    """
    halves = []
    for print_ in prints:
        rows = [row["budget"] for row in print_.found["vessels"] if row.get("budget")]
        known = [terms for terms in rows if all(t["standard"] is not None for t in terms)]
        shared = [
            math.hypot(*(t["standard"] for t in terms if t["type"] == "B")) for terms in known
        ]
        half = NORMAL_95 * 1e-3 * statistics.median(shared) if shared else BIAS_VOXELS * voxel_mm
        halves.append(half)
    return Mean(0.0, max(halves))


def known_bias(prints: Sequence[Print], given: Mean | None) -> Mean | None:
    """Of diameters, mm: as given, or of scans whose walls a reference has put right.

    None where it isn't given and any of the scans was registered without one.

    Raises
    ------
    UsageError
        When it would be taken off twice.
    """
    walls = [print_.found.get("walls") for print_ in prints]
    if given is not None:
        if any(walls):
            raise UsageError(
                "--diameter-bias-um and the scans' reference (register --oct-calibration) would "
                "both take the scanner's bias off; leave --diameter-bias-um out"
            )
        return given
    if any(one is None for one in walls):
        return None
    return Mean(0.0, 2e-3 * max(one["interval_um"] for one in walls if one is not None))


def _check_depth(prints: Sequence[Print], depth: Depth) -> None:
    """Refuse prints of different sizes in depth, of which no scan can tell which was right.

    Raises
    ------
    UsageError
    """
    first = prints[0]
    size = first.base.stretch.factor[2]
    other = next((p for p in prints if p.base.stretch.factor[2] != size), None)
    if other is not None and not depth.corrected:
        raise UsageError(
            f"{first.name} was written {size:.4f} times as high as designed, {other.name} "
            f"{other.base.stretch.factor[2]:.4f} times, and it can't be told which was right. "
            f"{depth.said} Or pool only prints that were made with the same compensation."
        )


def check_alike(prints: Sequence[Print]) -> None:
    """Refuse to pool what doesn't belong together.

    Raises
    ------
    UsageError
    """
    first = prints[0]
    seen: dict[str | None, str] = {}
    for print_ in prints:
        if print_.design != first.design:
            raise UsageError(
                f"{print_.name} isn't a print of {first.name}'s design (network or solid differ); "
                "pool prints of one design only"
            )
        if print_.made_with != first.made_with:
            raise UsageError(
                f"{print_.name} was made otherwise than {first.name} ({print_.made_with!r} against "
                f"{first.made_with!r}); each set-up has a compensation of its own"
            )
        for digest in {print_.facts.scan_sha256, print_.facts.registration_sha256} - {None}:
            if digest in seen:
                raise UsageError(
                    f"{print_.name} and {seen[digest]} hold the same scan; one print counts once"
                )
            seen[digest] = print_.name


def _about(print_: Print) -> FloatArray:
    """What stays in place: the part's middle, at the height of its foot, (3,), mm."""
    low, high = np.array(print_.design.bounds_mm)
    return np.append((low + high)[:2] / 2, low[2])


def _size(print_: Print, choices: Choices, voxel_mm: float) -> Size:
    per_vessel = readings(print_, print_.base.stretch, whole_changes=True)
    kept = {vessel: one for vessel, one in per_vessel.items() if vessel not in choices.without}
    return size_of(print_, kept, np.array(print_.design.bounds_mm).mean(axis=0), voxel_mm)


def _stretch(
    prints: Sequence[Print], sizes: Sequence[Size], depth: Depth, gain: float
) -> tuple[Stretch, dict[str, dict[str, Any]]]:
    """What the next print is stretched by, and the evidence of each axis."""
    factor, evidence = [], {}
    for axis, name in enumerate("xyz"):
        bases = [float(np.log(p.base.stretch.factor[axis])) for p in prints]
        base = float(np.mean(bases))
        # Of prints made with different compensations: as if all had been made with their mean.
        size = [
            float(np.log(one.scale[axis])) - own + base
            for one, own in zip(sizes, bases, strict=True)
        ]
        mean = pool_prints(size, [float(one.half[axis]) for one in sizes])
        asked = axis < 2 or depth.corrected
        applied = asked and mean.is_real
        factor.append(round(float(np.exp(base - gain * mean.value * applied)), 6))
        evidence[name] = {
            "size": round(float(np.exp(mean.value)), 6),
            "interval_95": round(mean.half, 6),
            "corrected": applied,
            "by": "lumens" if all(one.by_lumens[axis] for one in sizes) else "surface",
        }
    x, y, z = _about(prints[0]).tolist()
    return Stretch((factor[0], factor[1], factor[2]), (x, y, z)), evidence


def stretch_part(stretch: Stretch, depth: Depth) -> StretchPart:
    """As the file holds it."""
    return StretchPart(factor=stretch.factor, about_mm=stretch.about_mm, depth=depth.said)


def _read(
    print_: Print,
    stretch: Stretch,
    size: Size,
    bases: Sequence[Corrections],
    without: frozenset[int],
) -> dict[int, Reading]:
    """A print's readings, as if it had been made with the mean of all prints' corrections.

    Of the axes' offsets what the print's size explains is taken out.
    """
    per_vessel = readings(print_, stretch, whole_changes=len(bases) > 1)
    middle = np.array(print_.design.bounds_mm).mean(axis=0)
    return {
        vessel: rebase_reading(without_size(reading, print_, size, middle), print_, bases)
        for vessel, reading in per_vessel.items()
        if vessel not in without
    }


def _radial_part(prints: Sequence[Print], common: Radial, gain: float) -> RadialPart:
    """The bases' offset at the new reference, less what is real of the new excess' half."""
    ends = np.array([common.at_mm])
    offset = float(np.mean([p.base.radial(ends)[0] for p in prints]))
    slope = float(np.mean([p.base.radial_slope for p in prints]))
    more, steeper = common.corrected
    offset -= gain * more / 2
    slope -= gain * steeper / 2
    low, high = common.range_mm
    return RadialPart(
        offset_um=round(1e3 * offset, 1) + 0.0,
        slope_um_per_mm=round(1e3 * slope, 2) + 0.0,
        at_mm=round(common.at_mm, 4),
        from_mm=round(low, 4),
        to_mm=round(high, 4),
    )


def _vessel_parts(
    prints: Sequence[Print], own: Sequence[Local], gain: float
) -> tuple[VesselPart, ...]:
    change = {v: 0.0 for p in prints for v in p.base.diameter_mm}
    for vessel in change:
        change[vessel] = float(np.mean([p.base.diameter_mm.get(vessel, 0.0) for p in prints]))
    for one in own:
        if one.kept:
            change[one.vessel] = change.get(one.vessel, 0.0) - gain * one.kept * one.excess_mm
    return tuple(
        VesselPart(vessel=vessel, diameter_um=round(1e3 * change[vessel], 1))
        for vessel in sorted(change)
        if abs(change[vessel]) >= 1e-3 * LEAST_UM
    )


def _node_parts(
    prints: Sequence[Print], moved: Sequence[NodeOffset], gain: float, depth: Depth
) -> tuple[NodePart, ...]:
    nodes = sorted({n for p in prints for n in p.base.offset_mm} | {one.node for one in moved})
    change = {
        node: np.mean([p.base.offset_mm.get(node, (0.0, 0.0, 0.0)) for p in prints], axis=0)
        for node in nodes
    }
    for one in moved:
        real = np.abs(one.offset_mm) > one.half_mm
        # A shift in depth that grows with height is the depth's scale by another name.
        real[2] &= depth.corrected
        change[one.node] = change[one.node] - gain * np.where(real, one.offset_mm, 0.0)
    parts = []
    for node in nodes:
        if np.linalg.norm(change[node]) >= 1e-3 * LEAST_UM:
            x, y, z = (round(1e3 * float(v), 1) + 0.0 for v in change[node])
            parts.append(NodePart(node=node, offset_um=(x, y, z)))
    return tuple(parts)


def _evidence(
    scales: dict[str, dict[str, Any]],
    common: Radial,
    own: Sequence[Local],
    moved: Sequence[NodeOffset],
    choices: Choices,
) -> dict[str, Any]:
    """What was measured, with its 95 % interval, and whether it was corrected."""
    return {
        "scale": scales,
        "diameter": {
            "excess_um": round(1e3 * common.offset.value, 2),
            "interval_95_um": round(1e3 * common.offset.half, 2),
            "corrected": common.is_real,
            "at_mm": round(common.at_mm, 4),
            "slope_um_per_mm": round(1e3 * common.slope.value, 2),
            "slope_interval_95": round(1e3 * common.slope.half, 2),
            "slope_corrected": common.is_real and common.slope.is_real,
            "bias_known": choices.bias is not None,
        },
        "vessels": [
            {
                "vessel": one.vessel,
                "excess_um": round(1e3 * one.excess_mm, 2),
                "interval_95_um": round(1e3 * one.half_mm, 2),
                "kept": round(one.kept, 3),
            }
            for one in own
        ],
        "nodes": [
            {
                "node": one.node,
                "offset_um": [round(1e3 * float(v), 2) for v in one.offset_mm],
                "interval_95_um": [round(1e3 * float(v), 2) for v in one.half_mm],
            }
            for one in moved
        ],
    }


def _notes(
    prints: Sequence[Print], depth: Depth, common: Radial, choices: Choices
) -> tuple[str, ...]:
    notes = [depth.said]
    if len(prints) == 1:
        notes.append(
            "One print: what differs from print to print can't be told from what repeats, so that "
            "local corrections may follow chance; pool several prints."
        )
    if choices.bias is None:
        notes.append(
            "The scanner's bias of diameters is known by its budget alone (walls, reflections, "
            "index, voxel size): a radial offset is corrected only where "
            f"it exceeds {1e3 * common.offset.half / 2:.0f} um. Measure it on a reference "
            "(calibrate oct --reference) and give register --oct-calibration, or "
            "--diameter-bias-um."
        )
    if common.is_real and not depth.corrected:
        notes.append(
            "Depth isn't known here, and a diameter holds half of its error: 1 % of depth is 0.5 % "
            "of a level lumen's diameter, and was corrected as radius."
        )
    if choices.without:
        notes.append(f"Left out by choice: vessels {', '.join(map(str, sorted(choices.without)))}.")
    if any(row.get("local", True) for print_ in prints for row in print_.found["defects"]):
        notes.append("Defects aren't corrected; their places were left out of what was measured.")
    return tuple(notes)
