"""Find FEniCSx and MPI on this machine; solve a 3D flow case on ranks, or write a Slurm script.

Goes in: a case folder. Comes out: its result, or a script for a cluster. Begin with `run.py`.
"""

from printctl.analysis.flow.ranks.engine import Engine, find_engine
from printctl.analysis.flow.ranks.run import run_on_ranks
from printctl.analysis.flow.ranks.slurm import SlurmJob, slurm_job, write_slurm

__all__ = ["Engine", "SlurmJob", "find_engine", "run_on_ranks", "slurm_job", "write_slurm"]
