"""Console and macros of the Printer page."""

import pytest

from printctl.machine.link.errors import Refused
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.printer.macros import Macro
from printctl.web.printer.service import PrinterService
from tests.printctl.web.printer.conftest import ME


def test_replies_and_refusals_stand_in_the_log_of_all(service: PrinterService) -> None:
    assert any("FIRMWARE_NAME" in line for line in service.console.send(ME, "M115"))
    with pytest.raises(Refused, match="manual use"):
        service.console.send(ME, "M112")
    said, refused = service.console.entries()[-2:]
    assert (said.text, said.who, said.refused) == ("M115", "the operator", "")
    assert "manual use" in refused.refused
    assert service.core.events.latest["console"]["text"] == "M112"
    assert service.console.entries(after=said.number) == [refused]


@pytest.mark.parametrize("typed", ["", "  ", "M105\nM112", "M117 é", "G1" + "0" * 300])
def test_what_is_not_one_command_is_not_sent(service: PrinterService, typed: str) -> None:
    with pytest.raises(BadRequestError, match="isn't one command"):
        service.console.send(ME, typed)


def test_a_macro_is_kept_run_and_removed(service: PrinterService) -> None:
    macro = Macro(name="where <b>", commands=("M114", "M105"))
    service.macros.save(ME, "generic_marlin", macro)
    again = Macro(name="where <b>", commands=("M114",))
    service.macros.save(ME, "generic_marlin", again)
    assert service.macros.of("generic_marlin") == [again]
    kept = service.core.workspace.private / "macros" / "generic_marlin.yaml"
    assert kept.is_file()
    assert any("X:" in line for line in service.macros.run(ME, "where <b>"))
    service.macros.remove(ME, "generic_marlin", "where <b>")
    with pytest.raises(NotFoundError):
        service.macros.run(ME, "where <b>")


def test_a_macro_holds_nothing_that_the_console_refuses(idle: PrinterService) -> None:
    bad = Macro(name="halt", commands=("M105", "M112"))
    with pytest.raises(BadRequestError, match="line 2: M112"):
        idle.macros.save(ME, "generic_marlin", bad)
    assert idle.macros.of("generic_marlin") == []


def test_a_macro_that_was_smuggled_into_the_file_is_not_run(service: PrinterService) -> None:
    path = service.core.workspace.private / "macros" / "generic_marlin.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text("macros: [{name: bad, commands: [M105, G91]}]")
    sent = len(service.console.entries())
    with pytest.raises(BadRequestError, match="G91"):
        service.macros.run(ME, "bad")
    assert len(service.console.entries()) == sent
    path.unlink()
