"""Stages from design to checked G-code.

Goes in: a network. Comes out: G-code and its dry run. Begin with `toolpath.py`.
"""
