"""svZeroDSolver's files: read and run its input here; write its input and its output columns.

Goes in: a network, or an svZeroDSolver file. Comes out: such a file, or its results. Begin with
`read.py`.
"""

from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
from design.hemodynamics.zero_d.svzerod.read import read_svzerod
from design.hemodynamics.zero_d.svzerod.results import run_svzerod, write_svzerod_csv
from design.hemodynamics.zero_d.svzerod.write import svzerod_input, write_svzerod

__all__ = [
    "SvZeroDCase",
    "read_svzerod",
    "run_svzerod",
    "svzerod_input",
    "write_svzerod",
    "write_svzerod_csv",
]
