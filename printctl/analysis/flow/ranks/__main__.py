"""Command line for a written 3D flow case: solve it on MPI ranks, or write its Slurm script."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from design.errors import DesignError
from printctl.analysis.flow.ranks import run_on_ranks, slurm_job, write_slurm
from printctl.errors import PrintctlError


def main() -> int:
    """Run a case that is written already, or write the script that does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=Path, help="folder that write_case wrote")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--python", type=Path, help="an interpreter with dolfinx")
    parser.add_argument("--slurm", type=Path, help="write this batch script instead")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="of the script; again"
    )
    asked = parser.parse_args()
    try:
        if asked.slurm is not None:
            python = [f"python={asked.python}"] if asked.python else []
            write_slurm(asked.slurm, asked.case, slurm_job(python + asked.set))
            return 0
        result = run_on_ranks(asked.case, asked.ranks, asked.python, _tell)
    except (PrintctlError, DesignError) as exc:
        print(exc, file=sys.stderr)
        return getattr(exc, "exit_code", 1)
    for k, (flow, pressure) in enumerate(zip(result.port_flow, result.port_pressure, strict=True)):
        print(f"port {k}: {flow:.6g} uL/s out, {pressure:.6g} Pa")
    return 0


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
