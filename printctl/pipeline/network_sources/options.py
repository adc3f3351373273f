"""Convert a growth section to growth options; read the files it names."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from design.network import VesselNetwork
from design.network_files.by_suffix import read_network
from design.units import PA_PER_MMHG
from design.vasculature import DepthPenalty, GrowthOptions, GrowthStage, LoopOptions
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.recipe.sections.forest import Forest
from printctl.recipe.sections.growth import ClosedLoop, GrownNetwork, Growth, PenaltyPart, StagePart


def growth_options(part: Growth, seed: int, recipe_folder: Path = Path()) -> GrowthOptions:
    """Return a growth section as options in the design's units; paths are the recipe's.

    Raises
    ------
    RecipeError
        When the file of terminals can't be read.
    """
    points: FloatArray | None = None
    flows: FloatArray | None = None
    stages: tuple[GrowthStage, ...] = ()
    terminals = part.terminals
    if isinstance(part, GrownNetwork):
        if part.terminal_points is not None:
            points, flows = read_terminals(recipe_folder / part.terminal_points)
            terminals = len(points)
        stages = tuple(_stage(stage) for stage in part.stages)
        terminals = stages[-1].terminals if stages else terminals
    return GrowthOptions(
        terminals=terminals or 0,
        seed=seed,
        murray_exponent=part.murray_exponent,
        length_exponent=part.length_exponent,
        radius_exponent=part.radius_exponent,
        viscosity_pa_s=part.viscosity_mpa_s * 1e-3,
        viscosity_law=part.viscosity_law,
        haematocrit=part.haematocrit,
        pressure_drop_pa=part.pressure_drop_mmhg * PA_PER_MMHG,
        perfusion_ml_min_per_ml=part.perfusion_ml_min_per_ml,
        smallest_radius_mm=part.smallest_diameter_mm / 2 if part.smallest_diameter_mm else None,
        clearance_mm=part.clearance_mm,
        clearance_ratio=part.clearance_ratio,
        length_to_radius=part.length_to_radius,
        branch_angle_degrees=part.branch_angle_degrees,
        turn_angle_degrees=part.turn_angle_degrees,
        flow_ratio=part.flow_ratio,
        penalty=_penalty(part.penalty),
        follow_demand=part.follow_demand,
        terminal_flow=part.terminal_flow if isinstance(part, GrownNetwork) else "equal",
        terminal_points_mm=points,
        terminal_flows=flows,
        root_point_mm=part.root_mm,
        root_direction=part.root_direction,
        root_at_top=isinstance(part, GrownNetwork) and part.root == "top",
        root_candidates=(
            part.root_candidates
            if isinstance(part, GrownNetwork | ClosedLoop) and part.root == "search"
            else 0
        ),
        stages=stages,
    )


def _penalty(part: PenaltyPart | None) -> DepthPenalty | None:
    return None if part is None else DepthPenalty(part.depth_mm, part.factor)


def _stage(part: StagePart) -> GrowthStage:
    return GrowthStage(
        terminals=part.terminals,
        clearance_mm=part.clearance_mm,
        length_to_radius=part.length_to_radius,
        follow_demand=part.follow_demand,
        branch_angle_degrees=part.branch_angle_degrees,
        turn_angle_degrees=part.turn_angle_degrees,
        flow_ratio=part.flow_ratio,
        penalty=_penalty(part.penalty),
    )


def loop_options(part: ClosedLoop | Forest, seed: int) -> LoopOptions:
    """Return options of the connections, with the trees' clearance and smallest lumen."""
    own = part.connections
    thinnest = part.smallest_diameter_mm
    return LoopOptions(
        seed=seed,
        clearance_mm=part.clearance_mm,
        clearance_ratio=part.clearance_ratio,
        bend_to_radius=own.bend_to_radius,
        kink_degrees=own.kink_degrees,
        radius_ratio=own.radius_ratio,
        smallest_radius_mm=None if thinnest is None else thinnest / 2,
        prune_part=own.most_pruned_percent / 100.0,
        weight_length=own.length_weight,
        weight_tortuosity=own.tortuosity_weight,
        weight_clearance=own.clearance_weight,
        weight_volume=own.volume_weight,
    )


def read_trunk(part: GrownNetwork, recipe_folder: Path) -> VesselNetwork | None:
    """Read the artery that growth continues from; None without one."""
    if part.trunk is None:
        return None
    return read_network(recipe_folder / part.trunk, part.trunk_unit)


def read_terminals(path: Path) -> tuple[FloatArray, FloatArray | None]:
    """Read terminals: points (n, 3), mm, and flows (n,) where the file has them.

    Raises
    ------
    RecipeError
        Without the columns x_mm, y_mm and z_mm, or with what isn't a number; with the line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            names = [name.strip() for name in rows.fieldnames or ()]
            rows.fieldnames = names
            wanted = ["x_mm", "y_mm", "z_mm", *(["flow"] if "flow" in names else [])]
            if not set(wanted) <= set(names):
                raise RecipeError(
                    f"{path}: columns are {', '.join(names) or 'missing'}; give x_mm, y_mm, z_mm "
                    "and, if wanted, flow in the first line"
                )
            table = [(rows.line_num, _numbers(path, rows.line_num, row, wanted)) for row in rows]
    except (OSError, UnicodeDecodeError) as exc:
        raise RecipeError(f"terminal_points {path} can't be read: {exc}") from exc
    _refuse_twins(path, table)
    values = np.array([row for _, row in table], dtype=np.float64).reshape(-1, len(wanted))
    return values[:, :3], values[:, 3] if len(wanted) == 4 else None


def _numbers(path: Path, line: int, row: dict[str, str], wanted: list[str]) -> list[float]:
    texts = [row.get(name) for name in wanted]
    try:
        numbers = [float(row[name]) for name in wanted]
    except (TypeError, ValueError) as exc:
        raise RecipeError(
            f"{path}, line {line}: {texts} aren't numbers; mend or remove it"
        ) from exc
    if not np.isfinite(numbers).all():
        raise RecipeError(f"{path}, line {line}: {texts} aren't all finite; mend or remove it")
    if len(numbers) == 4 and not numbers[3] > 0.0:
        raise RecipeError(f"{path}, line {line}: flow is {numbers[3]:g}; give one above 0")
    return numbers


def _refuse_twins(path: Path, table: list[tuple[int, list[float]]]) -> None:
    """Refuse a point that stands in two lines."""
    first: dict[tuple[float, ...], int] = {}
    for line, row in table:
        other = first.setdefault(tuple(row[:3]), line)
        if other != line:
            x, y, z = row[:3]
            raise RecipeError(
                f"{path}: the point ({x:g}, {y:g}, {z:g}) mm stands in line {other} and in line "
                f"{line}; give each once"
            )
