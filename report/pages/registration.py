"""Write the report of a run (design, flow, print, scan, registration) as one HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from design.files import write_text
from design.network import VesselNetwork
from report.figures.finding_figures import views_note
from report.figures.report_figures import all_figures, placed_figures
from report.packing import Surfaces
from report.page_frame import render, scene
from report.pages.network_view import report_view
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
from report.views import Views


def write_report_html(
    path: Path,
    data: dict[str, object],
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
        sections are `report.figures.report_figures.SECTIONS`, and anything else goes into a
        section of its own. What is here of `all_figures` isn't drawn again.
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


def section_context(data: Mapping[str, Any]) -> dict[str, object]:
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
) -> dict[str, object] | None:
    """What the 3D view draws, as JSON values; None when there is nothing to draw."""
    if not surfaces and network is None:
        return None
    shown = None if network is None else report_view(network, data)
    return scene("Deviation map" if surfaces else "Network", surfaces, shown)
