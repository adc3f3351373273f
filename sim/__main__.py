"""Entry point of the simulated printer (``python -m sim``) and devices over its dish."""

from __future__ import annotations

import sys
from importlib import import_module

from kernels import without_numba


def main(arguments: list[str] | None = None) -> int:
    """Run `sim.command`."""
    return int(import_module("sim.command").main(arguments))


if __name__ == "__main__":
    # Numba is half of what it takes to start a printer, and its kernels are few.
    without_numba()
    sys.exit(main())
