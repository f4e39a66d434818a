"""A headless Chromium that looks at a page, driven by its DevTools protocol."""

import base64
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path
from urllib.request import urlopen

from roadmap.errors import BadInput

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# drawn by the processor: a server has no graphics card
_PROCESSOR = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_CARD = (
    "--use-angle=vulkan",
    "--ignore-gpu-blocklist",
    "--enable-gpu",
    "--enable-gpu-rasterization",
    "--disable-gpu-sandbox",
    "--disable-software-rasterizer",
)
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-gl=angle",
    "--hide-scrollbars",
    "--no-first-run",
    "--remote-debugging-port=0",
)
_OPEN_S = 60.0  # it has to be there by then [s]
_LOOK_S = 0.05
_SIZE = (1440, 900)
# counts the pictures the browser draws, each wants one turn of this, and what WebGL
# is told to draw
_COUNT = """(() => {
  window.__pictures = window.__calls = window.__faces = 0;
  const watch = (name, at, times) => {
    const own = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...told) {
      window.__calls += 1;
      if (told[0] === this.TRIANGLES)
        window.__faces += told[at] / 3 * (times ? told[times] : 1);
      return own.apply(this, told);
    };
  };
  watch('drawElements', 1);
  watch('drawArrays', 2);
  watch('drawElementsInstanced', 1, 4);
  watch('drawArraysInstanced', 2, 3);
  const next = () => { window.__pictures += 1; requestAnimationFrame(next); };
  requestAnimationFrame(next);
})()"""


def found_browser() -> str | None:
    """Return the path of a Chromium, None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


def flags_of(card: bool) -> tuple[str, ...]:
    """Return the flags of a Chromium; `card`: the graphics card draws."""
    return _FLAGS + (_CARD if card else _PROCESSOR)


class Browser:
    """A Chromium without a window; a context manager.

    Args:
        card: Whether the graphics card draws, else the processor does.

    Raises:
        BadInput: There is none, or it does not start.
    """

    def __init__(self, card: bool = False) -> None:
        """Start it."""
        path = found_browser()
        if path is None:
            raise BadInput(f"there is no browser; install one of {', '.join(NAMES)}")
        self._folder = tempfile.mkdtemp(prefix="odm-browser-")
        self._process = subprocess.Popen(
            [path, *flags_of(card), f"--user-data-dir={self._folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            process_group=0,
        )
        told = Path(self._folder) / "DevToolsActivePort"
        end = time.perf_counter() + _OPEN_S
        while not (told.is_file() and told.read_text().count("\n")):
            if self._process.poll() is not None or time.perf_counter() > end:
                self.close()
                raise BadInput(f"{path} does not start; try `{path} --headless`")
            time.sleep(_LOOK_S)
        self._port = int(told.read_text().splitlines()[0])

    def __enter__(self) -> "Browser":
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.close()

    def close(self) -> None:
        """End it and all that it started."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def tab(self, size: tuple[int, int] = _SIZE, mobile: bool = False) -> "Tab":
        """Return a new tab, of a window of so many pixels."""
        with urlopen(f"http://127.0.0.1:{self._port}/json/version") as answer:
            browser = json.load(answer)["webSocketDebuggerUrl"]
        connection = _Connection(browser)
        page = connection.ask("Target.createTarget", url="about:blank")["targetId"]
        connection.close()
        return Tab(f"ws://127.0.0.1:{self._port}/devtools/page/{page}", size, mobile)

    def cpu_s(self) -> float:
        """Return the CPU time of the browser's processes so far [s]."""
        ticks = 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                row = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue  # it has ended meanwhile
            if int(row[2]) == self._process.pid:  # of its group
                ticks += int(row[11]) + int(row[12])
        return ticks / os.sysconf("SC_CLK_TCK")


class _Connection:
    """Questions and answers of the protocol; events are left unread."""

    def __init__(self, address: str) -> None:
        from websockets.sync.client import connect

        self._socket = connect(address, max_size=None)
        self._number = 0

    def ask(self, method: str, **told: object) -> dict:
        self._number += 1
        asked = {"id": self._number, "method": method, "params": told}
        self._socket.send(json.dumps(asked))
        while True:
            answer = json.loads(self._socket.recv())
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise BadInput(f"the browser refuses {method}: {answer['error']}")
                return answer["result"]

    def close(self) -> None:
        self._socket.close()


