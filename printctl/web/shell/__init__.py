"""Parts shared by all web pages: page frame, assets, dialogs, file upload, notifications.

Goes in: a page's content. Comes out: the page in its frame. Begin with `frame.py`.
"""
