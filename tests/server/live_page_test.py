"""Looks at the live page in a headless Chromium, as a reader would, and says what is wrong with it.

usage: live_page_test.py URL [PICTURE_FOLDER]
Speaks with its caller by lines: writes "inject" and "restart" when that is to happen, and "ok" at the end. Exit status 1:
something is wrong, and a line says what. 77: there is no Chromium. Standard library alone; the browser is driven over a
pipe by the DevTools protocol.
"""
import base64
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time


class Browser:
    def __init__(self, program, profile):
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        command = [program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
                   "--disable-background-networking", "--disable-component-update", "--remote-debugging-pipe",
                   "--user-data-dir=" + profile, "about:blank"]
        self.process = subprocess.Popen(["sh", "-c", f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}', "sh", *command],
                                        pass_fds=(theirs_in, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(theirs_in)
        os.close(theirs_out)
        self.input, self.output, self.rest, self.last, self.events = ours_in, ours_out, b"", 0, []
        target = self.call("Target.createTarget", {"url": "about:blank"})["targetId"]
        self.session = self.call("Target.attachToTarget", {"targetId": target, "flatten": True})["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(domain + ".enable")

    session = None

    def call(self, method, parameters=None):
        self.last += 1
        message = {"id": self.last, "method": method, "params": parameters or {}}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.output, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + 60
        while True:
            answer = self.receive(end)
            if answer.get("id") == self.last:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def receive(self, end):
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.input], [], [], max(0, end - time.monotonic()))
            chunk = os.read(self.input, 1 << 16) if ready else b""
            if not chunk:
                raise AssertionError("the browser said nothing for a minute, or ended")
            self.rest += chunk
        message, self.rest = self.rest.split(b"\0", 1)
        return json.loads(message)

    def value(self, script):
        result = self.call("Runtime.evaluate", {"expression": script, "returnByValue": True, "awaitPromise": True})
        if "exceptionDetails" in result:
            raise AssertionError(f"{script}: {result['exceptionDetails']}")
        return result["result"].get("value")

    def wait(self, what, script, seconds=40):
        end = time.monotonic() + seconds
        while not self.value(script):
            if time.monotonic() > end:
                raise AssertionError(f"waited {seconds} s in vain until {what}; the page says: "
                                     + repr(self.value("document.body.innerText")[:1500]))
            time.sleep(0.1)

    def view(self, width, height, dark=False):
        self.call("Emulation.setDeviceMetricsOverride",
                  {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500})
        self.call("Emulation.setEmulatedMedia",
                  {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]})

    def key(self, name, code):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", {"type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code})

    def picture(self, path, whole):
        os.makedirs(os.path.dirname(path), exist_ok=True)
        data = self.call("Page.captureScreenshot", {"format": "png", "captureBeyondViewport": whole})["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(data))

    def complaints(self, own):
        """What the page logged as wrong, and whatever it asked of anybody but its own server."""
        for event in self.events:
            method, p = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                yield "exception: " + json.dumps(p["exceptionDetails"])[:600]
            if method == "Runtime.consoleAPICalled" and p["type"] in ("error", "warning", "assert"):
                yield "console: " + json.dumps(p["args"])[:600]
            if method == "Log.entryAdded" and p["entry"]["level"] in ("error", "warning"):
                # While the server is away the browser itself says that it cannot be reached.
                if "ERR_CONNECTION_REFUSED" not in p["entry"]["text"] and "ERR_INCOMPLETE_CHUNKED" not in p["entry"]["text"]:
                    yield "log: " + p["entry"]["text"]
            if method == "Network.requestWillBeSent" and not p["request"]["url"].startswith((own, "about:", "data:")):
                yield "asked elsewhere: " + p["request"]["url"]
            if method == "Network.responseReceived" and p["response"]["status"] >= 400:
                yield f"{p['response']['status']}: {p['response']['url']}"


def number(browser):
    return int(browser.value("document.querySelector('#facts dd').firstChild.data.replace(/,/g, '')"))


def tell(line):
    print(line, flush=True)


def look(browser, url, folder):
    browser.view(1280, 900)
    browser.call("Page.navigate", {"url": url})
    browser.wait("it is live", "document.getElementById('status')?.dataset.state === 'live' && !!document.querySelector('#facts dd')")
    first = number(browser)
    browser.wait("frames go on", f"parseInt(document.querySelector('#facts dd').firstChild.data.replace(/,/g, '')) > {first} + 5")
    browser.wait("scrolls are marked", "!!document.querySelector('#causes [data-cause=scroll]')")
    phase = "parseInt(document.querySelector('#phases [data-phase={}]').innerText.split(' ')[1]) > 0"
    for name in ("resident", "loading", "wanted", "failed"):
        browser.wait(f"a chunk is {name}", phase.format(name))
    browser.wait("the configuration is there", "document.querySelectorAll('#settings dt').length > 10")
    inked = """(id) => { const c = document.getElementById(id), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
                         let n = 0; for (let k = 3; k < d.length; k += 4) n += d[k] > 0; return n / (d.length / 4); }"""
    for canvas, least in (("map", 0.2), ("plan", 0.02), ("costChart", 0.02), ("timeChart", 0.005), ("memoryChart", 0.005)):
        browser.wait(f"{canvas} is drawn", f"({inked})('{canvas}') > {least}")

    assert not browser.value("!!document.querySelector('#causes [data-cause=departure]')"), "a departure before any"
    tell("inject")
    browser.wait("the injected invalidation is marked", "!!document.querySelector('#causes [data-cause=departure]')")
    browser.wait("active casters are marked", "!!document.querySelector('#causes [data-cause=active]')")

    # By the keyboard alone: to the cascades, and along them.
    for _ in range(12):
        browser.key("Tab", 9)
        if browser.value("document.activeElement.name === 'cascade'"):
            break
    assert browser.value("document.activeElement.name === 'cascade'"), "the cascades cannot be reached by Tab"
    assert browser.value("getComputedStyle(document.activeElement.nextElementSibling).outlineStyle") == "solid", "no visible focus"
    before = browser.value("document.activeElement.value")
    browser.key("ArrowRight", 39)
    assert browser.value("document.activeElement.value") != before, "arrow keys choose no other cascade"
    browser.wait("the map is that of the chosen cascade",
                 "document.getElementById('map').getAttribute('aria-label').endsWith(' ' + document.querySelector('[name=cascade]:checked').value)")

    if folder:
        time.sleep(15)  # for charts that show something
    for width, height, dark, name in ((1280, 900, False, "desktop"), (390, 844, False, "phone"), (1280, 900, True, "dark"),
                                      (320, 640, False, "narrow")):
        browser.view(width, height, dark)
        time.sleep(1.5)
        wide = browser.value("document.documentElement.scrollWidth")
        assert wide <= width, f"{wide} pixels wide on a screen of {width}"
        if folder:
            browser.picture(os.path.join(folder, name + ".png"), False)
            browser.picture(os.path.join(folder, name + "-whole.png"), True)
    browser.view(1280, 900)

    nameless = browser.value("""[...document.querySelectorAll('button, select, input, canvas')].filter((e) =>
        e.getAttribute('aria-hidden') !== 'true' && !(e.labels?.length || e.getAttribute('aria-label') || e.textContent.trim())).map((e) => e.id)""")
    assert nameless == [], f"controls without a name: {nameless}"

    tell("restart")
    browser.wait("it says that the connection is lost", "document.getElementById('status')?.dataset.state === 'lost'")
    browser.wait("it is live again by itself", "document.getElementById('status')?.dataset.state === 'live'")
    last = number(browser)
    browser.wait("frames go on after that", f"parseInt(document.querySelector('#facts dd').firstChild.data.replace(/,/g, '')) > {last}")
    wrong = list(browser.complaints(url))
    assert wrong == [], "\n".join(wrong)


def main():
    url, folder = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not program:
        tell("no Chromium is installed")
        return 77
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(program, profile)
        try:
            look(browser, url, folder)
            tell("ok")
            return 0
        except AssertionError as error:
            tell(f"wrong: {error}")
            for complaint in browser.complaints(url):
                tell(complaint)
            return 1
        finally:
            browser.process.kill()
            browser.process.wait()


sys.exit(main())
