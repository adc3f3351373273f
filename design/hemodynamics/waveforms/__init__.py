"""Periodic flow and pressure waveforms."""

from design.hemodynamics.waveforms.read import read_waveform
from design.hemodynamics.waveforms.shapes import SHAPES, shape
from design.hemodynamics.waveforms.waveform import Constant, Sine, Tabulated, Waveform

__all__ = ["SHAPES", "Constant", "Sine", "Tabulated", "Waveform", "read_waveform", "shape"]
