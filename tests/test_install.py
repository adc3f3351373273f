"""Installing by uv: pip's settings handed on."""

import importlib.util
from pathlib import Path

import pytest

PLACE = Path(__file__).parents[1] / ".ci" / "install.py"


@pytest.fixture
def install(monkeypatch):
    spec = importlib.util.spec_from_file_location("install", PLACE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in module.NAMES.values():
        monkeypatch.delenv(name, raising=False)
    return module


def test_uv_asks_where_pip_is_told_to_ask(install):
    listed = "global.index-url='here/simple'\n:env:.find-links='/one\\n/two'\nuser.timeout='9'\n"
    assert install.settings(listed) == {
        "UV_DEFAULT_INDEX": "here/simple",
        "UV_FIND_LINKS": "/one,/two",
    }


def test_what_uv_was_told_itself_stays(install, monkeypatch):
    monkeypatch.setenv("SSL_CERT_FILE", "mine.pem")
    assert install.settings("global.cert='pips.pem'\n") == {}


def test_what_uv_cannot_install_is_left_to_pip(install, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(install, "by_uv", lambda python, what: False)

    def run(command, check):
        asked.append(command)
        return type("Done", (), {"returncode": 3})

    monkeypatch.setattr(install.subprocess, "run", run)
    assert install.main("there/python", "printctl.whl") == 3
    assert [(words[0], words[-1]) for words in asked] == [("there/python", "printctl.whl")]
    assert "now by pip" in capsys.readouterr().out
