"""Entry point of the process that builds live-view scenes (``python -m printctl.web.live``)."""

from printctl.web.live.scene_worker import main

if __name__ == "__main__":
    main()
