"""Read ``simulation_parameters`` of svZeroDSolver's input."""

from __future__ import annotations

from typing import Any, Final

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.case import SolverOptions
from design.hemodynamics.zero_d.svzerod.keys import check_keys, flag, number, whole

PLACE: Final = "simulation_parameters"
INERT: Final = ("density", "model_name", "viscosity")
"""Keys that SimVascular writes; the elements' numbers hold them already."""
_FLAGS: Final = (
    "output_all_cycles", "output_derivative", "output_mean_only", "output_variable_based",
)  # fmt: skip
_KNOWN: Final = frozenset((
    "number_of_cardiac_cycles", "number_of_time_pts_per_cardiac_cycle", "absolute_tolerance",
    "maximum_nonlinear_iterations", "steady_initial", "rho_infty", "use_cycle_to_cycle_error",
    "sim_cycle_to_cycle_percent_error", "cardiac_period", "output_interval", *_FLAGS, *INERT,
    "coupled_simulation",
))  # fmt: skip


def options_of(data: Any) -> SolverOptions:
    """Return the options of the object under ``simulation_parameters``.

    Raises
    ------
    FlowError
        For a key that isn't known, a value out of its bounds, a coupled simulation.
    """
    given = check_keys(data, PLACE, _KNOWN)
    if flag(given, "coupled_simulation", PLACE, default=False):
        raise FlowError(f"{PLACE}: coupled_simulation needs the 3D solver that drives it")
    radius = number(given, "rho_infty", PLACE, 0.5)
    if not 0.0 <= radius <= 1.0:
        raise FlowError(f"{PLACE}: rho_infty is {radius:g}; it lies between 0 and 1")
    error = _cycle_error(given)
    return SolverOptions(
        points=whole(given, "number_of_time_pts_per_cardiac_cycle", PLACE, 2),
        cycles=whole(given, "number_of_cardiac_cycles", PLACE, 1 if error is None else 2),
        absolute_tolerance=_positive(given, "absolute_tolerance", 1e-8),
        maximum_nonlinear_iterations=whole(given, "maximum_nonlinear_iterations", PLACE, 2, 30),
        steady_initial=flag(given, "steady_initial", PLACE, default=True),
        rho_infty=radius,
        cycle_error=error,
        cardiac_period=_period(given),
        output_interval=whole(given, "output_interval", PLACE, 1, 1),
        **{key: flag(given, key, PLACE, default=False) for key in _FLAGS},
    )


def _cycle_error(given: Any) -> float | None:
    error = _positive(given, "sim_cycle_to_cycle_percent_error", 1.0) / 100.0
    return error if flag(given, "use_cycle_to_cycle_error", PLACE, default=False) else None


def _period(given: Any) -> float | None:
    """Return the period; below 0 means that the tables say it."""
    period = number(given, "cardiac_period", PLACE, -1.0)
    if period == 0.0:
        raise FlowError(f"{PLACE}: cardiac_period is 0; write the length of a cycle")
    return period if period > 0.0 else None


def _positive(given: Any, key: str, default: float) -> float:
    value = number(given, key, PLACE, default)
    if value <= 0.0:
        raise FlowError(f"{PLACE}: {key} is {value:g}; write a number above 0")
    return value
