"""The job of a plate: every well's path where it stands, one after another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath import Toolpath
from design.toolpath.file import load_toolpath
from design.toolpath.gcode import Gcode, labelled, save_gcode, stream_gcode
from design.toolpath.gcode.dialect import dialect_of
from design.toolpath.wells import Trip, led_to, placed, top_mm, written_ul
from printctl.pipeline.context import RunContext
from printctl.pipeline.plate.wells import PlateRun, relative
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.toolpath import GCODE, LINE_MAP, PATH, machine, written_beside
from printctl.plates import StandingPlate, Well
from printctl.preflight import well_arrays
from printctl.progress import Report
from printctl.recipe.making import Fresh

FloatArray = NDArray[np.float64]
NOWHERE: Final = -1
"""In the map, of a line between wells."""


@dataclass
class Laid:
    """What is known of the wells once their paths are laid.

    Attributes
    ----------
    first, after : list of int
        Moves of the whole job: the first of each well, and the first one after it.
    written_ul : list of float
        Ink that its writing moves take.
    moves : int
        Of all so far.
    well_of_line : list of arrays
        Well of each line, in the printing order; `NOWHERE` between wells.
    """

    first: list[int] = field(default_factory=list)
    after: list[int] = field(default_factory=list)
    written_ul: list[float] = field(default_factory=list)
    moves: int = 0
    well_of_line: list[NDArray[np.int16]] = field(default_factory=list)


def job_stage(run: PlateRun) -> Stage:
    """The stage that writes the plate's job; its name is the toolpath's."""
    paths = tuple(relative(run, context, PATH) for context in run.runs.values())

    def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
        return write_job(run, report)

    return Stage("toolpath", lambda _: _depends(run), paths, ("kernels", "design"), work)


def _depends(run: PlateRun) -> Any:
    whole = run.whole
    return [
        [[well.name, well.label, well.copy, run.folder_of(well)] for well in run.wells],
        [run.standing.centre_mm(well.name) for well in run.wells],
        [place_of(run, well).tolist() for well in run.wells],
        [run.standing.safe_z_mm, run.standing.bath_mm, run.standing.turned_deg],
        run.standing.plate.model_dump(mode="json"),
        whole.start_mm.tolist(),
        [one.model_dump(mode="json") for one in (whole.printer, whole.syringe, whole.profile_ink)],
        [context.ink_changes.get("flow_factor") for context in run.runs.values()],
        whole.flow_ul_s,
    ]


def place_of(run: PlateRun, well: Well) -> FloatArray:
    """Where a well's part has its origin, printer's frame, (3,), mm."""
    of = run.run_of(well)
    moved = np.subtract(run.standing.centre_mm(well.name), _centre(of))
    return np.asarray(np.round(of.place_mm + np.append(moved, 0.0), 3))


def _centre(context: RunContext) -> tuple[float, float]:
    assert context.stand is not None
    return context.stand.centre_mm


def write_job(run: PlateRun, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Lay the paths end to end, write them as one job with a label at each well, and its map."""
    whole, laid = run.whole, Laid()
    kept = {name: load_toolpath(of.folder / PATH) for name, of in run.runs.items()}
    paths = {well.name: kept[run.run_of(well).folder.name] for well in run.wells}
    numbers = _vessel_numbers(run)
    top = max(
        run.standing.safe_z_mm,
        *(top_mm(paths[well.name]) + place_of(run, well)[2] for well in run.wells),
    )
    printer, syringe, _, options = machine(whole, ahead=False)
    parts = _parts(run, paths, numbers, laid)
    written = stream_gcode(parts, printer, syringe, np.zeros(3), options, top)
    # Filled while the job is written; save_gcode reads it when that is done.
    beside: dict[str, NDArray[Any]] = {}
    lines = save_gcode(
        whole.folder / GCODE,
        whole.folder / LINE_MAP,
        _marked(run, written, laid, beside, report),
        beside,
    )
    summary = {
        "method": whole.recipe.toolpath.method,
        "moves": laid.moves,
        "written_ul": sum(laid.written_ul),
        "lines": lines,
        "plate": run.standing.plate.name,
        "wells": len(run.wells),
        "variants": len({well.variant for well in run.wells}),
    }
    return summary, [GCODE, LINE_MAP]


