"""From a scanned volume to the surface between gel and lumen."""

from registration.segmentation.segment import Segmentation, SegmentationOptions, segment
from registration.segmentation.volume import GelField

__all__ = ["GelField", "Segmentation", "SegmentationOptions", "segment"]
