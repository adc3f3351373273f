"""Entry point of the MPI flow solver: solve the case of the folder named on the command line."""

from __future__ import annotations

import sys

import petsc4py

petsc4py.init([sys.argv[0], *sys.argv[2:]])  # before anything that starts PETSc itself

import logging  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from petsc4py import PETSc  # noqa: E402

from .problem import WORLD  # noqa: E402
from .solve import solve_case  # noqa: E402

if __name__ == "__main__":
    logging.disable(logging.INFO)  # of the compiler, every rank's
    try:
        if np.issubdtype(PETSc.ScalarType, np.complexfloating):
            raise RuntimeError("this PETSc was built for complex numbers; take one for real ones")
        solve_case(Path(sys.argv[1]))
    except BaseException as failure:  # One rank's failure would leave the others waiting.
        told = f"rank {WORLD.rank}: {type(failure).__name__}: {failure}"
        print(told, file=sys.stderr, flush=True)
        WORLD.Abort(1)
