"""The operator's page: a local web page, and the REST and WebSocket API behind it."""
