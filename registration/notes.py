"""Notes on a registration's limits: pose, depth scale, unseen parts, contrast, wall offset."""

from __future__ import annotations

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment import AXES, Alignment
from registration.alignment.uncertainty import LEAST_STEP, MOST_UNEVEN, ROOT_TWO_PI
from registration.measuring.gauging import ContrastGauge, VesselGauge
from registration.scan import Scan
from registration.segmentation import GelField, Strength
from registration.wall_reference import WallCalibration

LEAST_EXAMINED = 0.98
"""Of the gel; less is said."""
TOLD_UNEVEN = 0.03
"""Even gel's is at most 0.015 on scans of three generators."""
FAR_END_MM = 0.3
"""Longest stretch at a vessel's end without diameters that no note is made of."""


def pose_notes(scan: Scan, alignment: Alignment) -> list[str]:
    """Notes on what the pose and its scales rest on."""
    notes = []
    notes += [f"Pose not sure: {doubt}" for doubt in alignment.doubts]
    if not alignment.lay.startswith("upright"):
        notes.append(
            f"The part lay {alignment.lay}. Depth is its {AXES[alignment.depth_axis]} axis."
        )
    if scan.handedness == "unknown" and any(r.mirrored and r.same for r in alignment.rivals):
        notes.append(
            "The design is its own mirror image and the file doesn't say how its axes lie in "
            "space: were the scan mirrored, vessels would have changed sides and nothing would "
            "show it. Check one vessel's side, or give --mirrored or --not-mirrored."
        )
    if not alignment.depth_fitted:
        notes.append(
            "Depth scale not fitted: less than 2 mm of depth in view and light, so it can't be "
            "told from an error of the refractive index."
        )
    elif scan.optical_depth and not scan.depth_standard:
        notes.append(
            f"Depth scale rests on the refractive index {scan.refractive_index:g} of the scan: "
            "shrinkage in depth and an error of the index look the same."
        )
    if alignment.depth_fitted and not scan.depth_standard and scan.modality == "oct":
        scale, interval = alignment.scaled.scale, alignment.uncertainty.scale
        notes += depth_notes(scale, interval, alignment.depth_axis, scan.refractive_index)
    return notes


def depth_notes(scale: FloatArray, interval: FloatArray, depth: int, index: float) -> list[str]:
    """Say where depth is scaled by more than the axes across the light and their intervals.

    Parameters
    ----------
    scale, interval : (3,) float64
        Print over design along the part's axes, and half widths of their 95 % intervals.
    depth : int
        The axis along the light.
    index : float
        Refractive index that depth was read with.
    """
    across = float(np.delete(scale, depth).mean())
    apart = float(scale[depth]) / across - 1
    if not abs(apart) > interval[depth]:
        return []
    return [
        f"In depth the print is {100 * abs(apart):.1f} % {'longer' if apart > 0 else 'shorter'} "
        f"than across (95 %: ± {100 * interval[depth]:.1f} %), by its design. Either it really is, "
        f"or the scan's depth is off (a refractive index of {index * (1 + apart):.3f} in place of "
        f"{index:.3f} would do it): scan a depth standard (printctl calibrate oct)."
    ]


def sight_notes(vessels: tuple[VesselGauge, ...], seen: float) -> list[str]:
    """What is closed, and what wasn't seen; `seen` is the share of the surface that was."""
    notes = []
    if seen < 0.98:
        notes.append(f"{100 * (1 - seen):.0f} % of the surface lies where light failed; left out.")
    closed = [str(vessel.vessel) for vessel in vessels if vessel.open is False]
    unseen = [str(vessel.vessel) for vessel in vessels if vessel.seen_fraction == 0]
    partly = [
        f"{vessel.vessel} ({100 * vessel.seen_fraction:.0f} %)"
        for vessel in vessels
        if 0 < vessel.seen_fraction < 1
    ]
    bare = [str(v.vessel) for v in vessels if v.seen_fraction > 0 and v.sections == 0]
    if closed:
        notes.append(f"Closed vessels: {', '.join(closed)}.")
    if unseen:
        notes.append(f"Vessels not seen, neither open nor closed: {', '.join(unseen)}.")
    if partly:
        notes.append(
            f"Vessels seen in part, of which the rest is neither open nor closed: "
            f"{', '.join(partly)}."
        )
    if bare:
        notes.append(
            f"No section could be measured in vessels {', '.join(bare)}: where they pass, it is by "
            "being open, whatever their diameters are."
        )
    return notes + _end_notes(vessels)


