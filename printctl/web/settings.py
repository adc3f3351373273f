"""Settings of `printctl serve`: workspace, address, password, TLS, upload limit, camera."""

from __future__ import annotations

import ipaddress
from pathlib import Path

from printctl.errors import UsageError
from printctl.settings import arg, opt, settings

MAX_PORT = 65535


def camera_source(name: str | None) -> str | None:
    """Return what OpenCV reads for ``--camera``: a device's number or name, a file, an address.

    Raises
    ------
    UsageError
        When it names nothing.
    """
    if name is None or name.isdecimal() or "://" in name:
        return name
    if not name.strip():
        raise UsageError("--camera is empty; give a number, a device, a file or an address")
    # Links stay: a device's lasting name points to the one that it is now.
    path = Path(name).absolute()  # files are found from any folder
    if not path.parent.is_dir():
        raise UsageError(f"--camera {name}: there is no folder {path.parent}")
    return str(path)


@settings
class ServeSettings:
    """Where the page is served, and to whom: the options, and the password that was given."""

    workspace: Path = arg("Folder of recipes, runs, jobs, scans and prints.", Path("workspace"))
    host: str = opt("Address to listen at; 0.0.0.0 for every one of this machine.", "127.0.0.1")
    port: int = opt("Port; 0 for any that is free.", 8080, min=0, max=MAX_PORT)
    password: str | None = None
    token_link: bool = opt("Let browsers in by a link with a token, shown here.", False, "--token")
    tls_cert: Path | None = opt("Certificate (PEM): serve by HTTPS.")
    tls_key: Path | None = opt("The certificate's key (PEM).")
    names: list[str] | None = opt(
        "A further name of this machine that browsers may use; repeatable.", None, "--name"
    )
    open_page: bool | None = opt(
        "Open the page in a browser; else where one is.", None, "--open/--no-open"
    )
    sim_speed: float = opt(
        "Simulated printer's speed, times real time; 0: all it can.", 1.0, min=0.0
    )
    upload_mb: float = opt("Largest upload, MB.", 4000.0, min=1.0)
    camera: str | None = opt(
        "Show a camera on the Job page: its number, /dev/video0, an address, or a film or "
        "pictures (frames_%03d.png).",
        callback=camera_source,
    )

    def __repr__(self) -> str:
        """Without the password, and the camera's, which its address may hold."""
        return f"ServeSettings({self.host}, {self.port}, {self.workspace})"

    @property
    def loopback(self) -> bool:
        """Whether only this machine can reach the page."""
        return is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether a visit of a page suffices to be let in."""
        return self.loopback and self.password is None and not self.token_link

    @property
    def tls(self) -> bool:
        """Whether what goes over the line is encrypted."""
        return self.tls_cert is not None

    @property
    def scheme(self) -> str:
        """As in the page's address."""
        return "https" if self.tls else "http"


def is_loopback(host: str) -> bool:
    """Whether an address or name never leaves this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]").split("%")[0]).is_loopback
    except ValueError:
        return False
