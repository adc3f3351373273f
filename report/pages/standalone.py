"""Write the HTML report of one registration made outside a pipeline run."""

from __future__ import annotations

from pathlib import Path

from design.network import VesselNetwork
from registration.result import SIGN, RegistrationReport, report_dict, scaled_vertices
from report.deviation_surfaces import split_surfaces
from report.pages.registration import write_report_html


def write_report(
    path: Path, report: RegistrationReport, network: VesselNetwork, name: str = "scan"
) -> None:
    """Write the report's page: numbers, drawings and a 3D map of deviation; it opens offline.

    Parameters
    ----------
    path : Path
        An .html file.
    report : RegistrationReport
    network : VesselNetwork
        The design that the scan was held against.
    name : str
        Heading of the page.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    numbers = {**report_dict(report), "sign_convention": SIGN}
    surfaces = split_surfaces(
        scaled_vertices(report), report.surface.faces, report.scaled_deviation_um, network
    )
    write_report_html(path, {"recipe": name, "registration": numbers}, surfaces, network)
