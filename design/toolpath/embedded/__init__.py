"""Plan embedded writing: ink filaments along the vessels' centrelines inside a bath.

Goes in: a network and a needle. Comes out: a `Toolpath` and a report. Begin with `plan.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.toolpath.embedded.bundles import Bundles, bundled
    from design.toolpath.embedded.needle import EmbeddedHeads, check_thinnest, check_vessels
    from design.toolpath.embedded.options import EmbeddedOptions
    from design.toolpath.embedded.plan import EmbeddedPlan, plan_embedded
    from design.toolpath.embedded.report import Crossing, EmbeddedReport, Merged

__all__ = [
    "Bundles",
    "Crossing",
    "EmbeddedHeads",
    "EmbeddedOptions",
    "EmbeddedPlan",
    "EmbeddedReport",
    "Merged",
    "bundled",
    "check_thinnest",
    "check_vessels",
    "plan_embedded",
]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
