"""Segmentation: from a scanned volume to the surface between gel and lumen."""

from registration.segmentation.evidence import GelEvidence, gel_evidence, told_apart
from registration.segmentation.segment import Segmentation, SegmentationOptions, segment
from registration.segmentation.volume import GelField, Strength

__all__ = [
    "GelEvidence",
    "GelField",
    "Segmentation",
    "SegmentationOptions",
    "Strength",
    "gel_evidence",
    "segment",
    "told_apart",
]
