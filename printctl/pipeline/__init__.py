"""The stages of a run, from tissue to report, and running them without doing anything twice."""

from printctl.pipeline.run import design_recipe, run_recipe, toolpath_recipe

__all__ = ["design_recipe", "run_recipe", "toolpath_recipe"]
