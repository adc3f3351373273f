"""Find FEniCSx and MPI on this machine; solve a 3D flow case on ranks.

Goes in: a case folder. Comes out: its result. Begin with `run.py`.
"""

from printctl.analysis.flow.ranks.engine import Engine, find_engine
from printctl.analysis.flow.ranks.run import run_on_ranks

__all__ = ["Engine", "find_engine", "run_on_ranks"]
