"""The printer: link process, manual commands, prints and their state."""
