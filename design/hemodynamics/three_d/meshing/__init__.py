"""Fill lumens with curved tetrahedra between a wall and flat ports.

Goes in: a network, or a lumen's surface. Comes out: a `LumenMesh`. Begin with `mesh.py`.
"""
