"""Fit ink properties to a calibration print's widths, gaps and bridges, typed or from a picture.

Goes in: a pattern and its measured widths. Comes out: properties of the ink. Begin with `fit.py`.
"""

from printctl.calibration.widths.fit import GivenValues, fit_replies, fit_widths
from printctl.calibration.widths.picture_widths import (
    MeasuredPicture,
    PictureFacts,
    measure_picture,
)
from printctl.calibration.widths.result import (
    Answer,
    Change,
    Replies,
    Widths,
    typed_replies,
    typed_widths,
)

__all__ = [
    "Answer",
    "Change",
    "GivenValues",
    "MeasuredPicture",
    "PictureFacts",
    "Replies",
    "Widths",
    "fit_replies",
    "fit_widths",
    "measure_picture",
    "typed_replies",
    "typed_widths",
]