class Tab:
    """One page in a browser.

    Args:
        address: Of its DevTools.
        size: Of its window [pixels].
        mobile: Whether it is a telephone's.
    """

    def __init__(self, address: str, size: tuple[int, int], mobile: bool) -> None:
        """Lay it out."""
        self._connection = _Connection(address)
        width, height = size
        self._ask("Page.enable")
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )
        self._ask("Page.addScriptToEvaluateOnNewDocument", source=_COUNT)

    def _ask(self, method: str, **told: object) -> dict:
        return self._connection.ask(method, **told)

    def open(
        self, address: str, until: str, limit_s: float = 120.0, canvas: bool = True
    ) -> float:
        """Open a page; return how long it took until its text has `until` in it [s].

        Args:
            address: Of the page.
            until: What it says once it is there.
            limit_s: It has to be there by then [s].
            canvas: Whether something has to be drawn on it, too.

        Raises:
            BadInput: It took longer than `limit_s`.
        """
        begun = time.perf_counter()
        self._ask("Page.navigate", url=address)
        while True:
            passed = time.perf_counter() - begun
            text = self.ask("document.body ? document.body.innerText : ''") or ""
            drawn = not canvas or self.ask("!!document.querySelector('canvas')")
            if until in text and drawn:
                return passed
            if passed > limit_s:
                raise BadInput(f"{address} does not show {until!r} within {limit_s} s")
            time.sleep(_LOOK_S)

    def ask(self, script: str) -> object:
        """Return what a line of JavaScript gives."""
        told = self._ask("Runtime.evaluate", expression=script, returnByValue=True)
        return told["result"].get("value")

    def pictures(self) -> int:
        """Return how many pictures were drawn since it was opened."""
        return int(self.ask("window.__pictures") or 0)

    def drawn(self) -> tuple[int, float]:
        """Return the draw calls and the triangles so far."""
        return tuple(self.ask("[window.__calls, window.__faces]") or (0, 0.0))

    def drawn_by(self) -> str:
        """Return what draws here, as WebGL names it; "": it cannot draw."""
        found = (
            "(() => {const g = document.createElement('canvas').getContext('webgl2');"
            "const e = g?.getExtension('WEBGL_debug_renderer_info');"
            "return e ? g.getParameter(e.UNMASKED_RENDERER_WEBGL) : ''})()"
        )
        return str(self.ask(found) or "")

    def press(self, text: str) -> bool:
        """Click what has exactly this text; return whether there was anything."""
        found = (
            "[...document.querySelectorAll('label,button,span,div,p')]"
            f".reverse().find(e => e.innerText?.trim() === {json.dumps(text)})"
        )
        return bool(
            self.ask(f"(() => {{const e = {found}; e?.click(); return !!e}})()")
        )

    def toggle(self, label: str) -> bool:
        """Click the box beside a label; return whether there is one."""
        found = (
            "[...document.querySelectorAll('label')]"
            f".find(e => e.innerText.trim() === {json.dumps(label)})"
        )
        box = f"document.getElementById({found}?.htmlFor) ?? {found}?.closest('div')"
        box += "?.parentElement?.querySelector('input')"
        return bool(self.ask(f"(() => {{const e = {box}; e?.click(); return !!e}})()"))

    def drag(
        self, start: tuple[float, float], stop: tuple[float, float], steps: int = 10
    ) -> None:
        """Press the mouse at one point of the window, move it to another, let go."""
        mouse = partial(self._ask, "Input.dispatchMouseEvent")
        (x, y), (to_x, to_y) = start, stop
        mouse(type="mouseMoved", x=x, y=y)
        held = {"button": "left", "buttons": 1}
        mouse(type="mousePressed", x=x, y=y, clickCount=1, **held)
        for k in range(1, steps + 1):
            share = k / steps
            at = {"x": x + share * (to_x - x), "y": y + share * (to_y - y)}
            mouse(type="mouseMoved", **at, **held)
            time.sleep(_LOOK_S)
        mouse(type="mouseReleased", x=to_x, y=to_y, clickCount=1, button="left")

    def picture(self, path: Path) -> Path:
        """Write what is seen as PNG."""
        told = self._ask("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(told["data"]))
        return path

    def close(self) -> None:
        """Leave."""
        self._connection.ask("Page.close")
        self._connection.close()
