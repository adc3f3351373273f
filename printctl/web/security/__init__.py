"""Access control of the web server: guard middleware, sessions, log-in, uploads.

Goes in: a request. Comes out: the request let through, or a refusal. Begin with `guard.py`.
"""