def _end_notes(vessels: tuple[VesselGauge, ...]) -> list[str]:
    """Return how far from a vessel's end its diameters begin, where that is far."""
    ends = {
        one.vessel: max(one.along_mm[0], one.length_mm - one.along_mm[-1])
        for one in vessels
        if len(one.along_mm)
    }
    vessel = max(ends, key=lambda number: ends[number], default=-1)
    if vessel < 0 or ends[vessel] <= FAR_END_MM:
        return []
    return [
        f"Diameters begin up to {ends[vessel]:.2f} mm from a vessel's end (vessel {vessel}): "
        "nearer to a junction or a face less than half of a section's wall lies in the gel."
    ]


def contrast_notes(contrast: ContrastGauge) -> list[str]:
    """Where gel and liquid can't be told apart, what that leaves open and what would help."""
    notes, level = [], f"(evidence in liquid {contrast.liquid:.2f} of the gel's)"
    if contrast.untold > 0:
        notes.append(
            f"In {100 * contrast.untold:.0f} % of the sections in view gel can't be told from "
            f"liquid {level}: they are called neither open nor closed. A liquid that scatters "
            "less, or the mean of several scans, tells more."
        )
    if contrast.examined < LEAST_EXAMINED:
        notes.append(
            f"Leaks and bridges were looked for in {100 * contrast.examined:.0f} % of the gel "
            f"{level}; in the rest of it none could be told from chance."
        )
    if contrast.unresolved:
        many = "1 place lacks" if contrast.unresolved == 1 else f"{contrast.unresolved} places lack"
        notes.append(
            f"{many} gel as a narrow leak does, but no opening runs through as far as this scan "
            "resolves: voids between printed lines look the same. Scan with smaller voxels to tell."
        )
    return notes


def step_notes(strength: Strength | None) -> list[str]:
    """Whether liquid is too bright for diameters to have intervals."""
    if strength is None or 1 - strength.dark >= LEAST_STEP:
        return []
    return [
        f"Gel is {1 / strength.dark:.1f} times as bright as the liquid (needed: "
        f"{1 / (1 - LEAST_STEP):g}), noise and haze included: errors of walls aren't known, so no "
        "diameter has an interval, none is proven, and no place of the surface is given a "
        "deviation. A liquid that scatters less tells more."
    ]


def uneven_notes(field: GelField) -> list[str]:
    """Whether the gel's own brightness is so uneven that walls move by it."""
    if field.uneven < TOLD_UNEVEN:
        return []
    text = (
        f"The gel's own brightness is uneven by ± {100 * field.uneven:.0f} % (standard deviation "
        "beyond speckle; layers of birefringent or of two gels and shadows do that)"
    )
    if field.uneven > MOST_UNEVEN:
        return [
            f"{text}, more than {100 * MOST_UNEVEN:.0f} %: errors of walls aren't known, so no "
            "diameter has an interval, none is proven, and no place of the surface is given a "
            "deviation. Scan with light of changing polarisation, or another gel."
        ]
    moved = 1e3 * ROOT_TWO_PI * field.blur_mm * field.uneven / 2
    return [f"{text}: it moves walls by ± {moved:.0f} µm, which their intervals hold."]


def wall_notes(walls: WallCalibration | None, vessels: tuple[VesselGauge, ...]) -> list[str]:
    """What was taken out of the walls, and for which vessels nobody has shown that it holds."""
    if walls is None:
        return []
    of = f" of {walls.material}" if walls.material else ""
    notes = [
        f"Walls were moved {walls.offset_um:+.1f} µm into the gel, the offset of a reference{of} "
        f"(± {walls.interval_um:.1f} µm; every diameter shares that error twice)."
    ]
    if walls.scans == 1:
        notes.append(
            "The reference was scanned once: what differs from scan to scan isn't in its interval, "
            "which holds for that scan alone."
        )
    beyond = [
        str(vessel.vessel)
        for vessel in vessels
        if not 0.8 * walls.from_um <= vessel.designed_um <= 1.25 * walls.to_um
    ]
    if beyond:
        notes.append(
            f"The reference's lumens were {walls.from_um:.0f} to {walls.to_um:.0f} µm wide; of "
            f"vessels {', '.join(beyond)} that offset isn't known."
        )
    return notes
