"""Stop process: a small HTTP server beside the main one that can always stop a print."""
