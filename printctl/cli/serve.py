"""`printctl serve`: the operator's page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def serve(
    workspace: Annotated[Path, typer.Argument(help="Folder of the page.")] = Path("printctl-work"),
    host: Annotated[str, typer.Option(help="Address to listen at.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 for any that is free.")] = 8080,
    sim_speed: Annotated[float, typer.Option(help="Simulated printer's speed.")] = 1.0,
) -> None:
    """Serve the operator's page."""
    from printctl.web.serve import serve as run  # Wants the extra `web`.
    from printctl.web.settings import ServeSettings

    run(ServeSettings(workspace, host, port, sim_speed=sim_speed))
