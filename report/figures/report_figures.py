"""Figures of a report, in the page's order: what each is drawn from, its section and caption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.gcode_job import GcodeJob
from registration.json_ready import Record, is_number
from registration.measuring.judging import list_findings
from report.figures.deviation import diameter_figure, histogram_figure, network_figure
from report.figures.finding_figures import finding_figures
from report.figures.flow_figures import wave_figure
from report.figures.gauging_figures import (
    MOST_PROFILES,
    curve_figure,
    layer_deviation_figure,
    parted_curve_figure,
    profile_figure,
)
from report.figures.layer_figures import OutlineAt, layer_figures
from report.figures.look_figure import LookRow, look_figures
from report.figures.oxygen_figures import oxygen_histogram
from report.picture.quantity import point_pressure
from report.sections import facts
from report.sections.facts import mapping, records
from report.sections.tables import columns
from report.svg import inline_figure
from report.views import Views

SECTIONS: Final = (
    "flow", "fidelities", "oxygen", "design", "toolpath", "print", "scan", "registration",
    "histogram", "curve", "diameters", "profiles", "findings",
)  # fmt: skip
"""A figure's name is ``section/caption``; of any other section it goes among further figures."""

Drawing = tuple[str, Callable[[], bytes | None]]
"""A figure's name, and what draws it; None where there is nothing to draw."""


