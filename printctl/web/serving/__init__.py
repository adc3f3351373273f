"""The page's server process, its sockets and the second one that only stops.

Goes in: settings. Comes out: a server. Begin with `serve.py`.
"""
