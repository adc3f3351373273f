"""`printctl station mount`: declare needle, syringe, ink, dish and bath on the printer."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from printctl.checks.set_up import read_dish_centre
from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station
from printctl.errors import UsageError


def _said(what: str) -> Any:
    return typer.Option(help=f"{what}: a shipped profile or a .yaml file; '' for none.")


def mount(
    needle: Annotated[str | None, _said("Needle")] = None,
    syringe: Annotated[str | None, _said("Syringe, full")] = None,
    ink: Annotated[str | None, _said("Ink")] = None,
    dish: Annotated[str | None, _said("Dish")] = None,
    bath: Annotated[str | None, _said("Bath")] = None,
    dish_centre: Annotated[
        str | None, typer.Option("--dish-centre", metavar="X,Y", help="Of the dish, mm.")
    ] = None,
    bath_level: Annotated[
        float | None, typer.Option("--bath-level", help="Z of the bath's surface, mm.")
    ] = None,
    plunger: Annotated[
        float | None, typer.Option("--plunger-mm", help="Travel of the syringe that is used up.")
    ] = None,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Say what is mounted; the soft limits go by it.

    Another needle or dish must be touched off anew.
    """
    given = {
        "needle": needle,
        "syringe": syringe,
        "ink": ink,
        "dish": dish,
        "bath": bath,
        "dish_centre_mm": None if dish_centre is None else read_dish_centre(dish_centre),
        "bath_level_mm": bath_level,
        "plunger_mm": plunger,
    }
    named = {key: value for key, value in given.items() if value is not None}
    if not named:
        raise UsageError("nothing is named; give --needle, --dish or the like")
    print_status(the_station(folder).mount(**named), as_json)
