"""Periodic waveforms of flow or pressure: constant, sine, samples; from names or CSV files.

Goes in: a name, or a CSV file. Comes out: a periodic waveform. Begin with `waveform.py`.
"""

from design.hemodynamics.waveforms.read import read_waveform
from design.hemodynamics.waveforms.shapes import SHAPES, shape
from design.hemodynamics.waveforms.waveform import Constant, Sine, Tabulated, Waveform

__all__ = ["SHAPES", "Constant", "Sine", "Tabulated", "Waveform", "read_waveform", "shape"]
