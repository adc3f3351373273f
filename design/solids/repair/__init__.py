"""Repair of meshes: holes, crossings, bad triangles.

Goes in: a faulty mesh. Comes out: a manifold one. Begin with `mend.py`.
"""
