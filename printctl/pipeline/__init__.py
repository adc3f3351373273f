"""The stages of a run, from tissue to report, and running them without doing anything twice."""

from printctl.pipeline.run import run_recipe

__all__ = ["run_recipe"]
