"""3D flow on several processors by MPI: write a case, solve it, read the result.

Goes in: a lumen's mesh and conditions. Comes out: a case folder, and the result read back from it.
Begin with `case.py`.
"""

from design.hemodynamics.three_d.ranks.case import (
    PortCondition,
    PortFlow,
    PortPressure,
    PortShare,
    RankConditions,
    RankResult,
    rank_conditions,
    read_result,
    write_case,
)

__all__ = [
    "PortCondition",
    "PortFlow",
    "PortPressure",
    "PortShare",
    "RankConditions",
    "RankResult",
    "rank_conditions",
    "read_result",
    "write_case",
]
