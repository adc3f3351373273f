"""Pipeline runs started by the web server as separate processes that survive its restart.

Goes in: a recipe and how far to go. Comes out: a process, and its progress. Begin with `runs.py`.
"""

from printctl.web.design.run_processes.detached import DetachedProcesses
from printctl.web.design.run_processes.progress import RunProgress, StageProgress, read_progress
from printctl.web.design.run_processes.runs import Runs

__all__ = ["DetachedProcesses", "RunProgress", "Runs", "StageProgress", "read_progress"]
