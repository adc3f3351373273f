"""Find pieces of a network's vessels that come closer than the required clearance.

Goes in: a network. Comes out: pairs of its pieces that come too close. Begin with `collide.py`.
"""
