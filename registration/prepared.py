"""Segment a scan and prepare the model's surface for alignment; check that they match."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from design.network import VesselNetwork
from design.solids.solid import Solid
from kernels import keep_freed_memory
from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors, scan_errors
from registration.errors import RegistrationError
from registration.options import RegistrationOptions, segmentation_options
from registration.scan import Scan
from registration.segmentation import Segmentation, segment

LARGEST_FIELD = 20.0
"""Of the part's longest edge: a field of view larger than that each way shows something else."""


@dataclass(frozen=True)
class PreparedScan:
    """What every step behind the segmentation takes; build with `of`.

    Attributes
    ----------
    scan : Scan
    model : Solid
    network : VesselNetwork
    options : RegistrationOptions
    segmentation : Segmentation
        Of the scan.
    surface : ModelSurface
        Of the model.
    is_lumen : bool
        The model is the lumens, not the gel around them.
    errors : ScanErrors
        What all measurements of the scan share.
    section_mm : float, mm
        Between sections along a vessel.
    """

    scan: Scan
    model: Solid
    network: VesselNetwork
    options: RegistrationOptions
    segmentation: Segmentation
    surface: ModelSurface
    is_lumen: bool
    errors: ScanErrors
    section_mm: float

    @staticmethod
    def of(
        scan: Scan, model: Solid, network: VesselNetwork, options: RegistrationOptions
    ) -> PreparedScan:
        """Segment the scan, and see what the model is.

        Raises
        ------
        RegistrationError
            When the scan can't be segmented, or scan, model and network don't belong together.
        """
        thinnest = 2 * float(network.radius.min())
        _check_sizes(scan, model, thinnest)
        # The surface takes one core, and the segmentation leaves one free now and then.
        with ThreadPoolExecutor(1) as other, keep_freed_memory():
            preparing = other.submit(ModelSurface.of, model)
            # An OCT needn't know what the model is: its surface is prepared meanwhile.
            whole = scan.modality != "oct" and not _model_is_lumen(preparing.result(), network)
            how = replace(segmentation_options(scan, options, thinnest), whole_part=whole)
            segmentation = segment(scan, how)
        errors = scan_errors(scan, segmentation)
        surface = preparing.result()
        is_lumen = _model_is_lumen(surface, network)
        section_mm = options.section_mm or thinnest / 4
        return PreparedScan(
            scan, model, network, options, segmentation, surface, is_lumen, errors, section_mm
        )


def _check_sizes(scan: Scan, model: Solid, thinnest_mm: float) -> None:
    """Refuse a scan in which no lumen has room, or the part is lost: a wrong unit."""
    if scan.volume.ndim != 3:
        return  # no stack: the segmentation says so
    extent = np.array(scan.volume.shape)[::-1] * np.array(scan.geometric_voxel_mm)[::-1]
    part = np.ptp(model.vertices, axis=0)
    if thinnest_mm <= extent.max() and extent.min() <= LARGEST_FIELD * part.max():
        return
    raise RegistrationError(
        f"the scan is {_sizes(extent)} mm and the model {_sizes(part)} mm, with lumens from "
        f"{thinnest_mm:.3g} mm: they don't fit each other; check the voxel size (--voxel-um, "
        "or scan.voxel_um in a recipe; µm) and the units of model and network"
    )


def _sizes(size: FloatArray) -> str:
    return " × ".join(f"{one:.3g}" for one in size)


def _model_is_lumen(surface: ModelSurface, network: VesselNetwork) -> bool:
    """Whether the vessels' axes lie inside the model."""
    start, end, _, _, _ = network.pieces()
    inside = float((surface.query((start + end) / 2).distance < 0).mean())
    if 0.1 < inside < 0.9:
        raise RegistrationError(
            f"{100 * inside:.0f} % of the network's axes lie inside the model: it is neither "
            "lumen (nearly all inside) nor construct (nearly none); give model and network of the "
            "same design, in the same frame"
        )
    return inside >= 0.9
