"""Pipeline runs started by the web server as separate processes that survive its restart."""

from printctl.web.design.run_processes.detached import DetachedProcesses
from printctl.web.design.run_processes.progress import RunProgress, StageProgress, read_progress
from printctl.web.design.run_processes.runs import Runs

__all__ = ["DetachedProcesses", "RunProgress", "Runs", "StageProgress", "read_progress"]
