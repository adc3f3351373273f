"""Flow in vessel networks by 0D, 1D and 3D solvers; fluids, waveforms, dye, oxygen.

Names are loaded on first use: a steady flow needs neither 1D waves nor pulses.

Goes in: a network and boundary conditions. Comes out: pressure, flow and wall shear of each
vessel. Begin with `zero_d/steady.py` (network, nodal solve, `FlowSolution`); `one_d`, `three_d`,
`oxygen` and `dye.py` each name their own entry, `other_solvers` reads and writes their files.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.hemodynamics.conditions import (
        FlowConditions,
        OutletLoad,
        PressureOutlet,
        PulsatileConditions,
        ResistanceOutlet,
        Supply,
        WindkesselOutlet,
        same_shear_conditions,
        scaled_flow,
        scaled_network,
    )
    from design.hemodynamics.fluids import Carreau, Fluid, Newtonian, PowerLaw, Pries1994
    from design.hemodynamics.one_d import (
        OneDOptions,
        OneDSolution,
        one_d_summary,
        one_d_table,
        one_d_waves,
        solve_one_d,
    )
    from design.hemodynamics.other_solvers.svoned import write_svoned
    from design.hemodynamics.pressure_drops import Losses, Stenosis, resistance_at
    from design.hemodynamics.probes import Probes
    from design.hemodynamics.vessel_coefficients import (
        GelWall,
        RigidWall,
        ThinWall,
        VesselWalls,
        vessel_resistance,
    )
    from design.hemodynamics.zero_d.balance import balance, flow_spread
    from design.hemodynamics.zero_d.pulsatile import solve_pulsatile
    from design.hemodynamics.zero_d.pulsatile_report import (
        end_waves,
        pulsatile_at_probes,
        pulsatile_summary,
        pulsatile_table,
        steady_at_probes,
    )
    from design.hemodynamics.zero_d.report import (
        ShearBand,
        band_summary,
        flow_summary,
        flow_table,
        question_pressure,
        read_flow_csv,
        write_flow_csv,
    )
    from design.hemodynamics.zero_d.steady import (
        FlowSolution,
        flow_structure,
        node_inflow,
        solve_flow,
    )

__all__ = [
    "Carreau",
    "FlowConditions",
    "FlowSolution",
    "Fluid",
    "GelWall",
    "Losses",
    "Newtonian",
    "OneDOptions",
    "OneDSolution",
    "OutletLoad",
    "PowerLaw",
    "PressureOutlet",
    "Pries1994",
    "Probes",
    "PulsatileConditions",
    "ResistanceOutlet",
    "RigidWall",
    "ShearBand",
    "Stenosis",
    "Supply",
    "ThinWall",
    "VesselWalls",
    "WindkesselOutlet",
    "balance",
    "band_summary",
    "end_waves",
    "flow_spread",
    "flow_structure",
    "flow_summary",
    "flow_table",
    "node_inflow",
    "one_d_summary",
    "one_d_table",
    "one_d_waves",
    "pulsatile_at_probes",
    "pulsatile_summary",
    "pulsatile_table",
    "question_pressure",
    "read_flow_csv",
    "resistance_at",
    "same_shear_conditions",
    "scaled_flow",
    "scaled_network",
    "solve_flow",
    "solve_one_d",
    "solve_pulsatile",
    "steady_at_probes",
    "vessel_resistance",
    "write_flow_csv",
    "write_svoned",
]

__getattr__, __dir__ = on_demand(__name__)
