"""Find vessels of a network that come closer than the required clearance.

Goes in: a network. Comes out: pairs of its pieces that come too close. Begin with `collide.py`.
"""
