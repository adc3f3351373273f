"""Facts about printers, needles, syringes, inks and baths, each with its source."""

from firmware_profiles.errors import ProfileError
from firmware_profiles.load import load, shipped
from firmware_profiles.schema import Axes, Bath, Facts, Ink, Needle, Printer, Span, Syringe

__all__ = [
    "Axes",
    "Bath",
    "Facts",
    "Ink",
    "Needle",
    "Printer",
    "ProfileError",
    "Span",
    "Syringe",
    "load",
    "shipped",
]
