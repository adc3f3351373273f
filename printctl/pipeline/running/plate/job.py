"""Join all wells' toolpaths into one plate job with its map of lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, repeat
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath import Toolpath
from design.toolpath.added_moves import Trip, place_in_well, with_approach, written_ul
from design.toolpath.embedded import Bundles
from design.toolpath.gcode import Gcode, add_labels, save_gcode, stream_gcode
from design.toolpath.gcode.table import dialect_of
from design.toolpath.toolpath import load_toolpath
from kernels.arrays import FloatArray
from printctl.checks.preflight import well_arrays
from printctl.pipeline.context import RunContext
from printctl.pipeline.running.plate.wells import PlateRun, relative
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.toolpath import PATH, machine, written_beside, written_bundles
from printctl.progress import Report
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE, LINE_MAP

_NETWORK: Final = ("nodes", "vessel_nodes", "offset", "points", "radius")


@dataclass(frozen=True)
class WellBundles:
    """The strands of an embedded job.

    Attributes
    ----------
    each : sequence of Bundles
        Of every well, in the printing order.
    whole : Bundles
        All of them, vessels and strands numbered on from well to well.
    """

    each: Sequence[Bundles]
    whole: Bundles


def bundles_of(run: PlateRun) -> WellBundles | None:
    """Strands of each well; None for layers."""
    if isinstance(run.whole.recipe.toolpath, Fresh):
        return None
    own = {name: written_bundles(of) for name, of in run.runs.items()}
    each = [own[run.run_of(well).folder.name] for well in run.wells]
    vessels = [0, *accumulate(run.run_of(well).network.vessel_count for well in run.wells)]
    owner = [one.owner + first for one, first in zip(each, vessels, strict=False)]
    places = [run.place_of(well) for well in run.wells]
    strands = [one.network.moved(place) for one, place in zip(each, places, strict=True)]
    return WellBundles(each, Bundles(combine_networks(strands), np.concatenate(owner)))


def first_sources(bundles: WellBundles | None) -> Iterator[int]:
    """What to add to each well's sources so that no two strands share one; layers begin anew."""
    if bundles is None:
        return repeat(0)
    return iter([0, *accumulate(len(one.owner) for one in bundles.each)])


def wells_in_map(run: PlateRun, well_of_line: Sequence[NDArray[np.int16]]) -> dict[str, Any]:
    """Which well each line is of, what the wells are called, and where all of the plate's are."""
    standing = run.standing
    names = standing.plate.wells
    return {
        "well": np.concatenate(well_of_line),
        "wells": np.array([well.name for well in run.wells]),
        "labels": np.array([well.label for well in run.wells]),
        **well_arrays(
            names,
            np.array([standing.centre_mm(name) for name in names]),
            standing.dish,
            standing.floor_mm,
            standing.bath_mm,
            standing.safe_z_mm,
        ),
    }


def written_in_all(run: PlateRun, bundles: WellBundles) -> dict[str, NDArray[Any]]:
    """The vessels of all wells in the printer's frame, for the check of the needle's shaft."""
    each = [
        written_beside(run.run_of(well), own, ahead=False)
        for well, own in zip(run.wells, bundles.each, strict=True)
    ]
    whole = combine_networks(
        [run.run_of(well).written_network.moved(run.place_of(well)) for well in run.wells]
    )
    arrays = {f"network_{name}": getattr(whole, name) for name in _NETWORK}
    for name in ("overlap_radii", "clearance_mm"):
        arrays[name] = np.array(max(float(one[name]) for one in each))
    if not bundles.whole.is_plain:
        arrays["bundled"] = np.bincount(bundles.whole.owner) > 1
    return arrays | {"needles_mm": each[0]["needles_mm"], "place_mm": np.zeros(3)}


def combine_networks(networks: Sequence[VesselNetwork]) -> VesselNetwork:
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


NOWHERE: Final = -1
"""In the map, of a line between wells."""


@dataclass
class WellPaths:
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
        [run.place_of(well).tolist() for well in run.wells],
        [run.standing.safe_z_mm, run.standing.bath_mm, run.standing.turned_deg],
        run.standing.plate.model_dump(mode="json"),
        whole.start_mm.tolist(),
        [one.model_dump(mode="json") for one in (whole.printer, whole.syringe, whole.profile_ink)],
        [context.ink_changes.get("flow_factor") for context in run.runs.values()],
        whole.flow_ul_s,
    ]


def write_job(run: PlateRun, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Lay the paths end to end, write them as one job with a label at each well, and its map."""
    whole, laid = run.whole, WellPaths()
    kept = {name: load_toolpath(of.folder / PATH) for name, of in run.runs.items()}
    paths = {well.name: kept[run.run_of(well).folder.name] for well in run.wells}
    bundles = bundles_of(run)
    top = max(
        run.standing.safe_z_mm,
        *(paths[well.name].top_mm + run.place_of(well)[2] for well in run.wells),
    )
    printer, syringe, _, options = machine(whole, ahead=False)
    parts = _parts(run, paths, laid, first_sources(bundles))
    written = stream_gcode(parts, printer, syringe, np.zeros(3), options, top)
    # Filled while the job is written; save_gcode reads it when that is done.
    beside: dict[str, NDArray[Any]] = {}
    job = _marked(run, written, laid, beside, report)
    if bundles is not None:
        beside |= written_in_all(run, bundles)
        if not bundles.whole.is_plain:
            job = bundles.whole.of_design(job, beside)
    lines = save_gcode(whole.folder / GCODE, whole.folder / LINE_MAP, job, beside)
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
    run: PlateRun, paths: dict[str, Toolpath], laid: WellPaths, sources: Iterator[int]
) -> Iterator[Toolpath]:
    """Each well's path with the way to it, in the printer's frame."""
    at: FloatArray | None = None
    before = run.whole
    for well, number in zip(run.wells, sources, strict=False):
        of = run.run_of(well)
        doses = run.whole.ink.flow_factor / of.ink.flow_factor
        path = place_in_well(paths[well.name], run.place_of(well), doses, number)
        laid.written_ul.append(written_ul(path) / doses)
        way = 0
        if at is not None:
            path, way = with_approach(path, at, _trip(run, before, of))
        laid.first.append(laid.moves + way)
        laid.moves += len(path)
        laid.after.append(laid.moves)
        at, before = path.end[-1], of
        yield path


def _trip(run: PlateRun, before: RunContext, to: RunContext) -> Trip:
    speed = to.recipe.toolpath.travel_speed_mm_s
    return Trip(run.standing.safe_z_mm, speed, before.ink.retract_ul, before.ink.plunger_ul_s)


def _marked(
    run: PlateRun,
    parts: Iterator[Gcode],
    laid: WellPaths,
    beside: dict[str, NDArray[Any]],
    report: Report,
) -> Iterator[Gcode]:
    """The job's parts with a comment where a well begins and ends."""
    comment = dialect_of(run.whole.printer).comment
    for number, (well, part) in enumerate(zip(run.wells, parts, strict=True)):
        report((number + 1) / len(run.wells), f"well {well.name}")
        first, after = laid.first[number], laid.after[number]
        texts = {first: f"WELL:{well.name} {well.label}", after: f"WELL_END:{well.name}"}
        labelled = add_labels(part, texts, comment)
        inside = (labelled.line_move >= first) & (labelled.line_move < after)
        laid.well_of_line.append(np.where(inside, number, NOWHERE).astype(np.int16))
        yield labelled
    beside |= wells_in_map(run, laid.well_of_line)
