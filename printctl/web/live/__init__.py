"""Live 3D view of a print: scene, REST routes, page element.

Goes in: a job's file. Comes out: a binary scene, drawn in the browser. Begin with `scene.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from printctl.web.live.scene import LiveScene, make_scene
    from printctl.web.live.source import JobSource, SceneError

__all__ = ["JobSource", "LiveScene", "SceneError", "make_scene"]

__getattr__, __dir__ = on_demand(__name__)
