"""Simulated printer in a separate process, for hosts under test."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@contextmanager
def printer_process(folder: Path, *options: str, speed: float = 0) -> Iterator[str]:
    """Start one behind a pseudo-terminal; give the port's name, and end it at last.

    Parameters
    ----------
    folder : Path
        Where the name ``tty`` is made for the port.
    options : str
        Of ``python -m sim``.
    speed : float
        Times real time; 0 for as fast as it can.
    """
    command = [sys.executable, "-m", "sim", "--printer", "generic_marlin", "--speed", f"{speed:g}"]
    command += ["--link", str(folder / "tty"), *options]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
