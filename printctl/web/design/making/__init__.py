"""Runs of recipes as processes of the command line, found again by a new server."""

from printctl.web.design.making.detached import Detached
from printctl.web.design.making.progress import RunProgress, StageProgress, read_progress
from printctl.web.design.making.runs import Runs

__all__ = ["Detached", "RunProgress", "Runs", "StageProgress", "read_progress"]
