"""`printctl serve`: start the web interface."""

from __future__ import annotations

import importlib.util
import inspect
import os
import sys
import webbrowser
from pathlib import Path
from typing import Any, get_type_hints
from urllib.parse import urlsplit

import typer

from printctl.cli.declare import command, keyword
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.settings import of, opt
from printctl.web.settings import ServeSettings

NEEDED = ("fastapi", "uvicorn", "wsproto")


class _Options:
    """Options of the settings' fields; for the password the two ways to give one."""

    def parameters(self) -> list[inspect.Parameter]:
        hints = get_type_hints(ServeSettings)
        del hints["password"]
        made = [keyword(name, hint, of(ServeSettings, name)) for name, hint in hints.items()]
        ask = opt("Ask now for a password that the page asks for.", False)
        file = opt("Read that password from a file's first line.")
        made[3:3] = [
            keyword("password", bool, ask),
            keyword("password_file", Path | None, file),
        ]
        return made

    def value(self, typed: dict[str, Any]) -> ServeSettings:
        if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
            raise UsageError(
                f"the page needs {', '.join(missing)}, which isn't installed; "
                'pip install "printctl[web]"'
            )
        password = _password(typed.pop("password"), typed.pop("password_file"))
        return ServeSettings(password=password, **typed)


_OPTIONS = _Options()


@command
def serve(settings: Any = _OPTIONS, verbose: bool = opt("Write down each request.", False)) -> None:
    """Serve the operator's page: printer, job, design, scan and history in a browser.

    Only this machine can reach it, unless ``--host`` says otherwise; then a password or a token
    is needed. Ctrl-C ends the server, never a print.
    """
    from printctl.web.serving.serve import log_to_terminal  # Wants the extra `web`.
    from printctl.web.serving.serve import serve as run

    log_to_terminal(verbose)

    def started(running: Any) -> None:
        _tell(settings, running)
        if settings.open_page or (settings.open_page is None and _has_screen()):
            webbrowser.open(_link(settings, running))

    run(settings, started)
    messages().print("the page is closed; a print that runs goes on (`printctl status`)")
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # The interpreter's own end would wait for what pages had asked for.


def _password(ask: bool, file: Path | None) -> str | None:
    if ask and file is not None:
        raise UsageError("give --password or --password-file, not both")
    if file is not None:
        from printctl.web.serving.serve import refuse_readable  # loads the server

        refuse_readable(file, "--password-file")
        lines = file.read_text(encoding="utf-8").splitlines()
        if not lines or not lines[0]:
            raise UsageError(f"{file} is empty; its first line is the password")
        return lines[0]
    if ask:
        return str(typer.prompt("password", hide_input=True, confirmation_prompt=True, err=True))
    return None


def _tell(settings: ServeSettings, running: Any) -> None:
    from printctl.machine.process.clients.starting import other_speed  # Loads the link.

    say = messages().print
    say(f"the page: {_link(settings, running)}")
    say(f"workspace: {settings.workspace.resolve()}; Ctrl-C ends the server, not a print")
    port, stop = (urlsplit(one).port or 0 for one in (running.url, running.stop))
    if stop and stop != port + 1:
        say(
            f"[yellow]port {port + 1} is in use, so the stop process listens at {stop}: let that "
            "port through a firewall or tunnel, too[/]"
        )
    folder = settings.workspace.resolve() / "station"
    if other := other_speed(folder, settings.sim_speed):
        say(
            f"[yellow]--sim-speed {settings.sim_speed:g} doesn't hold yet: a printer is connected "
            f"already; {other}disconnect it on the page and connect it again, or end it first by "
            f"`printctl station disconnect --folder {folder}`[/]"
        )
    if not settings.loopback:
        say(f"other machines reach it at port {running.url.rsplit(':', 1)[1]} of this one")
        if not settings.tls:
            say(
                "[yellow]no TLS: whoever can listen on the network reads the password and can act "
                "in your name; use --tls-cert and --tls-key, or an SSH tunnel[/]"
            )


def _link(settings: ServeSettings, running: Any) -> str:
    return f"{running.url}/?token={running.token}" if settings.token_link else str(running.url)


def _has_screen() -> bool:
    if not sys.stderr.isatty() or "SSH_CONNECTION" in os.environ:
        return False
    linux = sys.platform.startswith("linux")
    return not linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
