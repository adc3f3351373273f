"""Compare a scan with its G-code by layer: coverage of lines, gaps, misplaced gel, status.

Goes in: a scan, its pose and a G-code job. Comes out: the numbers of each layer. Begin with
`measure.py`.
"""

from registration.overlay.cut import Cutter, ScanCut
from registration.overlay.measure import (
    LayerNumbers,
    LayerStatus,
    Limits,
    OverlayLayer,
    OverlaySpot,
    measure_layer,
    overlay_csv,
    overlay_dict,
    reached,
    statuses,
)
from registration.overlay.pose import Pose, align_pose, read_pose
from registration.overlay.raster import LayerLines, LumenSections, Raster, layers_of

__all__ = [
    "Cutter",
    "LayerLines",
    "LayerNumbers",
    "LayerStatus",
    "Limits",
    "LumenSections",
    "OverlayLayer",
    "OverlaySpot",
    "Pose",
    "Raster",
    "ScanCut",
    "align_pose",
    "layers_of",
    "measure_layer",
    "overlay_csv",
    "overlay_dict",
    "reached",
    "read_pose",
    "statuses",
]
