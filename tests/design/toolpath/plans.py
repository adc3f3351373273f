"""Toolpaths of plans, without their reports."""

from __future__ import annotations

from typing import Any

from design.network import VesselNetwork
from design.toolpath import Toolpath
from design.toolpath.embedded import EmbeddedOptions, plan_embedded
from design.toolpath.fresh import plan_fresh


def embedded_toolpath(network: VesselNetwork, options: EmbeddedOptions) -> Toolpath:
    return plan_embedded(network, options).toolpath


def fresh_toolpath(*planned: Any) -> Toolpath:
    return plan_fresh(*planned).toolpath
