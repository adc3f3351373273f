"""Plan a well plate: the wells in use, their contents and printing order; refuse misfits.

Goes in: a plate's profile and a recipe's section. Comes out: wells, their variants and order.
Begin with `assign.py`.
"""

from printctl.pipeline.plates.assign import Well, assigned, scanned_wells
from printctl.pipeline.plates.names import expand
from printctl.pipeline.plates.place import StandingPlate, WellDish, standing_plate
from printctl.pipeline.plates.route import route
from printctl.pipeline.plates.sweep import Point, points, varied_recipe

__all__ = [
    "Point",
    "StandingPlate",
    "Well",
    "WellDish",
    "assigned",
    "expand",
    "points",
    "route",
    "scanned_wells",
    "standing_plate",
    "varied_recipe",
]
