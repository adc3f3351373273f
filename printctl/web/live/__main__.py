"""Entry point of the process that builds live-view scenes (``python -m printctl.web.live``)."""

from kernels import without_numba

if __name__ == "__main__":
    without_numba()  # before modules with kernels are imported
    from printctl.web.live.scene_worker import main

    main()
