"""Segment scans: from a scanned volume to the gel field and the surface of gel.

Goes in: a `Scan`. Comes out: a surface mesh, and a field of gel. Begin with `segment.py`.
"""

from registration.segmentation.evidence import GelEvidence, are_separable, gel_evidence
from registration.segmentation.segment import Segmentation, SegmentationOptions, segment
from registration.segmentation.volume import GelField, Strength

__all__ = [
    "GelEvidence",
    "GelField",
    "Segmentation",
    "SegmentationOptions",
    "Strength",
    "are_separable",
    "gel_evidence",
    "segment",
]
