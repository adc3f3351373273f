"""Facts about printers, needles, syringes, inks, baths and dishes, each with its source."""

from firmware_profiles.cross_checks import Doubt, doubts
from firmware_profiles.errors import ProfileError
from firmware_profiles.load import load, read_keys, shipped
from firmware_profiles.schema import Axes, Bath, Dish, Facts, Ink, Needle, Printer, Span, Syringe

__all__ = [
    "Axes",
    "Bath",
    "Dish",
    "Doubt",
    "Facts",
    "Ink",
    "Needle",
    "Printer",
    "ProfileError",
    "Span",
    "Syringe",
    "doubts",
    "load",
    "read_keys",
    "shipped",
]
