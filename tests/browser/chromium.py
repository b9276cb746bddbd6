"""A headless Chromium, driven through its DevTools protocol over a pipe. Needs nothing but Python's standard library."""

import base64
import fcntl
import json
import os
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib

NAMES = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"]
LIMIT = 120  # seconds for one answer, generous for a busy machine


def find():
    """The path of an installed Chromium, or None."""
    return os.environ.get("CHROMIUM") or next((path for path in map(shutil.which, NAMES) if path), None)


class Chromium:
    """One browser process; `messages` collects everything that it reports about the pages."""

    def __init__(self, *switches):
        self.folder = tempfile.mkdtemp(prefix="chromium-")
        to_browser, self.out = os.pipe()
        self.into, from_browser = os.pipe()

        # The browser uses the files 3 and 4; with higher numbers, the ends are not among them.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (to_browser, from_browser)]

        def as_three_and_four():
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        command = [find(), "--headless=new", "--remote-debugging-pipe", f"--user-data-dir={self.folder}", "--no-sandbox",
                   "--no-first-run", "--disable-background-networking", "--hide-scrollbars",
                   "--force-color-profile=srgb", *switches, "about:blank"]
        self.process = subprocess.Popen(command, preexec_fn=as_three_and_four, close_fds=False,
                                        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for fd in [to_browser, from_browser, *ends]:
            os.close(fd)
        self.buffer = b""
        self.count = 0
        self.messages = []
        self.site = "file://"  # the start of the addresses of all requests
        target = self.call("Target.createTarget", {"url": "about:blank"}, False)["targetId"]
        self.session = None
        self.session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True}, False)["sessionId"]
        for domain in ["Page", "Runtime", "Log", "Network", "Audits"]:
            self.call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        os.close(self.out)
        os.close(self.into)
        shutil.rmtree(self.folder, ignore_errors=True)

    def call(self, method, parameters=None, in_page=True):
        """Sends a command and returns its result."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters or {}}
        if in_page:
            message["sessionId"] = self.session
        rest = json.dumps(message).encode() + b"\0"
        while rest:
            rest = rest[os.write(self.out, rest):]
        end = time.monotonic() + LIMIT
        while True:
            answer = self.receive(end)
            if answer is None:
                raise TimeoutError(f"{method} got no answer")
            if answer.get("id") == self.count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def receive(self, end):
        """The next message until `end`; events are collected."""
        while b"\0" not in self.buffer:
            if not select.select([self.into], [], [], max(0, end - time.monotonic()))[0]:
                return None
            data = os.read(self.into, 1 << 20)
            if not data:
                raise RuntimeError("the browser ended")
            self.buffer += data
        text, self.buffer = self.buffer.split(b"\0", 1)
        message = json.loads(text)
        if "method" in message:
            self.messages.append(message)
        return message

    def evaluate(self, expression):
        """The value of a JavaScript expression in the page; promises are awaited. A page that loads itself again is asked again."""
        asked = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        end = time.monotonic() + LIMIT
        while True:
            try:
                result = self.call("Runtime.evaluate", asked)
                break
            except RuntimeError as error:
                if "navigated" not in str(error) or time.monotonic() > end:
                    raise
        if "exceptionDetails" in result:
            raise RuntimeError(f"{expression[:200]}: {json.dumps(result['exceptionDetails'])[:2000]}")
        return result["result"].get("value")

    def until(self, condition):
        """Waits until an expression is true."""
        end = time.monotonic() + LIMIT
        while not self.evaluate(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"never true: {condition}")
            self.receive(time.monotonic() + 0.02)

    def open(self, path, width=1280, height=900, media="", dark=False, scale=1, touch=False):
        """Opens a file, or an address of a server, in a window of this size."""
        self.size(width, height, scale, touch)
        self.media(media, dark)
        is_file = "://" not in path
        self.site = "file://" if is_file else "/".join(path.split("/", 3)[:3]) + "/"
        self.call("Page.navigate", {"url": "file://" + os.path.abspath(path) if is_file else path})
        self.until(f"document.readyState === 'complete' && location.href.startsWith({json.dumps(self.site)})")

    def size(self, width, height, scale=1, touch=False):
        self.call("Emulation.setDeviceMetricsOverride",
                  {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": touch})
        self.call("Emulation.setTouchEmulationEnabled", {"enabled": touch})

    def media(self, media="", dark=False):
        features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
                    {"name": "prefers-reduced-motion", "value": "reduce"}]
        self.call("Emulation.setEmulatedMedia", {"media": media, "features": features})

    def png(self, clip=None, whole=False):
        """A screenshot as PNG; `clip` is x, y, width, height in CSS px of the page."""
        parameters = {"format": "png", "captureBeyondViewport": whole or clip is not None}
        if clip:
            parameters["clip"] = {**dict(zip(["x", "y", "width", "height"], clip)), "scale": 1}
        return base64.b64decode(self.call("Page.captureScreenshot", parameters)["data"])

    def picture(self, clip=None):
        return Picture(self.png(clip))

    def key(self, key, shift=False):
        codes = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9, " ": 32}
        event = {"key": key, "modifiers": 8 if shift else 0, "windowsVirtualKeyCode": codes.get(key, ord(key[0].upper()))}
        if len(key) == 1:
            event["text"] = key
        self.call("Input.dispatchKeyEvent", {"type": "keyDown", **event})
        event.pop("text", None)
        self.call("Input.dispatchKeyEvent", {"type": "keyUp", **event})

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, **more})

    def drag(self, a, b, button="left"):
        buttons = {"left": 1, "right": 2, "middle": 4}[button]
        self.mouse("mousePressed", *a, button=button, buttons=buttons, clickCount=1)
        for step in range(1, 5):
            x, y = (a[k] + (b[k] - a[k]) * step / 4 for k in range(2))
            self.mouse("mouseMoved", x, y, button=button, buttons=buttons)
        self.mouse("mouseReleased", *b, button=button, buttons=0, clickCount=1)

    def touch(self, kind, points):
        self.call("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [
            {"x": x, "y": y, "id": index} for index, (x, y) in enumerate(points)]})

    def violations(self, axe):
        """What axe-core, whose script is at `axe`, finds in the page."""
        self.evaluate(open(axe, encoding="utf-8").read() + "\n;1")
        result = self.evaluate("axe.run(document).then(r => ({passes: r.passes.length, violations: r.violations.map(v => "
                               "v.id + ': ' + v.help + ' ' + v.nodes.map(n => n.target + ' ' + n.failureSummary).join('; '))}))")
        few = [] if result["passes"] > 15 else [f"axe-core checked only {result['passes']} rules"]
        return result["violations"] + few

    def complaints(self):
        """Errors and warnings of the console, exceptions, violations of the policy, and requests to other sites."""
        found = []
        for message in self.messages:
            method, p = message["method"], message.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(f"exception: {json.dumps(p['exceptionDetails'])[:600]}")
            elif method == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning", "assert"):
                found.append(f"console: {[a.get('value') for a in p['args']]}")
            elif method == "Log.entryAdded" and p["entry"]["level"] in ("error", "warning"):
                found.append(f"log: {p['entry']['text']}")
            elif method == "Audits.issueAdded" and p["issue"]["code"] == "ContentSecurityPolicyIssue":
                found.append(f"policy: {json.dumps(p['issue'])[:600]}")
            elif method == "Network.requestWillBeSent":
                url = p["request"]["url"]
                if not url.startswith((self.site, "data:", "about:")):
                    found.append(f"request: {url}")
        return found


class Checks:
    """The checks of one script; screenshots go into a folder, if there is one."""

    def __init__(self, folder):
        self.folder = folder
        self.failures = 0

    def check(self, condition, what):
        if not condition:
            self.failures += 1
            print("FAILED:", what, flush=True)

    def shot(self, browser, name):
        if self.folder:
            os.makedirs(self.folder, exist_ok=True)
            with open(os.path.join(self.folder, name + ".png"), "wb") as file:
                file.write(browser.png(whole=True))

    def exit(self):
        """Ends the script."""
        print(f"{self.failures} failures")
        sys.exit(bool(self.failures))


class Picture:
    """The pixels of a PNG with 8 bits a channel."""

    def __init__(self, png):
        assert png[:8] == b"\x89PNG\r\n\x1a\n"
        at, data = 8, b""
        while at < len(png):
            length, kind = struct.unpack(">I4s", png[at:at + 8])
            body = png[at + 8:at + 8 + length]
            if kind == b"IHDR":
                self.width, self.height, bits, color, *_, interlace = struct.unpack(">IIBBBBB", body)
                assert bits == 8 and color in (2, 6) and interlace == 0
                self.channels = 3 if color == 2 else 4
            elif kind == b"IDAT":
                data += body
            at += 12 + length
        raw, step, row = zlib.decompress(data), self.channels, self.width * self.channels
        self.rows, above = [], bytearray(row)
        for y in range(self.height):
            kind, line = raw[y * (row + 1)], bytearray(raw[y * (row + 1) + 1:(y + 1) * (row + 1)])
            if kind == 1:
                for i in range(step, row):
                    line[i] = (line[i] + line[i - step]) & 255
            elif kind == 2:
                line = bytearray((a + b) & 255 for a, b in zip(line, above))
            elif kind == 3:
                for i in range(row):
                    line[i] = (line[i] + ((line[i - step] if i >= step else 0) + above[i]) // 2) & 255
            elif kind == 4:
                for i in range(row):
                    a, b, c = (line[i - step], above[i], above[i - step]) if i >= step else (0, above[i], 0)
                    pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
                    line[i] = (line[i] + (a if pa <= pb and pa <= pc else b if pb <= pc else c)) & 255
            self.rows.append(line)
            above = line

    def at(self, x, y):
        """Red, green and blue of the pixel that contains a point; None outside."""
        x, y = int(x), int(y)
        if not (0 <= x < self.width and 0 <= y < self.height):
            return None
        return tuple(self.rows[y][x * self.channels:x * self.channels + 3])

    def darkest(self, x, y, reach=1):
        """The smallest brightness, 0 to 255, in the pixels around a point."""
        near = [self.at(x + i, y + j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]
        return min(sum(pixel) / 3 for pixel in near if pixel)

    def differences(self, other):
        """How many pixels differ."""
        assert (self.width, self.height) == (other.width, other.height)
        step, count = self.channels, 0
        for a, b in zip(self.rows, other.rows):
            if a != b:
                count += sum(a[i:i + 3] != b[i:i + 3] for i in range(0, len(a), step))
        return count
