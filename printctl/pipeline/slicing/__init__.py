"""Slice mesh files without a recipe: parts, modifiers, heads, placement.

Goes in: meshes and options. Comes out: G-code. Begin with `job.py`.
"""

from printctl.pipeline.slicing.job import JobFigures, SliceJob, slice_parts
from printctl.pipeline.slicing.modifiers import read_modifier
from printctl.pipeline.slicing.parts import Assembly, assemble, head_of_each

__all__ = [
    "Assembly",
    "JobFigures",
    "SliceJob",
    "assemble",
    "head_of_each",
    "read_modifier",
    "slice_parts",
]
