"""Command line for a written 3D flow case: solve it on MPI ranks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from design.errors import DesignError
from printctl.analysis.flow.ranks import run_on_ranks
from printctl.errors import PrintctlError


def main() -> int:
    """Run a case that is written already."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=Path, help="folder that write_case wrote")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--python", type=Path, help="an interpreter with dolfinx")
    asked = parser.parse_args()
    try:
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
