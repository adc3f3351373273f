"""`printctl profiles`: list, show, check and probe profiles of printers and materials."""

from __future__ import annotations

import typer

from printctl.cli.profiles_check import check
from printctl.cli.profiles_probe import probe
from printctl.cli.profiles_show import ProfileGroup, show

profiles = typer.Typer(
    cls=ProfileGroup, help="Known printers and materials: list, show, check, ask a printer."
)
profiles.command("show")(show)
profiles.command("check")(check)
profiles.command("probe")(probe)
