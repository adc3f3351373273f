"""Query a printer's settings and compare them with its profile."""

from printctl.probing.compare import Row, compare, corrected_profile
from printctl.probing.queries import query_settings
from printctl.probing.settings import Settings, read_settings

__all__ = [
    "Row",
    "Settings",
    "compare",
    "corrected_profile",
    "query_settings",
    "read_settings",
]
