"""Compare a scan with its G-code by layer: coverage of lines, gaps, misplaced gel, status.

Goes in: a scan, its pose and a G-code job. Comes out: the numbers of each layer. Begin with
`measure.py`.
"""

from registration.overlay.cut import Cutter, ScanCut
from registration.overlay.lines import LayerLines, layers_of
from registration.overlay.lumens import LumenSections
from registration.overlay.measure import LayerNumbers, Limits, measure_layer
from registration.overlay.patches import PixelPatch
from registration.overlay.pose import Pose, align_pose, read_pose
from registration.overlay.raster import Raster
from registration.overlay.results import overlay_csv, overlay_dict
from registration.overlay.status import LayerStatus, reached, statuses

__all__ = [
    "Cutter",
    "LayerLines",
    "LayerNumbers",
    "LayerStatus",
    "Limits",
    "LumenSections",
    "PixelPatch",
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
