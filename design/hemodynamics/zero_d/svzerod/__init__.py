"""Read, run and write svZeroDSolver's input files; write results in that program's columns.

Goes in: a network, or an svZeroDSolver file. Comes out: such a file, or its results. Begin with
`read.py`. Names are loaded when first asked for: reading a file needs no network.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
    from design.hemodynamics.zero_d.svzerod.keys import parse_json
    from design.hemodynamics.zero_d.svzerod.read import case_of, read_svzerod
    from design.hemodynamics.zero_d.svzerod.results import (
        ResultTable,
        result_table,
        write_svzerod_csv,
        write_svzerod_npz,
    )
    from design.hemodynamics.zero_d.svzerod.run import SvZeroDRun, run_svzerod
    from design.hemodynamics.zero_d.svzerod.write import svzerod_input, write_svzerod

__all__ = [
    "ResultTable",
    "SvZeroDCase",
    "SvZeroDRun",
    "case_of",
    "parse_json",
    "read_svzerod",
    "result_table",
    "run_svzerod",
    "svzerod_input",
    "write_svzerod",
    "write_svzerod_csv",
    "write_svzerod_npz",
]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
