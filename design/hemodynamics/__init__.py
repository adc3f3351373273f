"""Flow in vessel networks."""

from design.hemodynamics.balance import balance, flow_spread
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.flow import FlowSolution
from design.hemodynamics.print_scale import at_same_shear, scaled_flow, scaled_network
from design.hemodynamics.resistance import vessel_resistance
from design.hemodynamics.steady import node_inflow, solve_flow
from design.hemodynamics.summary import flow_summary
from design.hemodynamics.table import flow_table, write_flow_csv

__all__ = [
    "FlowConditions",
    "FlowSolution",
    "at_same_shear",
    "balance",
    "flow_spread",
    "flow_summary",
    "flow_table",
    "node_inflow",
    "scaled_flow",
    "scaled_network",
    "solve_flow",
    "vessel_resistance",
    "write_flow_csv",
]
