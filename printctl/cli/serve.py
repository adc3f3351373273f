"""`printctl serve`: start the web interface."""

from __future__ import annotations

import importlib.util
import os
import sys
import webbrowser
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import typer

from printctl.cli.declare import command
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.settings import arg, opt

NEEDED = ("fastapi", "uvicorn", "wsproto")
_AT_MOST_PORT = 65535


@command
def serve(
    workspace: Path = arg("Folder of recipes, runs, jobs, scans and prints.", Path("workspace")),
    host: str = opt("Address to listen at; 0.0.0.0 for every one of this machine.", "127.0.0.1"),
    port: int = opt("Port; 0 for any that is free.", 8080, min=0, max=_AT_MOST_PORT),
    password: bool = opt("Ask now for a password that the page asks for.", False),
    password_file: Path | None = opt("Read that password from a file's first line."),
    token: bool = opt("Let browsers in by a link with a token, shown here.", False),
    tls_cert: Path | None = opt("Certificate (PEM): serve by HTTPS."),
    tls_key: Path | None = opt("The certificate's key (PEM)."),
    name: list[str] | None = opt(
        "A further name of this machine that browsers may use; repeatable."
    ),
    open_page: bool | None = opt(
        "Open the page in a browser; else where one is.", None, "--open/--no-open"
    ),
    sim_speed: float = opt(
        "Simulated printer's speed, times real time; 0: all it can.", 1.0, min=0.0
    ),
    upload_mb: float = opt("Largest upload, MB.", 4000.0, min=1.0),
    camera: str | None = opt(
        "Show a camera on the Job page: its number, /dev/video0, an address, or a film or "
        "pictures (frames_%03d.png)."
    ),
    verbose: bool = opt("Write down each request.", False),
) -> None:
    """Serve the operator's page: printer, job, design, scan and history in a browser.

    Only this machine can reach it, unless ``--host`` says otherwise; then a password or a token
    is needed. Ctrl-C ends the server, never a print.
    """
    _want_extra()
    from printctl.web.job.camera.camera import source_of
    from printctl.web.serve import log_to_terminal  # Wants the extra `web`.
    from printctl.web.serve import serve as run
    from printctl.web.settings import ServeSettings

    settings = ServeSettings(
        workspace=workspace,
        host=host,
        port=port,
        password=_password(password, password_file),
        token_link=token,
        upload_mb=upload_mb,
        sim_speed=sim_speed,
        tls_cert=tls_cert,
        tls_key=tls_key,
        names=tuple(name or ()),
        camera=None if camera is None else source_of(camera),
    )
    log_to_terminal(verbose)

    def started(running: Any) -> None:
        _tell(settings, running)
        if open_page or (open_page is None and _has_screen()):
            webbrowser.open(_link(settings, running))

    run(settings, started)
    messages().print("the page is closed; a print that runs goes on (`printctl status`)")
    _leave()


def _leave() -> None:
    """End now: the interpreter's own end would wait for what pages had asked for."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _want_extra() -> None:
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise UsageError(
            f"the page needs {', '.join(missing)}, which isn't installed; "
            'pip install "printctl[web]"'
        )


def _password(ask: bool, file: Path | None) -> str | None:
    if ask and file is not None:
        raise UsageError("give --password or --password-file, not both")
    if file is not None:
        lines = file.read_text(encoding="utf-8").splitlines()
        if not lines or not lines[0]:
            raise UsageError(f"{file} is empty; its first line is the password")
        return lines[0]
    if ask:
        return str(typer.prompt("password", hide_input=True, confirmation_prompt=True, err=True))
    return None


def _tell(settings: Any, running: Any) -> None:
    from printctl.machine.station.client import other_speed  # Loads the link.

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


def _link(settings: Any, running: Any) -> str:
    return f"{running.url}/?token={running.token}" if settings.token_link else str(running.url)


def _has_screen() -> bool:
    if not sys.stderr.isatty() or "SSH_CONNECTION" in os.environ:
        return False
    linux = sys.platform.startswith("linux")
    return not linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
