"""Fit ink properties to a calibration print's widths, gaps and bridges, typed or from a picture.

Goes in: a pattern and its measured widths. Comes out: properties of the ink. Begin with `fit.py`.
"""

from printctl.calibration.widths.fit import fit_measured
from printctl.calibration.widths.one_width import GivenValues
from printctl.calibration.widths.picture_widths import (
    MeasuredPicture,
    PictureFacts,
    measure_picture,
)
from printctl.calibration.widths.result import (
    Replies,
    Widths,
    read_sheet,
)

__all__ = [
    "GivenValues",
    "MeasuredPicture",
    "PictureFacts",
    "Replies",
    "Widths",
    "fit_measured",
    "measure_picture",
    "read_sheet",
]
