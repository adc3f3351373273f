"""Stop process: a small HTTP server beside the main one that can always stop a print.

Goes in: ``POST /stop``. Comes out: the stop, sent to the print's or station's socket. Begin with
`event_loop.py`.
"""
