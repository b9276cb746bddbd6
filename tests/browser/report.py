"""Checks an HTML report in a real headless Chromium: python3 report.py AXE.js REPORT.html [FOLDER for screenshots]."""

import base64
import json
import os
import re
import struct
import sys

from chromium import Checks, Chromium

GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
axe, page = sys.argv[1:3]
shots = sys.argv[3] if len(sys.argv) > 3 else None
checks = Checks(shots)
check, shot = checks.check, checks.shot

# ---- what the file contains, read without the viewer ----
source = open(page, encoding="utf-8").read()


def block(name):
    return re.search(r'<script type="[^"]*" id="%s">([^<]*)</script>' % name, source).group(1)


scene = json.loads(block("scene"))
glb = base64.b64decode(block("mark-on-part"))
length = struct.unpack("<I", glb[12:16])[0]
gltf, binary = json.loads(glb[20:20 + length]), glb[28 + length:]


def positions(name):
    """The points of each primitive of a node in the part frame, mm."""
    node = next((n for n in gltf["nodes"] if n.get("name") == name and "mesh" in n), None)
    for primitive in gltf["meshes"][node["mesh"]]["primitives"] if node else []:
        accessor = gltf["accessors"][primitive["attributes"]["POSITION"]]
        view = gltf["bufferViews"][accessor["bufferView"]]
        start, step = view.get("byteOffset", 0) + accessor.get("byteOffset", 0), view.get("byteStride", 12)
        points = [struct.unpack_from("<3f", binary, start + i * step) for i in range(accessor["count"])]
        yield [(x * 1000, -z * 1000, y * 1000) for x, y, z in points]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


