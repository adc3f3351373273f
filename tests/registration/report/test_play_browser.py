import re
from pathlib import Path

from registration.report.play import write_play_html

from .play_sample import layered, passes
from .test_browser import opened, pytestmark, state  # noqa: F401

ACT = (
    "const wait = (ms) => new Promise((done) => setTimeout(done, ms));"
    "while (document.documentElement.dataset.state !== 'ready') await wait(50);"
    "const at = (id) => document.getElementById(`play-${id}`);"
    "const say = (text) => { document.title += ` ${text}`; };"
    "const now = async () => { await wait(200); say(at('clock').textContent.split(' ')[0]); };"
    "const key = (name, more = {}) => at('stage').dispatchEvent(new KeyboardEvent('keydown',"
    " { key: name, bubbles: true, ...more }));"
    "const hue = () => { const c = at('stage').querySelector('canvas');"
    " const copy = new OffscreenCanvas(c.width, c.height).getContext('2d',"
    " { willReadFrequently: true }); copy.drawImage(c, 0, 0);"
    " const d = copy.getImageData(0, 0, c.width, c.height).data;"
    " let n = 0; for (let i = 0; i < d.length; i += 4) if (d[i + 2] > d[i] + 40) n++; return n; };"
)


def played(folder: Path, job, script: str) -> tuple[str, list[str]]:
    """The DOM after ``script`` ran beside the page's own, and the words it said."""
    path = folder / "play.html"
    write_play_html(path, job, "job")
    text = path.read_text(encoding="utf-8")
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    added = f'<script type="module">{ACT}{script} await wait(100);</script></body>'
    path.write_text(text.replace("</body>", added), encoding="utf-8")
    dom, console, urls = opened(path)
    assert console == []
    assert urls == []
    assert state(dom, 'div class="viewer play"') == "ready"
    return dom, re.search(r"<title>(.*?)</title>", dom, re.S).group(1).split()[4:]


def test_address_keys_marks_and_list_go_through_the_time(tmp_path: Path) -> None:
    script = (
        "await now(); const all = hue(); location.hash = '#t=0.5'; await now();"
        "say(at('tag').textContent.replaceAll(' ', '')); const half = hue();"
        "say(half < all && all > 0);"
        "key('ArrowDown'); await now(); key('ArrowUp'); await now();"
        "key('ArrowLeft', { shiftKey: true }); await now(); key('Home'); await now();"
        "document.querySelector('.go').click(); await now();"
        "key('Home'); document.querySelector('.mark').click(); await now();"
        "key(' '); await wait(600); key(' ');"
        "say(Number(at('time').value) > 7); say(at('play').textContent);"
    )
    dom, said = played(tmp_path, layered(), script)
    # Layer 1 ends at 3 s, layer 2 begins at 5 s and ends at 9 s, its last stretch begins at 8 s.
    assert said == ["0:09.0", "0:04.5", "Layer2of2", "true", "0:03.0", "0:09.0", "0:08.0",
                    "0:00.0", "0:07.0", "0:07.0", "true", "▶"]  # fmt: skip
    assert "much too thin" in dom


def test_numbers_and_colours_follow_the_moment(tmp_path: Path) -> None:
    script = (
        "location.hash = '#t=0.9&colour=head'; await now(); say(at('colouring').value);"
        "say(at('legend').querySelectorAll('.swatches:first-of-type i').length > 0);"
    )
    dom, said = played(tmp_path, passes(), script)
    assert said == ["0:04.5", "head", "true"]
    numbers = re.search(r'id="play-numbers">(.*?)</dl>', dom, re.S).group(1)
    told = dict(re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", numbers))
    assert told["Pass"].startswith("3,")
    assert told["Width"] == "0.200 mm, −20.0\u202f%"
    # Half of the last stretch, from (0, 5, 6) to (2, 2, 4).
    assert (told["Needle x, y"], told["Needle z"]) == ("1.000, 3.500", "5.000 mm")
    assert told["Ink laid"] == "1.25 of 1.5 µL"
    assert (told["Vessel"], told["The needle"]) == ("6", "writes")
    assert told["Ink"].startswith("&lt;/script&gt;")
