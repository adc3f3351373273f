"""Start a local Dask cluster that requires TLS keys and has no web dashboard."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any


def guarded_cluster(stack: ExitStack, count: int, host: str, security: Any) -> Any:
    """Return a cluster of ``count`` processes here, to which others may come.

    A scheduler runs whatever it is sent, and every user of a network can reach its port: so
    connections ask for the key, and there is no web page.

    Parameters
    ----------
    stack : ExitStack
        Ends the settings; the cluster is its caller's to close.
    host : str
        Address it listens at.
    security : distributed.security.Security
    """
    import dask
    from distributed import LocalCluster

    no_pages: list[str] = []
    routes = {f"distributed.{who}.http.routes": no_pages for who in ("scheduler", "worker")}
    stack.enter_context(dask.config.set(routes))
    cluster = LocalCluster(
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host=host,
        protocol="tls://",
        security=security,
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
        silence_logs=40,
    )
    return stack.enter_context(cluster)
