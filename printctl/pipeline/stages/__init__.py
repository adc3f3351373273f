"""Pipeline stages, one file each: inputs, dependencies, work.

Goes in: a `RunContext`. Comes out: a stage's files in the run folder. Begin with
`paths/toolpath.py`.
"""
