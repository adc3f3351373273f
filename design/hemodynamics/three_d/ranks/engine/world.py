"""MPI communicator; print a log line once for all ranks; peak memory of a rank."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

WORLD = MPI.COMM_WORLD


def say(text: str) -> None:
    """Print a line of the log, once."""
    if WORLD.rank == 0:
        print(text, flush=True)


def peak_mb() -> float:
    """Most memory that this rank has held, MB."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return float(next(x for x in lines if x.startswith("VmHWM:")).split()[1]) * 1024 / 1e6
    except OSError:  # not Linux
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
