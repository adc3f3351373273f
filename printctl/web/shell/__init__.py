"""Shell of every web page: header, navigation, stop button, light and dark theme.

Goes in: a page's content. Comes out: the page in its frame. Begin with `frame.py`.
"""
