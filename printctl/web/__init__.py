"""Web server for operators: browser pages, REST API, event WebSocket, access guard, stop process.

Goes in: a workspace folder. Comes out: pages, REST API and WebSocket of one server. Begin with
`serving/serve.py`.
"""
