"""Access control of the web server: guard middleware, log-in, sessions, origins, uploads.

Goes in: a request. Comes out: the request let through, or a refusal. Begin with `guard.py`.
"""
