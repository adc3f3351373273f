"""Query a printer's settings and compare them with its profile.

Goes in: a port and a profile. Comes out: a row for each setting that differs. Begin with
`compare.py`.
"""

from printctl.machine.probing.compare import Row, compare, corrected_profile
from printctl.machine.probing.queries import query_settings
from printctl.machine.probing.settings import Settings, read_settings

__all__ = [
    "Row",
    "Settings",
    "compare",
    "corrected_profile",
    "query_settings",
    "read_settings",
]
