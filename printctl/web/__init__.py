"""Web interface for operators: pages, REST API and WebSocket.

Goes in: a workspace folder. Comes out: pages, REST API and WebSocket of one server. Begin with
`serve.py`.
"""
