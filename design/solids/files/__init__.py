"""Solids in files: STL, 3MF, STEP, and the check of a mesh that is read.

Goes in: a solid or a file. Comes out: a file or a solid. Begin with `write.py`.
"""
