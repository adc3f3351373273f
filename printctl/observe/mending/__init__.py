"""Patch a held print's gaps by inserted G-code, and check that it spares lumens and ink.

Goes in: a held print, gaps along its written paths, the voids of the design. Comes out: the lines
to insert, what they lay, and what stays unmended. Begin with `plan.py`.
"""

from printctl.observe.mending.check import MendCheck, check_mend
from printctl.observe.mending.gap import Gap, NotMended, gap_between
from printctl.observe.mending.held_print import HeldPrint, MendError, WrittenPath, written_paths
from printctl.observe.mending.mend import Mend, MendOptions, Patch
from printctl.observe.mending.plan import checked_mend, plan_mend
from printctl.observe.mending.voids import Voids

__all__ = [
    "Gap",
    "HeldPrint",
    "Mend",
    "MendCheck",
    "MendError",
    "MendOptions",
    "NotMended",
    "Patch",
    "Voids",
    "WrittenPath",
    "check_mend",
    "checked_mend",
    "gap_between",
    "plan_mend",
    "written_paths",
]
