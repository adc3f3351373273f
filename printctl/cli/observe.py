"""`printctl observe`: group of subcommands for the camera that watches prints."""

from __future__ import annotations

import typer

from printctl.cli.observe_check import check
from printctl.cli.observe_frame import frame
from printctl.cli.observe_insert import insert
from printctl.cli.observe_looks import answer, looks
from printctl.cli.observe_sweep import sweep
from printctl.cli.observe_tip import tip

observe = typer.Typer(
    help="A camera over the dish: tie it to the printer, check it; what it saw of a print.",
    no_args_is_help=True,
)
observe.command("insert")(insert)
observe.command("frame")(frame)
observe.command("check")(check)
observe.command("tip")(tip)
observe.command("sweep")(sweep)
observe.command("looks")(looks)
observe.command("answer")(answer)
