"""What `printctl serve` is told."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

LOOPBACK: Final = "127.0.0.1"
PORT: Final = 8080


@dataclass(frozen=True)
class ServeSettings:
    """Where the page is served, and to whom.

    Attributes
    ----------
    workspace : Path
        Folder of recipes, runs, jobs, scans and prints.
    host : str
        Address to listen at; the loopback unless told otherwise.
    port : int
        0 for any that is free.
    password : str or None
        Asked for at the door; beyond the loopback there must be one, or a token.
    upload_mb : float, MB
        Largest upload.
    sim_speed : float
        Of the simulated printer, times real time; 0 for as fast as it can.
    """

    workspace: Path
    host: str = LOOPBACK
    port: int = PORT
    password: str | None = field(default=None, repr=False)
    upload_mb: float = 4000.0
    sim_speed: float = 1.0
