"""What every page has: header, ways between the pages, the red stop, light and dark."""
