"""A page in headless Chromium, over the DevTools protocol on a pipe.

It needs no port and no further package.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

CHROMIUM: Final = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NO_CHROMIUM: Final = "no chromium here: apt install chromium"
FLAGS: Final = (
    *("--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--remote-debugging-pipe", "--no-first-run", "--disable-extensions"),
)


class Page:
    """A page of a browser that runs. Methods are named as those of the protocol."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._number, self._read, self._session = 0, b"", ""
        self.errors: list[str] = []  # what the page's scripts complain of

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The result of a call; RuntimeError where the browser refuses it."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next(60.0)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                result: dict[str, Any] = answer["result"]
                return result

    def open(self, url: str, size: tuple[int, int]) -> None:
        """Open the page in a window of this size, px."""
        width, height = size
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        self.call("Log.enable")
        self.call("Page.navigate", url=url)

    def prefer(self, scheme: str) -> None:
        """Whether the reader prefers a `light` or a `dark` page."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def evaluate(self, script: str) -> Any:
        """The value of an expression of JavaScript."""
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def picture(self) -> bytes:
        """Return a picture of the page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def wait(self, seconds: float) -> None:
        """Let it paint."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            if select.select([self._from], [], [], left)[0]:
                self._next(1.0)

    def _next(self, seconds: float) -> dict[str, Any]:
        end = time.monotonic() + seconds
        while b"\0" not in self._read:
            if not select.select([self._from], [], [], max(end - time.monotonic(), 0.0))[0]:
                raise TimeoutError("the browser does not answer")
            self._read += os.read(self._from, 1 << 20)
        line, _, self._read = self._read.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        if message.get("method") == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
            self.errors.append(message["params"]["entry"]["text"])
        return message


@contextmanager
def page(url: str, size: tuple[int, int] = (1400, 900)) -> Iterator[Page]:
    """A page of a browser of its own."""
    assert CHROMIUM is not None, NO_CHROMIUM
    its_in, to_browser = os.pipe()
    from_browser, its_out = os.pipe()

    def as_three_and_four() -> None:
        first, second = os.dup(its_in), os.dup(its_out)
        os.dup2(first, 3)
        os.dup2(second, 4)

    with tempfile.TemporaryDirectory() as profile:
        browser = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}"],
            preexec_fn=as_three_and_four,  # noqa: PLW1509 - no other thread starts a process meanwhile
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(its_in)
        os.close(its_out)
        try:
            opened = Page(to_browser, from_browser)
            opened.open(url, size)
            yield opened
        finally:
            browser.terminate()
            browser.wait(20)
            os.close(to_browser)
            os.close(from_browser)
