"""Checks the page of a running station in a real headless Chromium:
python3 page.py AXE.js ADDRESS PROCESS HOT_FOLDER DRAWING.dxf [FOLDER for screenshots].

The station knows the part `trough`; trough@date.dxf is delivered, cup@logo.dxf waits, trough@broken.dxf is rejected. At the end
its process is killed."""

import json
import os
import shutil
import signal
import sys

from chromium import Checks, Chromium

axe, address, process, hot, drawing = sys.argv[1:6]
shots = sys.argv[6] if len(sys.argv) > 6 else None
checks = Checks(shots)
check, shot = checks.check, checks.shot


def text(browser, selector="main"):
    return browser.evaluate(f"document.querySelector({json.dumps(selector)}).innerText")


def shows(browser, words, selector="main"):
    browser.until(f"document.querySelector({json.dumps(selector)}).innerText.includes({json.dumps(words)})")


def live(browser, **how):
    browser.open(address, **how)
    browser.until("document.getElementById('link').textContent === 'Live'")
    browser.until("[...document.images].every(image => image.complete)")


def drop(name):
    """As people should do it: under a name that the station ignores, then renamed."""
    hidden = os.path.join(hot, "." + name)
    shutil.copyfile(drawing, hidden)
    os.rename(hidden, os.path.join(hot, name))


def retry_button(name):
    return f"document.querySelector('button[aria-label=\"Retry {name}\"]')"


with Chromium("--use-angle=swiftshader", "--enable-unsafe-swiftshader") as browser:
    live(browser)
    seen = text(browser)
    for words in ["Ready", "trough@date.dxf", "Delivered", "cup@logo.dxf", "Drop the part as", "trough@broken.dxf", "Rejected",
                  "What to do:"]:
        check(words in seen, f"{words} in {seen}")
    size = browser.evaluate("parseFloat(getComputedStyle(document.querySelector('.word')).fontSize)")
    check(size > 60, f"the state has letters of {size} px")
    top = browser.evaluate("document.querySelector('.tiles').getBoundingClientRect().bottom")
    check(top < 450, f"state and numbers are at the top: {top} px")
    widths = browser.evaluate("[...document.images].map(image => image.naturalWidth)")
    check(len(widths) == 1 and widths[0] > 0, f"the delivered drawing has a picture: {widths}")
    for violation in browser.violations(axe):
        check(False, f"axe-core in light colours: {violation}")
    shot(browser, "station-light")

    # Something new appears without a reload; what is there stays the same element and keeps the focus.
    browser.evaluate("window.stays = 1; document.querySelector('.thumb').focus(); window.thumb = document.activeElement; 1")
    drop("trough@new.dxf")
    shows(browser, "trough@new.dxf")
    browser.until("document.querySelectorAll('.drops li').length === 3")
    check(browser.evaluate("window.stays === 1 && document.activeElement === window.thumb && window.thumb.isConnected"),
          "nothing is loaded again, and the focus stays")
    browser.until("document.getElementById('live').textContent.includes('trough@new.dxf: Delivered')")
    check("2" in text(browser, ".tiles li:last-child"), "the number of delivered drawings grows")

    # Retry with the keyboard: the drop is rejected again, and the page shows what was done.
    before = browser.evaluate(f"{retry_button('trough@broken.dxf')}.closest('li').id")
    browser.evaluate(f"{retry_button('trough@broken.dxf')}.focus(); 1")
    browser.call("Input.dispatchKeyEvent", {"type": "keyDown", "key": "Enter", "text": "\r", "windowsVirtualKeyCode": 13})
    browser.call("Input.dispatchKeyEvent", {"type": "keyUp", "key": "Enter", "windowsVirtualKeyCode": 13})
    shows(browser, "trough@broken.dxf is back in the hot folder.", "#done")
    browser.until(f"{retry_button('trough@broken.dxf')} !== null && {retry_button('trough@broken.dxf')}.closest('li').id !== '{before}'")
    check(browser.evaluate("window.stays === 1 && document.activeElement !== document.body"), "the focus is still in the page")
    check("Retried or removed since: 1" in text(browser), "the earlier rejection is listed as over")
    for violation in browser.violations(axe):
        check(False, f"axe-core after changes: {violation}")

    live(browser, dark=True)
    shot(browser, "station-dark")
    for violation in browser.violations(axe):
        check(False, f"axe-core in dark colours: {violation}")
    live(browser, width=390, height=844, scale=2, touch=True)
    shot(browser, "station-phone")
    wide = browser.evaluate("[document.documentElement.scrollWidth, document.body.scrollWidth]")
    check(max(wide) <= 390, f"a phone does not scroll sideways: {wide}")
    for violation in browser.violations(axe):
        check(False, f"axe-core on a phone: {violation}")

    # The report runs its own script, and nothing else.
    report = browser.evaluate("document.querySelector('a[href^=\"/report/\"]').href")
    browser.open(report)
    browser.until("+document.getElementById('view').dataset.frame > 0")
    check(browser.evaluate("origin") == "null", "a report is not of the page's origin")
    picture = address + browser.evaluate("location.pathname").replace("/report/", "picture/").replace(".html", ".svg")
    browser.open(picture)
    check(browser.evaluate("document.documentElement.nodeName") == "svg", "the picture opens alone")
    for complaint in browser.complaints():
        check(False, complaint)

    # Without scripts: a plain list, which works by forms and loads itself again.
    browser.call("Emulation.setScriptExecutionDisabled", {"value": True})
    browser.open(address)
    shot(browser, "station-plain")
    seen = text(browser)
    for words in ["Ready", "trough@new.dxf", "cup@logo.dxf", "trough@broken.dxf", " UTC"]:
        check(words in seen, f"without scripts, {words} in {seen}")
    check("Live" not in text(browser, "body"), "without scripts, the page is not live")
    box = browser.evaluate(f"(() => {{ const r = {retry_button('trough@broken.dxf')}; r.scrollIntoView(); "
                           "const b = r.getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]; })()")
    browser.mouse("mousePressed", *box, button="left", buttons=1, clickCount=1)
    browser.mouse("mouseReleased", *box, button="left", buttons=0, clickCount=1)
    browser.until("location.search === '?done=returned' && document.readyState === 'complete'")
    check("The drop is back in the hot folder." in text(browser), "without scripts, the page shows what was done")
    browser.until("location.search === '' && document.readyState === 'complete'")
    shows(browser, "Retried or removed since: 2", "body")
    browser.until(f"{retry_button('trough@broken.dxf')} !== null")
    for complaint in browser.complaints():
        check(False, f"without scripts: {complaint}")

    # A station that ends without a word is not shown as ready.
    browser.call("Emulation.setScriptExecutionDisabled", {"value": False})
    live(browser)
    os.kill(int(process), signal.SIGKILL)
    shows(browser, "No connection", ".word")
    shows(browser, "No connection to the station since", "#lost")
    shot(browser, "station-lost")
    for violation in browser.violations(axe):
        check(False, f"axe-core without a station: {violation}")

checks.exit()
