"""Other processes: whether they live, one that works beside this, rare garbage collection.

Goes in: process numbers and calls. Comes out: results. Begin with `alive.py`.
"""