part = [p for primitive in positions("part") for p in primitive]
mark = [p for primitive in positions("mark") for p in primitive]
sample = mark[::max(1, len(mark) // 60)]


def canvas(browser):
    """The place of the picture in the page: left, top, width, height."""
    return browser.evaluate("""(() => { const r = document.getElementById('view').getBoundingClientRect();
        return [r.left + scrollX, r.top + scrollY, r.width, r.height]; })()""")


def settled(browser):
    """Waits until the picture stands still and is drawn."""
    browser.until("document.getElementById('view').dataset.still === 'yes'")
    browser.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")


def picture(browser):
    settled(browser)
    return browser.picture(canvas(browser))


def click(browser, selector):
    browser.evaluate(f"document.querySelector({json.dumps(selector)}).click()")
    settled(browser)


def project(browser, points):
    return browser.evaluate(f"{json.dumps(points)}.map(p => window.isomark.project(p))")


def check_accessible(browser, what):
    for violation in browser.violations(axe):
        check(False, f"axe-core {what}: {violation}")


def check_camera(browser):
    """From the laser, the picture shows the view's x to the right and y up, both in one scale, and the part fills it."""
    click(browser, '[data-view="laser"]')
    right, up, _ = scene["view"]
    seen = [(dot(right, p), dot(up, p)) for p in part]
    low, high = [min(c) for c in zip(*seen)], [max(c) for c in zip(*seen)]
    _, _, width, height = canvas(browser)
    scale = min(width / (high[0] - low[0]), height / (high[1] - low[1])) / 1.2
    for p, (x, y) in zip(sample, project(browser, sample)):
        truth = (width / 2 + (dot(right, p) - (low[0] + high[0]) / 2) * scale,
                 height / 2 - (dot(up, p) - (low[1] + high[1]) / 2) * scale)
        check(abs(x - truth[0]) < 0.05 and abs(y - truth[1]) < 0.05, f"{p} is at {(x, y)}, expected {truth}")
    _, (mx, my, mz) = None, mark[0]
    for view, axes in [("front", [(1, 0, 0), (0, 0, 1)]), ("top", [(1, 0, 0), (0, 1, 0)])]:
        click(browser, f'[data-view="{view}"]')
        at, beside, above = project(browser, [(mx, my, mz), *[tuple(m + a for m, a in zip((mx, my, mz), axis)) for axis in axes]])
        check(beside[0] - at[0] > 0.1 and abs(beside[1] - at[1]) < 1e-6, f"{view}: its x is to the right")
        check(at[1] - above[1] > 0.1 and abs(above[0] - at[0]) < 1e-6, f"{view}: its y is up")


def check_mark(browser):
    """The lines of the mark are dark where their vertices are, and only there."""
    click(browser, '[data-view="laser"]')
    click(browser, '[data-view="mark"]')
    with_mark = picture(browser)
    places = project(browser, sample)
    dark = [with_mark.darkest(x, y) < 70 for x, y in places]
    check(all(dark), f"{dark.count(False)} of {len(dark)} vertices of the mark are not dark in the picture")
    click(browser, "#show-after")
    without = picture(browser)
    bright = [without.darkest(x, y) > 90 for x, y in places]
    check(all(bright), f"{bright.count(False)} of {len(bright)} places stay dark without the mark")
    # Alone on the ground, the mark covers its own bounding rectangle and nothing beyond it.
    click(browser, "#show-part")
    empty = picture(browser)
    click(browser, "#show-after")
    alone = picture(browser)
    # The last row contains a part of what is below the picture.
    rows = [y for y in range(alone.height - 2) if alone.rows[y] != empty.rows[y]]
    columns = [x for x in range(alone.width)
               if any(alone.at(x, y) != empty.at(x, y) for y in rows)]
    xs, ys = zip(*project(browser, mark))
    found, truth = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1), (min(xs), min(ys), max(xs), max(ys))
    check(all(abs(a - b) < 3 for a, b in zip(found, truth)), f"the mark covers {found} px, expected {truth}")
    click(browser, "#show-part")


def check_toggles(browser):
    click(browser, '[data-view="angled"]')
    start = picture(browser)
    names = browser.evaluate("[...document.querySelectorAll('input[id^=show-]')].map(i => i.id)")
    for needed in ["show-after", "show-before", "show-stretch", "show-part"]:
        check(needed in names, f"there is {needed}")
    for name, wanted in [("show-field", "field" in scene), ("show-focus", "focus" in scene)]:
        check((name in names) == wanted, f"{name} is there only if there is something to show")
    for name in names:
        click(browser, "#" + name)
        changed = picture(browser).differences(start)
        check(changed > 30, f"{name} changes {changed} pixels")
        click(browser, "#" + name)
        check(picture(browser).differences(start) == 0, f"{name} switched twice gives the first picture again")


def check_moving(browser):
    click(browser, '[data-view="angled"]')
    start, point = picture(browser), mark[0]
    origin = project(browser, [point])[0]
    browser.evaluate("document.getElementById('view').focus()")
    for key, shift in [("ArrowLeft", False), ("ArrowUp", False), ("ArrowRight", True), ("+", False)]:
        browser.key(key, shift)
        check(picture(browser).differences(start) > 300, f"the key {key} changes the picture")
        browser.key({"ArrowLeft": "ArrowRight", "ArrowUp": "ArrowDown", "ArrowRight": "ArrowLeft", "+": "-"}[key], shift)
        settled(browser)
        x, y = project(browser, [point])[0]
        check(abs(x - origin[0]) + abs(y - origin[1]) < 0.01, f"the key opposite to {key} leads back")
    for _ in range(36):
        browser.key("ArrowLeft")
    settled(browser)
    x, y = project(browser, [point])[0]
    check(abs(x - origin[0]) + abs(y - origin[1]) < 0.1, "36 steps of 10 degrees are one turn")
    left, top, width, height = canvas(browser)
    middle = (left + width / 2, top + height / 2 - browser.evaluate("scrollY"))
    for what, act in [
        ("a drag", lambda: browser.drag(middle, (middle[0] + 90, middle[1] + 30))),
        ("a drag with the right button", lambda: browser.drag(middle, (middle[0] + 60, middle[1]), "right")),
        ("the wheel", lambda: browser.mouse("mouseWheel", *middle, deltaX=0, deltaY=-240)),
    ]:
        click(browser, '[data-view="angled"]')
        act()
        check(picture(browser).differences(start) > 300, f"{what} changes the picture")
    # The point under the pointer stays there while the wheel zooms.
    click(browser, '[data-view="laser"]')
    x, y = project(browser, [point])[0]
    browser.mouse("mouseWheel", left + x, top + y - browser.evaluate("scrollY"), deltaX=0, deltaY=-240)
    settled(browser)
    u, v = project(browser, [point])[0]
    check(abs(u - x) < 1 and abs(v - y) < 1, f"the wheel zooms at the pointer: {(x, y)} became {(u, v)}")


def check_places(browser):
    count = browser.evaluate("document.querySelectorAll('[data-spot]').length")
    check(count > 0, "there are buttons that show places")
    for index in range(count):
        spot = browser.evaluate(f"+document.querySelectorAll('[data-spot]')[{index}].dataset.spot")
        click(browser, '[data-view="front"]')
        before = picture(browser)
        browser.evaluate(f"document.querySelectorAll('[data-spot]')[{index}].click()")
        check(picture(browser).differences(before) > 300, f"the button of place {spot} changes the picture")
        places = scene["spots"][spot]["at"]
        box = [(min(c) + max(c)) / 2 for c in zip(*places)]
        x, y = project(browser, [box])[0]
        _, _, width, height = canvas(browser)
        check(abs(x - width / 2) < 1 and abs(y - height / 2) < 1, f"place {spot} is in the middle")


def check_paper(browser):
    click(browser, '[data-view="angled"]')
    browser.media("print")
    browser.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    shown = browser.evaluate("['viewer', 'still'].map(id => getComputedStyle(document.getElementById(id)).display)")
    check(shown == ["none", "block"], f"on paper, the still picture replaces the 3-D view: {shown}")
    clip = browser.evaluate("""(() => { const r = document.getElementById('still').getBoundingClientRect();
        return [r.left + scrollX, r.top + scrollY, r.width, r.height]; })()""")
    paper = browser.picture(clip)
    colors = {paper.at(x, y) for y in range(0, paper.height, 3) for x in range(0, paper.width, 3)}
    check(len(colors) > 40 and (paper.at(9, 9) or (0,))[0] > 230, f"the still picture shows something on a light ground ({len(colors)} colours)")
    shot(browser, "print")
    pdf = base64.b64decode(browser.call("Page.printToPDF", {"preferCSSPageSize": True, "printBackground": False})["data"])
    if shots:
        open(os.path.join(shots, "print.pdf"), "wb").write(pdf)
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    check(box and abs(float(box.group(1)) - 595) < 2 and abs(float(box.group(2)) - 842) < 2, f"it prints on A4: {box and box.group(0)}")
    browser.media()


with Chromium(*GPU) as browser:
    browser.open(page)
    browser.until("+document.getElementById('view').dataset.frame > 0")
    settled(browser)
    check(browser.evaluate("document.documentElement.classList.contains('has-3d')"), "the 3-D view is there")
    shot(browser, "light")
    check_accessible(browser, "in light colours")
    check_camera(browser)
    check_mark(browser)
    check_toggles(browser)
    check_moving(browser)
    check_places(browser)
    check_paper(browser)

    browser.open(page, dark=True)
    browser.until("+document.getElementById('view').dataset.frame > 0")
    settled(browser)
    shot(browser, "dark")
    check_accessible(browser, "in dark colours")

    browser.open(page, width=390, height=844, scale=2, touch=True)
    browser.until("+document.getElementById('view').dataset.frame > 0")
    settled(browser)
    shot(browser, "phone")
    wide = browser.evaluate("[document.documentElement.scrollWidth, document.body.scrollWidth]")
    check(max(wide) <= 390, f"a phone does not scroll sideways: {wide}")
    check_accessible(browser, "on a phone")
    start = picture(browser)
    left, top, width, height = canvas(browser)
    x, y = left + width / 2, top + height / 2 - browser.evaluate("scrollY")
    for fingers in [[(x, y)], [(x - 20, y), (x + 20, y)]]:
        click(browser, '[data-view="angled"]')
        browser.touch("touchStart", fingers)
        for step in range(1, 5):
            spread = [(px + 12 * step * (1 if i else -1), py) for i, (px, py) in enumerate(fingers)]
            browser.touch("touchMove", spread)
        browser.touch("touchEnd", [])
        check(picture(browser).differences(start) > 300, f"{len(fingers)} fingers move the picture")
    for complaint in browser.complaints():
        check(False, complaint)

with Chromium("--disable-3d-apis", "--disable-gpu") as browser:
    for what in ["without WebGL2", "without scripts"]:
        browser.call("Emulation.setScriptExecutionDisabled", {"value": what == "without scripts"})
        browser.open(page)
        shown = browser.evaluate("['flat-only', 'viewer', 'still'].map(id => getComputedStyle(document.getElementById(id)).display)")
        check(shown == ["block", "none", "none"], f"{what}, a sentence replaces the 3-D view: {shown}")
        check(browser.evaluate("document.querySelector('.wide svg').getBoundingClientRect().height > 100"), f"{what}, the flat panels are there")
    shot(browser, "flat")
    for complaint in browser.complaints():
        if "WebGL" not in complaint:
            check(False, complaint)

checks.exit()
