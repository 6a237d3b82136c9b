"""A headless Chromium that a test drives by the DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from websockets.sync.client import ClientConnection, connect

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser")
# The canvas is drawn without a GPU, by one busy core at the worst.
_LIMIT_S = 90.0
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    "--no-first-run",
)


def until(condition: Callable[[], Any], what: str, limit_s: float = _LIMIT_S) -> Any:
    """Poll until a condition is true, and return it."""
    deadline = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < deadline, f"not within {limit_s:g} s: {what}"
        time.sleep(0.05)
    return found


class Browser:
    """One page of a running Chromium.

    Parameters
    ----------
    connection : ClientConnection
        Its DevTools.
    """

    def __init__(self, connection: ClientConnection) -> None:
        self._connection, self._numbers = connection, itertools.count(1)

    def call(self, method: str, **parameters: Any) -> Any:
        """Call a method of the DevTools protocol and return its result."""
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._connection.recv(timeout=_LIMIT_S))).get("id") != number:
            pass
        assert "error" not in answer, answer["error"]
        return answer["result"]

    def open(self, address: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=address)

    def ask(self, script: str) -> Any:
        """Evaluate JavaScript in the page and return its value."""
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def text(self) -> str:
        """Return the text of the page, and that of its fields, a line each."""
        script = (
            "document.body ? [document.body.innerText, ...[...document.querySelectorAll('input,textarea')]"
            ".map(one => one.value)].join('\\n') : ''"
        )
        return str(self.ask(script) or "")

    def click(self, label: str) -> None:
        """Press a button by its label."""
        script = f"[...document.querySelectorAll('button')].find(one => one.innerText.trim() == {label!r})"
        until(lambda: self.ask(f"!!{script}"), f"a button {label}")
        self.ask(f"{script}.click()")

    def picture(self) -> np.ndarray:
        """Return what the page shows, (height, width, 3)."""
        return np.asarray(Image.open(io.BytesIO(self.png())).convert("RGB"))

    def png(self) -> bytes:
        """Return what the page shows as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])


@contextlib.contextmanager
def browser(folder: Path, width: int = 800, height: int = 500) -> Iterator[Browser]:
    """Start Chromium with a profile in a folder."""
    assert PROGRAM is not None
    command = [
        PROGRAM,
        *_OPTIONS,
        f"--user-data-dir={folder}",
        f"--window-size={width},{height}",
        "about:blank",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        active = folder / "DevToolsActivePort"
        port = until(
            lambda: active.exists() and active.read_text().partition("\n")[0], "DevTools of Chromium"
        )
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
            (page,) = [one for one in json.load(answer) if one["type"] == "page"]
        with connect(page["webSocketDebuggerUrl"], max_size=None, proxy=None) as connection:
            yield Browser(connection)
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
