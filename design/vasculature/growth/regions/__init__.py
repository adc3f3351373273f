"""Grow a large tree region by region, in parallel: the same tree for any number of threads.

Goes in: a tree of some thousand terminals and the options. Comes out: the tree of a million. Begin
with `large_growth.py`; docs/decisions/2026-11-25-growth-by-regions.md says why it is done so.
"""
