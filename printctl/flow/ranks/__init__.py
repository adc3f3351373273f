"""Flow on MPI ranks: the engine's Python found, ranks started here, or a batch script written."""

from printctl.flow.ranks.engine import Engine, find_engine
from printctl.flow.ranks.run import run_on_ranks
from printctl.flow.ranks.slurm import SlurmJob, write_slurm

__all__ = ["Engine", "SlurmJob", "find_engine", "run_on_ranks", "write_slurm"]
