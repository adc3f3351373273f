"""Run a `printctl` module as a separate process with a time limit; return its output.

The process runs kernels without numba where it can (``python -m printctl.web.worker MODULE``).
"""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

from printctl.web.errors import ConflictError


def run_worker(
    module: str, *words: str, said: str = "", longest_s: float, late: str, died: str
) -> str:
    """Run a module of ours to its end and give what it printed.

    Parameters
    ----------
    module : str
        Has a ``main``.
    *words : str
        Its arguments.
    said : str
        What it is given to read.
    longest_s : float, s
    late, died : str
        What a person is told when it takes longer, or ends in failure; the last line that it
        wrote to stderr is added to ``died``.

    Raises
    ------
    ConflictError
    """
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, module, *words],
            input=said,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=longest_s,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise ConflictError(late) from exc
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no word"]
        raise ConflictError(f"{died}: {last[0][:500]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(import_module(sys.argv.pop(1)).main())
