"""General routes of the REST API: health, event stream, control lock, stop.

Goes in: HTTP requests. Comes out: JSON, and errors in one shape. Begin with `routes.py`.
"""
