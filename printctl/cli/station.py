"""`printctl station`: group of subcommands for a lasting printer connection between prints."""

from __future__ import annotations

import typer

from printctl.cli.station_connect import connect
from printctl.cli.station_disconnect import disconnect
from printctl.cli.station_heat import heat
from printctl.cli.station_home import home
from printctl.cli.station_jog import jog
from printctl.cli.station_kill import kill
from printctl.cli.station_mount import mount
from printctl.cli.station_push import push
from printctl.cli.station_reconnect import reconnect
from printctl.cli.station_send import send
from printctl.cli.station_status import status
from printctl.cli.station_stop import stop
from printctl.cli.station_touch_off import touch_off
from printctl.cli.station_where import where

station = typer.Typer(
    help="Connect a printer, move it by hand within soft limits, and have it ready to print.",
    no_args_is_help=True,
)
station.command("connect")(connect)
station.command("status")(status)
station.command("mount")(mount)
station.command("jog")(jog)
station.command("home")(home)
station.command("where")(where)
station.command("touch-off")(touch_off)
station.command("push")(push)
station.command("heat")(heat)
station.command("send")(send)
station.command("stop")(stop)
station.command("kill")(kill)
station.command("reconnect")(reconnect)
station.command("disconnect")(disconnect)