def _histograms(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    for fit, key in (("scaled", "counts"), ("rigid", "counts_rigid")):
        for of, part in facts.surfaces(mapping(data, "registration")).items():
            histogram = mapping(part, "histogram")
            if histogram.get(key):
                yield (
                    f"histogram/Signed deviation{of and ' of the ' + of}, {fit} fit",
                    partial(histogram_figure, histogram["edges_um"], histogram[key]),
                )


def _within(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    registration = mapping(data, "registration")
    curve = mapping(registration, "within_curve")
    apart = {
        of: mapping(part, "within_curve")
        for of, part in facts.surfaces(registration).items()
        if of and mapping(part, "within_curve")
    }
    if apart:
        name = "curve/Share of lumens and of outer faces within any tolerance"
        yield name, partial(parted_curve_figure, apart)
    elif curve:
        yield (
            "curve/Share of the surface within any tolerance",
            partial(curve_figure, curve["tolerance_um"], curve["rigid"], curve["scaled"]),
        )


def _profiles(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    registration = mapping(data, "registration")
    vessels = records(registration, "vessels")
    yield (
        "profiles/Diameter along the vessels: measured with its 95 % interval (grey) and limits "
        "(blue band); sections that fail are squares, undecided ones triangles; findings are "
        f"shaded; {min(MOST_PROFILES, len(vessels))} of {len(vessels)} vessels",
        partial(profile_figure, vessels, list_findings(registration)),
    )


def _layer_deviation(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    layers = records(mapping(data, "registration"), "by_layer")
    yield "registration/Deviation of each written layer", partial(layer_deviation_figure, layers)


def _oxygen(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    oxygen = mapping(data, "oxygen")
    shares, level = mapping(oxygen, "histogram"), oxygen.get("threshold_millimolar")
    if shares and is_number(level):
        name = "oxygen/Share of the tissue by its oxygen"
        yield name, partial(oxygen_histogram, shares, level)


def _diameters(data: Record, _: VesselNetwork | None) -> Iterator[Drawing]:
    """Mean diameters as they were judged; of a file without decisions as they were measured."""
    registration = mapping(data, "registration")
    gauged = [r for r in records(registration, "vessels") if is_number(r.get("measured_um"))]
    if not gauged:
        return
    judged = records(mapping(registration, "judging"), "features")
    means = [one for one in judged if one.get("name") == "mean"] or [
        {**row, "value_um": row["measured_um"] - row["designed_um"]}
        for row in gauged
        if is_number(row.get("designed_um"))
    ]
    yield (
        "diameters/Mean diameter of each vessel with its 95 % interval, against the designed "
        "one and what is allowed of it",
        partial(diameter_figure, means),
    )


NETWORK_DRAWING: Final = "design/Network, coloured by diameter"


def _network(data: Record, network: VesselNetwork | None) -> Iterator[Drawing]:
    if network is None:
        return
    yield NETWORK_DRAWING, partial(network_figure, network)
    rows = records(mapping(data, "flow"), "vessels")
    ends = columns(rows, ("pressure_in_mmhg", "pressure_out_mmhg"), network.vessel_count)
    pressure = point_pressure(network, ends.get("pressure_in_mmhg"), ends.get("pressure_out_mmhg"))
    if pressure is not None:
        name = "flow/Pressure along the network, as designed"
        yield name, partial(network_figure, network, pressure, "pressure / mmHg")


FIGURES: Final[tuple[Callable[[Record, VesselNetwork | None], Iterator[Drawing]], ...]] = (
    _histograms, _within, _profiles, _layer_deviation, _oxygen, _diameters, _network,
)  # fmt: skip
"""Figures that follow from report.json's numbers, in the page's order."""


def network_drawing(network: VesselNetwork) -> dict[str, bytes]:
    """The one drawing of `all_figures` that needs no numbers, to be made ahead of them."""
    return {NETWORK_DRAWING: network_figure(network)}


def all_figures(
    data: Mapping[str, Any],
    network: VesselNetwork | None,
    figures: Mapping[str, bytes] | None = None,
    views: Views | None = None,
) -> dict[str, bytes]:
    """The drawings that follow from the numbers themselves (`FIGURES`, findings), and those given.

    What is given under a drawing's own name stands for it.
    """
    given = figures or {}
    made = {
        name: given[name] if name in given else draw()
        for figures_of in FIGURES
        for name, draw in figures_of(data, network)
    }
    made |= finding_figures(mapping(data, "registration"), views, given)
    return {name: picture for name, picture in made.items() if picture is not None} | dict(given)


PICTURE_FILES: Final = {
    "shear": "fidelities/Wall shear, resolved in the lumens",
    "compared": "fidelities/Fidelities against the ideal",
    "beside": "fidelities/Flow across the vessels that feed, and across a lattice's",
    "oxygen": "oxygen/Oxygen in a plane through the middle of the widest hypoxic place, or the one "
    "with least (cross); vessels within a cell of it are light lines, the orange line is the "
    "threshold",
}
"""Names of the figures that stages of a run draw into files."""


@dataclass(frozen=True, eq=False)
class RunSources:
    """What a run has for figures besides the numbers of report.json.

    Attributes
    ----------
    waves : mapping of str to (n,) float64, optional
        Of `report.figures.flow_figures.wave_figure`.
    files : mapping of str to Path
        Pictures drawn by stages, by the keys of `PICTURE_FILES`.
    job : GcodeJob, optional
    outline_at : callable, optional
        The design's outline in a layer of the job.
    looks : sequence of LookRow
    """

    waves: Mapping[str, FloatArray] | None = None
    files: Mapping[str, Path] = field(default_factory=dict)
    job: GcodeJob | None = None
    outline_at: OutlineAt | None = None
    looks: Sequence[LookRow] = ()


def run_figures(run: RunSources) -> dict[str, bytes]:
    """Draw or read the figures of a run that report.json has no numbers for, by name.

    Raises
    ------
    OSError
        When a picture can't be read.
    """
    made: dict[str, bytes] = {}
    if run.waves is not None:
        name = "flow/Flow and pressure at inlets and outlets over one cycle, as designed"
        made[name] = wave_figure(run.waves)
    made |= {
        name: run.files[key].read_bytes() for key, name in PICTURE_FILES.items() if key in run.files
    }
    if run.job is not None:
        made |= layer_figures(run.job, run.outline_at)
    return made | look_figures(run.looks)


def placed_figures(figures: Mapping[str, bytes]) -> dict[str, list[tuple[str, Markup]]]:
    """Figures by section: caption and HTML each; those without a section under ``other``."""
    placed: dict[str, list[tuple[str, Markup]]] = {}
    for index, (name, picture) in enumerate(figures.items()):
        place, _, caption = name.partition("/")
        if not caption or place not in SECTIONS:
            place, caption = "other", name
        html = inline_figure(picture, caption, f"f{index}-")
        placed.setdefault(place, []).append((caption, html))
    return placed
