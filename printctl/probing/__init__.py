"""Query a printer's settings and compare them with its profile."""

from printctl.probing.compare import Row, compare, corrected_profile
from printctl.probing.queries import ask_settings
from printctl.probing.settings import Settings, read_settings

__all__ = [
    "Row",
    "Settings",
    "ask_settings",
    "compare",
    "corrected_profile",
    "read_settings",
]
