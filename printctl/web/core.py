"""Settings, workspace, control lock and event publisher of one web server, for all its pages."""

from __future__ import annotations

from dataclasses import dataclass, field

from printctl.web.controls import Controls
from printctl.web.events import Events
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace


@dataclass(frozen=True)
class Core:
    """Settings, workspace, controls and news of one server.

    Attributes
    ----------
    settings : ServeSettings
    workspace : Workspace
    controls : Controls
    events : Events
    """

    settings: ServeSettings
    workspace: Workspace
    controls: Controls = field(default_factory=Controls)
    events: Events = field(default_factory=Events)
