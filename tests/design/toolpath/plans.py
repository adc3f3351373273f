"""Toolpaths of plans, without their reports, and what jobs of them are written with."""

from typing import Any

import numpy as np

from design.network import VesselNetwork
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.fresh import FreshOptions, plan_fresh
from firmware_profiles import Syringe, load
from tests.design.toolpath.shapes import as_solid, block, random_tree, upright

SYRINGE = load(Syringe, "hamilton_1ml")
PLACE = np.array([60.0, 70.0, 20.0])


def embedded_toolpath(network: VesselNetwork, options: EmbeddedOptions) -> Toolpath:
    return plan_embedded(network, options).toolpath


def fresh_toolpath(*planned: Any) -> Toolpath:
    return plan_fresh(*planned).toolpath


def fresh(**options: float) -> Toolpath:
    """Layers of a drilled block."""
    return fresh_toolpath(as_solid(block(4, 3, 0.3) - upright(2, 1.5, 1)), FreshOptions(**options))


def embedded(**options: float) -> Toolpath:
    """Passes of a random tree."""
    return embedded_toolpath(random_tree(20, 10, 3, 0.1), EmbeddedOptions(**options))
