"""Frame of every page: header, navigation, the red stop, light and dark."""
