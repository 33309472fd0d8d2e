"""Headless Chromium over a pipe, by its DevTools protocol and the standard library alone."""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)

FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--hide-scrollbars",
         "--no-first-run", "--disable-extensions", "--disable-background-networking", "--mute-audio")  # fmt: skip

# Chromium's answer to a question put to a page that is being left.
LEFT = "Inspected target navigated or closed"


class Left(AssertionError):
    """The page was left for another before it had answered."""


class Browser:
    """One page.  What it asked for and what its console said is in ``requests`` and ``complaints``."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_read, self.to = os.pipe()
        self.source, to_write = os.pipe()
        # Chromium reads commands from descriptor 3 and answers on 4, whatever numbers the pipes have here.
        command = f'exec 3<&{to_read} 4>&{to_write}; exec "$0" "$@"'
        self.process = subprocess.Popen(
            ["bash", "-c", command, CHROMIUM, *FLAGS, f"--user-data-dir={self.folder.name}", "about:blank"],
            pass_fds=(to_read, to_write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(to_read)
        os.close(to_write)
        self.buffer, self.number, self.session = b"", 0, None
        self.requests, self.complaints = [], []
        targets = self._call("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        self.session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for pipe in (self.to, self.source):
            os.close(pipe)
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()

    def open(self, path, *, width=1000, height=900, **media):
        """Show a file; media as ``prefers_color_scheme="dark"``."""
        self.requests.clear()
        self.complaints.clear()
        features = [{"name": n.replace("_", "-"), "value": v} for n, v in media.items()]
        self._call("Emulation.setEmulatedMedia", features=features)
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._call("Page.navigate", url=Path(path).resolve().as_uri())
        self.until("document.readyState === 'complete' && location.protocol === 'file:'")

    def media(self, kind, **features):
        """Show the open page as on paper, ``print``, or as on a screen, an empty text."""
        features = [{"name": n.replace("_", "-"), "value": v} for n, v in features.items()]
        self._call("Emulation.setEmulatedMedia", media=kind, features=features)

    def run(self, script):
        """The value of an expression on the page; a promise is waited for."""
        answer = self._call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            said = answer["exceptionDetails"]
            raise AssertionError(said.get("exception", {}).get("description", said["text"]))
        return answer["result"].get("value")

    def until(self, condition, seconds=60):
        """Wait for an expression to be true; a page that is left for the next while it is asked is not yet there."""
        end = time.monotonic() + seconds
        while not self._is_so(condition):
            assert time.monotonic() < end, f"waited in vain for {condition}"
            time.sleep(0.05)

    def _is_so(self, condition):
        try:
            return self.run(condition)
        except Left:
            return False

    def key(self, name, code=None, text=""):
        """Press a key and let go of it."""
        press = {"key": name, "code": code or name, "text": text, "windowsVirtualKeyCode": CODES.get(name, 0)}
        self._call("Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", **press)
        self._call("Input.dispatchKeyEvent", type="keyUp", **press | {"text": ""})

    def mouse(self, kind, x, y, **more):
        self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def screenshot(self, path, *, whole=False):
        """Write a PNG of what is seen, or of the whole page."""
        shot = self._call("Page.captureScreenshot", captureBeyondViewport=whole)
        Path(path).write_bytes(base64.b64decode(shot["data"]))

    def pdf(self):
        """The page as it prints, bytes of a PDF."""
        return base64.b64decode(self._call("Page.printToPDF", printBackground=True)["data"])

    def _call(self, method, **parameters):
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._message()
            if answer.get("id") == self.number:
                if LEFT in answer.get("error", {}).get("message", ""):
                    raise Left
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._event(answer)

    def _message(self):
        while b"\0" not in self.buffer:
            assert select.select([self.source], [], [], 90)[0], "Chromium does not answer"
            part = os.read(self.source, 1 << 20)
            assert part, "Chromium has gone"
            self.buffer += part
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def _event(self, event):
        method, said = event.get("method"), event.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(said["request"]["url"])
        elif method == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning"):
            self.complaints.append(said["entry"]["text"])
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(str(said["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and said["type"] in ("error", "warning", "assert"):
            self.complaints.append(str(said["args"]))


CODES = {" ": 32, "ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35}