def _parts(
    run: PlateRun, paths: dict[str, Toolpath], numbers: Sequence[int], laid: Laid
) -> Iterator[Toolpath]:
    """Each well's path with the way to it, in the printer's frame."""
    at: FloatArray | None = None
    before = run.whole
    for well, number in zip(run.wells, numbers, strict=True):
        of = run.run_of(well)
        doses = run.whole.ink.flow_factor / of.ink.flow_factor
        path = placed(paths[well.name], place_of(run, well), doses, number)
        laid.written_ul.append(written_ul(path) / doses)
        way = 0
        if at is not None:
            path, way = led_to(path, at, _trip(run, before, of))
        laid.first.append(laid.moves + way)
        laid.moves += len(path)
        laid.after.append(laid.moves)
        at, before = path.end[-1], of
        yield path


def _trip(run: PlateRun, before: RunContext, to: RunContext) -> Trip:
    speed = to.recipe.toolpath.travel_speed_mm_s
    return Trip(run.standing.safe_z_mm, speed, before.ink.retract_ul, before.ink.plunger_ul_s)


def _vessel_numbers(run: PlateRun) -> list[int]:
    """What to add to each well's numbers so that no two vessels of the job share one."""
    if isinstance(run.whole.recipe.toolpath, Fresh):
        return [0] * len(run.wells)
    counts = [run.run_of(well).network.vessel_count for well in run.wells]
    return np.append(0, np.cumsum(counts))[:-1].tolist()


def _marked(
    run: PlateRun,
    parts: Iterator[Gcode],
    laid: Laid,
    beside: dict[str, NDArray[Any]],
    report: Report,
) -> Iterator[Gcode]:
    """The job's parts with a comment where a well begins and ends."""
    comment = dialect_of(run.whole.printer).comment
    for number, (well, part) in enumerate(zip(run.wells, parts, strict=True)):
        report((number + 1) / len(run.wells), f"well {well.name}")
        first, after = laid.first[number], laid.after[number]
        texts = {first: f"WELL:{well.name} {well.label}", after: f"WELL_END:{well.name}"}
        found = labelled(part, texts, comment)
        inside = (found.line_move >= first) & (found.line_move < after)
        laid.well_of_line.append(np.where(inside, number, NOWHERE).astype(np.int16))
        yield found
    beside |= _beside(run, laid)


def _beside(run: PlateRun, laid: Laid) -> dict[str, NDArray[Any]]:
    """What the map says besides its lines: the wells, and what an embedded job writes in all."""
    found: dict[str, NDArray[Any]] = {
        "well": np.concatenate(laid.well_of_line),
        "wells": np.array([well.name for well in run.wells]),
        "labels": np.array([well.label for well in run.wells]),
        **_plate(run.standing),
    }
    if isinstance(run.whole.recipe.toolpath, Fresh):
        return found
    each = [written_beside(run.run_of(well), ahead=False) for well in run.wells]
    networks = [run.run_of(well).written_network.moved(place_of(run, well)) for well in run.wells]
    whole = beside_each_other(networks)
    found |= {name: each[0][name] for name in each[0] if not name.startswith("network_")}
    found |= {f"network_{name}": getattr(whole, name) for name in _NETWORK}
    for name in ("overlap_radii", "clearance_mm"):
        found[name] = np.array(max(float(one[name]) for one in each))
    return found | {"place_mm": np.zeros(3)}


def _plate(standing: StandingPlate) -> dict[str, NDArray[Any]]:
    names = standing.plate.wells
    return well_arrays(
        names,
        np.array([standing.centre_mm(name) for name in names]),
        standing.dish,
        standing.floor_mm,
        standing.bath_mm,
        standing.safe_z_mm,
    )


_NETWORK: Final = ("nodes", "vessel_nodes", "offset", "points", "radius")


def beside_each_other(networks: Sequence[VesselNetwork]) -> VesselNetwork:
    """Networks that don't touch as one, their vessels one after another."""
    nodes = np.append(0, np.cumsum([len(one.nodes) for one in networks]))
    points = np.append(0, np.cumsum([len(one.points) for one in networks]))
    numbered = list(zip(networks, nodes, points, strict=False))
    return VesselNetwork(
        nodes=np.concatenate([one.nodes for one in networks]),
        vessel_nodes=np.concatenate([one.vessel_nodes + node for one, node, _ in numbered]),
        kind=np.concatenate([one.kind for one in networks]),
        tree=np.concatenate([one.tree for one in networks]),
        offset=np.concatenate([[0], *(one.offset[1:] + point for one, _, point in numbered)]),
        points=np.concatenate([one.points for one in networks]),
        radius=np.concatenate([one.radius for one in networks]),
    )
