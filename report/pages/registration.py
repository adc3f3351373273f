"""Write the report of a run (design, flow, print, scan, registration) as one HTML file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from design.files import write_text
from design.network import VesselNetwork
from registration.json_ready import is_number
from registration.measuring.judging import list_findings
from report.figures.deviation import diameter_figure, histogram_figure, network_figure
from report.figures.finding_figures import finding_figures, views_note
from report.figures.gauging_figures import (
    MOST_PROFILES,
    curve_figure,
    layer_deviation_figure,
    parted_curve_figure,
    profile_figure,
)
from report.figures.oxygen_figures import oxygen_histogram
from report.packing import Surfaces
from report.page_frame import render, scene
from report.pages.network_view import columns, report_view
from report.picture.quantity import point_pressure
from report.scripts import ENTRY
from report.sections import facts as sections
from report.sections.added import AddedSection
from report.sections.facts import mapping, records
from report.sections.gauging import (
    defect_table,
    perfusion_table,
    printed_facts,
    two_way_rows,
)
from report.sections.key_figures import key_figures
from report.sections.measurement_tables import (
    ZONE_NOTE,
    budget_table,
    calibration_facts,
    fitted_rows,
    frame_lines,
    print_facts,
    record_facts,
    whole_table,
    zone_table,
)
from report.sections.section_view import section_view
from report.svg import inline_figure
from report.views import Views

PLACES: Final = (
    "flow",
    "fidelities",
    "oxygen",
    "design",
    "toolpath",
    "print",
    "scan",
    "registration",
)
"""Sections a figure can be put into by a prefix of its name, ``toolpath/Layer 12``."""


def write_report_html(
    path: Path,
    data: dict[str, Any],
    surfaces: Surfaces,
    network: VesselNetwork | None,
    figures: Mapping[str, bytes] | None = None,
    play: AddedSection | None = None,
    views: Views | None = None,
) -> None:
    """Write the report as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    data : dict
        What report.json holds. Every section and every number may be missing; a share
        (``within``, ``seen_fraction``) is a fraction of 1. ``registration.sign_convention``, a
        few words on which side is positive, is shown where it is given. ``numbers_file``: the
        file's name where it isn't report.json.
    surfaces : sequence of ReportSurface
        For the 3D view, in the part's frame. The first one with a scalar is shown at first.
        Above 400,000 triangles together they are simplified for the page, which says so. They may
        be packed already (`report.packing.pack_surfaces`).
    network : VesselNetwork or None
        The design, in the part's frame; ``vessel`` in `data` is its number there.
    figures : mapping of str to bytes, optional
        Caption to SVG or PNG. A prefix names the section: ``toolpath/Layer 12 of 50``; the
        sections are `PLACES`, and anything else goes into a section of its own. What is here of
        `all_figures` isn't drawn again.
    play : AddedSection, optional
        The slider over the predicted print (`report.play.play_section`).
    views : Views, optional
        Raw pictures of findings and sections.

    Raises
    ------
    ReportError
        When a figure is neither SVG nor PNG.
    OSError
        When the file can't be written.
    """
    write_text(path, report_html(data, surfaces, network, figures or {}, play, views))


def report_html(
    data: Mapping[str, Any],
    surfaces: Surfaces,
    network: VesselNetwork | None,
    figures: Mapping[str, bytes],
    play: AddedSection | None = None,
    views: Views | None = None,
) -> str:
    """The text of the page; same input, same text (see `write_report_html`)."""
    entry = f"{ENTRY} {play.entry}" if play else ENTRY
    with ThreadPoolExecutor(1) as beside:  # deflates while figures are drawn
        shown = beside.submit(view_data, data, surfaces, network)
        drawn = all_figures(data, network, figures, views)
        view = shown.result()
    context = {
        "data": data,
        "play": play and play.context,
        "view": view,
        "sections": section_view(mapping(data, "registration"), views),
        "views_note": views and views_note(views),
        "figures": placed_figures(drawn),
        **section_context(data),
    }
    return render("report.html", context, entry, play.styles if play else ())


def section_context(data: Mapping[str, Any]) -> dict[str, Any]:
    """Tables and lists of the sections that `data` holds."""
    registration, flow = mapping(data, "registration"), mapping(data, "flow")
    return {
        "key_figures": key_figures(data),
        "fit_rows": [*sections.fit_rows(registration), *two_way_rows(registration)],
        "surface_rows": sections.surface_rows(registration),
        "fitted_rows": fitted_rows(registration),
        "calibration_facts": calibration_facts(registration),
        "print_facts": print_facts(data),
        "place_rows": sections.place_rows(registration),
        "budget_table": budget_table(registration),
        "whole_table": whole_table(registration),
        "zone_table": zone_table(registration),
        "zone_note": ZONE_NOTE,
        "frame_lines": frame_lines(registration),
        "defect_table": defect_table(registration),
        "perfusion_table": perfusion_table(registration),
        "printed_facts": printed_facts(registration),
        "record_facts": record_facts(registration),
        "vessel_summary": sections.vessel_summary(registration),
        "vessel_table": sections.vessel_table(registration),
        "flow_table": sections.flow_table(flow),
        "fidelity_table": sections.fidelity_table(mapping(data, "fidelities")),
        "oxygen_table": sections.oxygen_table(mapping(data, "oxygen")),
        "check_table": sections.check_table(mapping(data, "dry_run")),
        "look_table": sections.look_table(records(data, "looks")),
        "look_note": sections.LOOK_NOTE,
        "lumen_facts": sections.lumen_facts(mapping(data, "lumens")),
        "lumen_table": sections.lumen_table(mapping(data, "lumens")),
        "timing_rows": sections.timing_rows(mapping(data, "timings")),
    }


def view_data(
    data: Mapping[str, Any], surfaces: Surfaces, network: VesselNetwork | None
) -> dict[str, Any] | None:
    """What the 3D view draws, as JSON values; None when there is nothing to draw."""
    if not surfaces and network is None:
        return None
    shown = None if network is None else report_view(network, data)
    return scene("Deviation map" if surfaces else "Network", surfaces, shown)


NETWORK_DRAWING = "design/Network, coloured by diameter"


def network_drawing(network: VesselNetwork) -> dict[str, bytes]:
    """The one drawing of `all_figures` that needs no numbers, to be made ahead of them."""
    return {NETWORK_DRAWING: network_figure(network)}


def all_figures(
    data: Mapping[str, Any],
    network: VesselNetwork | None,
    figures: Mapping[str, bytes] | None = None,
    views: Views | None = None,
) -> dict[str, bytes]:
    """The drawings that follow from the numbers themselves, and those given.

    What is given under a drawing's own name stands for it.
    """
    given = figures or {}
    made = {
        name: given[name] if name in given else draw()
        for name, draw in _drawings(data, network).items()
    }
    made |= finding_figures(mapping(data, "registration"), views, given)
    return {name: picture for name, picture in made.items() if picture is not None} | dict(given)


def _drawings(
    data: Mapping[str, Any], network: VesselNetwork | None
) -> dict[str, Callable[[], bytes | None]]:
    """How to draw what there are numbers for."""
    made: dict[str, Callable[[], bytes | None]] = {}
    registration = mapping(data, "registration")
    for fit, key in (("scaled", "counts"), ("rigid", "counts_rigid")):
        for of, part in sections.surfaces(registration).items():
            histogram = mapping(part, "histogram")
            if histogram.get(key):
                made[f"histogram/Signed deviation{of and ' of the ' + of}, {fit} fit"] = partial(
                    histogram_figure, histogram["edges_um"], histogram[key]
                )
    made |= _gauged(registration)
    made |= _oxygen(mapping(data, "oxygen"))
    gauged = records(registration, "vessels")
    if any(is_number(r.get("measured_um")) for r in gauged):
        made[
            "diameters/Mean diameter of each vessel with its 95 % interval, against the designed "
            "one and what is allowed of it"
        ] = partial(diameter_figure, _means(registration, gauged))
    if network is not None:
        made[NETWORK_DRAWING] = partial(network_figure, network)
        rows = records(mapping(data, "flow"), "vessels")
        ends = columns(rows, ("pressure_in_mmhg", "pressure_out_mmhg"), network.vessel_count)
        pressure = point_pressure(
            network, ends.get("pressure_in_mmhg"), ends.get("pressure_out_mmhg")
        )
        if pressure is not None:
            name = "flow/Pressure along the network, as designed"
            made[name] = partial(network_figure, network, pressure, "pressure / mmHg")
    return made


def _oxygen(oxygen: Mapping[str, Any]) -> dict[str, Callable[[], bytes | None]]:
    """How much of the tissue holds how much."""
    shares, level = mapping(oxygen, "histogram"), oxygen.get("threshold_millimolar")
    if not shares or not is_number(level):
        return {}
    return {"oxygen/Share of the tissue by its oxygen": partial(oxygen_histogram, shares, level)}


def _gauged(registration: Mapping[str, Any]) -> dict[str, Callable[[], bytes | None]]:
    """What was gauged: shares within, diameters along the vessels, layers."""
    curve, vessels = mapping(registration, "within_curve"), records(registration, "vessels")
    made: dict[str, Callable[[], bytes | None]] = {}
    apart = {
        of: mapping(part, "within_curve")
        for of, part in sections.surfaces(registration).items()
        if of and mapping(part, "within_curve")
    }
    if apart:
        made["curve/Share of lumens and of outer faces within any tolerance"] = partial(
            parted_curve_figure, apart
        )
    elif curve:
        made["curve/Share of the surface within any tolerance"] = partial(
            curve_figure, curve["tolerance_um"], curve["rigid"], curve["scaled"]
        )
    made[
        "profiles/Diameter along the vessels: measured with its 95 % interval (grey) and limits "
        "(blue band); sections that fail are squares, undecided ones triangles; findings are "
        f"shaded; {min(MOST_PROFILES, len(vessels))} of {len(vessels)} vessels"
    ] = partial(profile_figure, vessels, list_findings(registration))
    made["registration/Deviation of each written layer"] = partial(
        layer_deviation_figure, records(registration, "by_layer")
    )
    return made


def _means(
    registration: Mapping[str, Any], gauged: Sequence[Mapping[str, Any]]
) -> list[Mapping[str, Any]]:
    """Mean diameters as they were judged; of a file without decisions as they were measured."""
    judged = records(mapping(registration, "judging"), "features")
    return [one for one in judged if one.get("name") == "mean"] or [
        {**row, "value_um": row["measured_um"] - row["designed_um"]}
        for row in gauged
        if is_number(row.get("measured_um")) and is_number(row.get("designed_um"))
    ]


def placed_figures(figures: Mapping[str, bytes]) -> dict[str, list[tuple[str, Markup]]]:
    """Figures by section: caption and HTML each; those without a section under ``other``."""
    placed: dict[str, list[tuple[str, Markup]]] = {}
    for index, (name, picture) in enumerate(figures.items()):
        place, _, caption = name.partition("/")
        if not caption or place not in (
            *PLACES,
            "histogram",
            "curve",
            "diameters",
            "profiles",
            "findings",
        ):
            place, caption = "other", name
        html = inline_figure(picture, caption, f"f{index}-")
        placed.setdefault(place, []).append((caption, html))
    return placed
