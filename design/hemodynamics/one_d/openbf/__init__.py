"""Run openBF network files with our 1D solver: read YAML, solve, write waves as CSV or NPZ.

Goes in: the parsed YAML of github.com/INSIGNEO/openBF and its inlet's table. Comes out: waves at
five places of each vessel. Begin with `read.py`.
"""

from design.hemodynamics.one_d.openbf.case import OpenBFCase
from design.hemodynamics.one_d.openbf.read import case_of, inlet_file, is_openbf
from design.hemodynamics.one_d.openbf.results import (
    OpenBFWaves,
    run_openbf,
    write_openbf_csv,
    write_openbf_npz,
)

__all__ = [
    "OpenBFCase",
    "OpenBFWaves",
    "case_of",
    "inlet_file",
    "is_openbf",
    "run_openbf",
    "write_openbf_csv",
    "write_openbf_npz",
]
