"""The process that owns a printer's port from connecting to parting, its socket, its clients.

Goes in: a port to open, or a print order. Comes out: a process that carries it out, and clients of
it. Begin with `machine.py`.

One entry (``python -m printctl.machine.process``), one socket, one vocabulary (`vocabulary.WORDS`).
Two threads of a process matter: the one that owns the port does all that is said to the printer;
the socket server's takes requests and gives them to it. A third does nothing but kill.

========================  =====================================================================
mode (`StationState`)     who speaks to the printer, and what may be requested
========================  =====================================================================
connecting                the standby's handshake; kill
ready, busy               `Standby`; moves, heat, console, mount, print, close
printing                  `Streamer`; stop, pause, resume, reload, looks, console
halted, lost              nobody; reconnect, mount, close
closed                    the process ends
========================  =====================================================================

``status``, ``subscribe``, ``kill`` and ``detach`` pass in every mode. A print is something that
the process does: `station_print` for a client's request on an open printer, `one_print` on a port
that is opened for this print and given up after it, without an idle command before or after (which
would number the printer's lines anew, so that an interrupted print couldn't be gone on with).

=====================  ========================================================================
file                   what
=====================  ========================================================================
`machine`              the printer and its mode: what any thread may read, request, kill
`vocabulary`           table of requests: values, modes, what they do
`socket_server`        clients; none of them holds another up
`station`              the process of a printer that stays connected: main loop, reconnecting
`station_print`        a print in it: whether it may begin, and what it changed
`one_print`            a print itself: its folder, link.json, journal, wire log
`plug`                 where the printer is plugged in, or started as a simulated one
`client`, `starting`   what other programs use
`contact`, `launch`    contact files, locks, sockets; processes that outlive their parent
`outcome`              how a print whose process has gone ended; whether it can be resumed
=====================  ========================================================================
"""
