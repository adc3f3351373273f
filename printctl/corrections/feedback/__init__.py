"""Compensation workflow: derive a correction file from registered prints for the next print.

Goes in: folders of registered prints. Comes out: a compensation. Begin with `estimate.py`.
"""

from printctl.corrections.feedback.estimate import Choices, estimate
from printctl.corrections.feedback.evidence import NO_ORIGIN, Print, keep_origin, read_print
from printctl.corrections.feedback.whole_part import Mean

__all__ = [
    "NO_ORIGIN",
    "Choices",
    "Mean",
    "Print",
    "estimate",
    "keep_origin",
    "read_print",
]
