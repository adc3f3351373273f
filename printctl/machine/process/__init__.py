"""The processes that own a printer's port, their socket, and their clients.

Goes in: an order. Comes out: a process that carries it out, and clients of it. Begin with
`process.py`.
"""
