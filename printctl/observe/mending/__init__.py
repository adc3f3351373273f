"""Patch a held print's gaps by inserted G-code, and check that it spares lumens and ink.

Goes in: a held print, gaps along its written paths, the voids of the design. Comes out: the lines
to insert, what they lay, and what stays unmended. Begin with `plan.py`.
"""

from printctl.observe.mending.check import MendCheck, check_mend
from printctl.observe.mending.errors import MendError
from printctl.observe.mending.gap import Gap, NotMended, gap_between
from printctl.observe.mending.held_print import HeldPrint
from printctl.observe.mending.mend import Mend
from printctl.observe.mending.options import MendOptions
from printctl.observe.mending.patch import Patch
from printctl.observe.mending.plan import plan_mend
from printctl.observe.mending.plan_and_check import checked_mend
from printctl.observe.mending.voids import Voids
from printctl.observe.mending.written_paths import WrittenPath, written_paths

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
