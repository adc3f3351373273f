"""Checked YAML profiles of printers, tools, inks, baths, dishes; firmware rules and protocols.

Goes in: a profile's name or a file. Comes out: a frozen model of it, checked. Begin with
`load.py`.
"""

from firmware_profiles.cross_checks import profile_doubts
from firmware_profiles.dispensers import (
    PRESSURE_SETTLES_S,
    MeasuredFlow,
    Plunger,
    Pneumatic,
    SteadyFlow,
    steady_flow,
)
from firmware_profiles.errors import ProfileError
from firmware_profiles.file_controller import FileController
from firmware_profiles.heads import MOST_HEADS, Head, Offset
from firmware_profiles.load import load, shipped, shipped_text
from firmware_profiles.materials.inks_and_baths import (
    Bath,
    Ink,
    supported_diameter_mm,
    weight_in_bath_n_m3,
)
from firmware_profiles.materials.rheology import (
    flow_ul_s,
    pressure_pa,
    wall_stress_pa,
    yield_pressure_pa,
)
from firmware_profiles.plates import Dish, Plate
from firmware_profiles.printers import Axes, Printer, WatchedGauge
from firmware_profiles.sorts import PROFILE_SORTS, find_profile
from firmware_profiles.strict_model import Facts, Span
from firmware_profiles.tools import Needle, Syringe

__all__ = [
    "MOST_HEADS",
    "PRESSURE_SETTLES_S",
    "PROFILE_SORTS",
    "Axes",
    "Bath",
    "Dish",
    "Facts",
    "FileController",
    "Head",
    "Ink",
    "MeasuredFlow",
    "Needle",
    "Offset",
    "Plate",
    "Plunger",
    "Pneumatic",
    "Printer",
    "ProfileError",
    "Span",
    "SteadyFlow",
    "Syringe",
    "WatchedGauge",
    "find_profile",
    "flow_ul_s",
    "load",
    "pressure_pa",
    "profile_doubts",
    "shipped",
    "shipped_text",
    "steady_flow",
    "supported_diameter_mm",
    "wall_stress_pa",
    "weight_in_bath_n_m3",
    "yield_pressure_pa",
]
