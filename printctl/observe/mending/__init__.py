"""Patch a held print's gaps by inserted G-code, and check that it spares lumens and ink.

Goes in: a held print, gaps along its written paths, the voids of the design. Comes out: the lines
to insert, what they lay, and what stays unmended. Begin with `plan.py`.
"""

from printctl.observe.mending.check import check_mend
from printctl.observe.mending.held_print import (
    HeldPrint,
    MendError,
    Style,
    WrittenPath,
    written_paths,
)
from printctl.observe.mending.laid_ink import Gap
from printctl.observe.mending.obstacles import Voids
from printctl.observe.mending.plan import Mend, checked_mend, plan_mend

__all__ = [
    "Gap",
    "HeldPrint",
    "Mend",
    "MendError",
    "Style",
    "Voids",
    "WrittenPath",
    "check_mend",
    "checked_mend",
    "plan_mend",
    "written_paths",
]
