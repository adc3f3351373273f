"""Adjust vessel radii until 3D flow divides among the branches as wanted.

Goes in: a network and the flows wanted. Comes out: adjusted radii and the history of the rounds.
Begin with `loop.py`.
"""

from design.hemodynamics.three_d.match.loop import match_split
from design.hemodynamics.three_d.match.options import MatchedNetwork, MatchOptions, Round
from design.hemodynamics.three_d.match.target import Target, ideal_target, outlet_target

__all__ = [
    "MatchOptions",
    "MatchedNetwork",
    "Round",
    "Target",
    "ideal_target",
    "match_split",
    "outlet_target",
]
