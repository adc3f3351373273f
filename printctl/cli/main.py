"""The command line: what the subcommands are, and how failures leave it.

Exit codes: 0 done, 1 failed, 2 wrong use, 3 a safety check refused, 4 the printer failed.
"""

from __future__ import annotations

import errno
import sys

import typer
from rich.console import Console

from design.errors import DesignError
from firmware_profiles import ProfileError
from printctl.cli.alive import alive
from printctl.cli.calibrate import calibrate
from printctl.cli.convert import convert
from printctl.cli.design import design
from printctl.cli.doctor import doctor
from printctl.cli.history import history
from printctl.cli.init import init
from printctl.cli.lumens import lumens
from printctl.cli.measure import measure
from printctl.cli.pause import pause
from printctl.cli.ports import ports
from printctl.cli.print_job import print_job
from printctl.cli.profiles import ShowByDefault, show
from printctl.cli.profiles_check import check
from printctl.cli.profiles_probe import probe
from printctl.cli.recover import recover
from printctl.cli.register import register
from printctl.cli.reload import reload
from printctl.cli.resume import resume
from printctl.cli.run import run
from printctl.cli.sim_printer import sim_printer
from printctl.cli.simulate import simulate
from printctl.cli.slice import slice_mesh
from printctl.cli.solid import solid
from printctl.cli.status import status
from printctl.cli.toolpath import toolpath
from printctl.cli.view import view
from printctl.errors import PrintctlError
from printctl.link.errors import HistoryError, JournalError, LinkError, NoLink, Refused
from registration.errors import RegistrationError

app = typer.Typer(
    name="printctl",
    help="From a tissue's shape to a perfusable print, and the proof that the print is right.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
profiles = typer.Typer(
    cls=ShowByDefault, help="Known printers and materials: list, show, check, ask a printer."
)
profiles.command("show")(show)
profiles.command("check")(check)
profiles.command("probe")(probe)
app.command("run")(run)
app.command("design")(design)
app.command("toolpath")(toolpath)
app.command("slice")(slice_mesh)
app.command("simulate")(simulate)
app.command("print")(print_job)
app.command("status")(status)
app.command("pause")(pause)
app.command("resume")(resume)
app.command("reload")(reload)
app.command("alive")(alive)
app.command("recover")(recover)
app.command(
    "sim-printer", context_settings={"allow_extra_args": True, "ignore_unknown_options": True}
)(sim_printer)
app.command("register")(register)
app.command("view")(view)
app.command("convert")(convert)
app.command("solid")(solid)
app.command("measure")(measure)
app.command("lumens")(lumens)
app.command("ports")(ports)
app.add_typer(profiles, name="profiles")
app.add_typer(history, name="history")
app.add_typer(calibrate, name="calibrate")
app.command("doctor")(doctor)
app.command("init")(init)


def main() -> None:
    """Run the command line; a user's mistake ends in one message, never in a traceback."""
    try:
        app(standalone_mode=True)
    except PrintctlError as exc:
        _fail(str(exc), exc.exit_code)
    except (NoLink, JournalError, HistoryError, Refused) as exc:  # not the printer's fault
        _fail(str(exc), 1)
    except LinkError as exc:
        _fail(str(exc), 4)
    except ProfileError as exc:
        _fail(str(exc), 2)
    except (DesignError, RegistrationError) as exc:
        _fail(str(exc), 1)
    except OSError as exc:
        _fail(_disk_message(exc), 1)
    except KeyboardInterrupt:
        _fail("interrupted; run the same command again to go on from the last finished stage", 1)


def _fail(message: str, code: int) -> None:
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        f"[bold red]printctl:[/] {message.replace('[', chr(92) + '[')}"
    )
    sys.exit(code)


def _disk_message(exc: OSError) -> str:
    """Name the file and the remedy of a failed read or write."""
    place = f" ({exc.filename})" if exc.filename else ""
    if exc.errno == errno.ENOSPC:
        return (
            f"the disk is full{place}; free some space and run the same command again: files that "
            "were there before are untouched"
        )
    return f"{exc.strerror or exc}{place}"
