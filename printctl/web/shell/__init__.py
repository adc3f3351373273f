"""Shell of every web page: header, navigation, stop button, light and dark theme."""
