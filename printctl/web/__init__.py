"""Web interface for operators: pages, REST API and WebSocket."""
