"""Plan embedded writing: ink filaments along the vessels' centrelines inside a bath.

Goes in: a network and a needle. Comes out: a `Toolpath` and a report. Begin with `plan.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.toolpath.embedded.bundles import Bundles, bundled
    from design.toolpath.embedded.needle import EmbeddedHeads, check_thinnest
    from design.toolpath.embedded.options import EmbeddedOptions
    from design.toolpath.embedded.plan import plan_embedded
    from design.toolpath.embedded.report import EmbeddedReport

__all__ = [
    "Bundles",
    "EmbeddedHeads",
    "EmbeddedOptions",
    "EmbeddedReport",
    "bundled",
    "check_thinnest",
    "plan_embedded",
]

__getattr__, __dir__ = on_demand(__name__)
