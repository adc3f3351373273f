"""Ask a printer for its own settings, and hold them against a profile."""

from printctl.probing.ask import ask_settings
from printctl.probing.compare import Row, compare, corrected
from printctl.probing.settings import Settings, read_settings

__all__ = [
    "Row",
    "Settings",
    "ask_settings",
    "compare",
    "corrected",
    "read_settings",
]
