"""Align a scan's surface points with the model: pose, intervals, alternative poses, doubts.

Goes in: surface points and a model. Comes out: a pose with intervals and doubts. Begin with
`align.py`.
"""

from registration.alignment.align import Alignment, align
from registration.alignment.cross_check import cross_check
from registration.alignment.doubts import LEAST_SEEN, later_doubts, rival_doubts
from registration.alignment.fit import Fit
from registration.alignment.intervals import Uncertainty
from registration.alignment.rivals import AXES, AlternativePose
from registration.alignment.search import AlignmentOptions

__all__ = [
    "AXES",
    "LEAST_SEEN",
    "Alignment",
    "AlignmentOptions",
    "AlternativePose",
    "Fit",
    "Uncertainty",
    "align",
    "cross_check",
    "later_doubts",
    "rival_doubts",
]
