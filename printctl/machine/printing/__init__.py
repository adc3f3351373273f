"""Start, find and follow prints: progress, remaining time, syringe changes, recovery.

Goes in: a print order. Comes out: a client of its link process, and its progress. Begin with
`find.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.machine.printing.find import Order, find_or_start, finished, running
    from printctl.machine.printing.simulated import SIMULATED, simulated_printer
    from printctl.machine.printing.syringes import (
        capacity_mm,
        usable_mm,
        with_reloads,
        with_reloads_of,
    )
    from printctl.machine.printing.watch import confirm, follow, retreat_for

__all__ = [
    "SIMULATED",
    "Order",
    "capacity_mm",
    "confirm",
    "find_or_start",
    "finished",
    "follow",
    "retreat_for",
    "running",
    "simulated_printer",
    "usable_mm",
    "with_reloads",
    "with_reloads_of",
]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
