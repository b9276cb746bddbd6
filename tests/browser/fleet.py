"""Checks the fleet on the page of a running station in a real headless Chromium:
python3 fleet.py AXE.js ADDRESS [FOLDER for screenshots].

The fleet has the stations `laser1`, which is alive and shows the page, and `laser2`, which was stopped."""

import sys

from chromium import Checks, Chromium

axe, address = sys.argv[1:3]
checks = Checks(sys.argv[3] if len(sys.argv) > 3 else None)
check, shot = checks.check, checks.shot
ROWS = "[...document.querySelectorAll('#p-fleet tbody tr')].map(row => [...row.cells].map(cell => cell.innerText))"

with Chromium("--use-angle=swiftshader", "--enable-unsafe-swiftshader") as browser:
    for name, how in [("light", {}), ("dark", {"dark": True}), ("phone", {"width": 390, "height": 844, "scale": 2, "touch": True})]:
        browser.open(address, **how)
        browser.until("document.getElementById('link').textContent === 'Live'")
        browser.until(f"{ROWS}.length === 2")
        rows = {row[0]: row[1:] for row in browser.evaluate(ROWS)}
        check(set(rows) == {"laser1", "laser2"}, f"every station has a row: {rows}")
        check(rows["laser1"][0] == "Alive" and rows["laser2"][0] == "Stopped", f"their states: {rows}")
        check(rows["laser2"][1:5] == ["0", "1", "1", "0"], f"waiting, delivered, learned, rejected: {rows}")
        shot(browser, f"fleet-{name}")
        wide = browser.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        check(wide[0] <= wide[1], f"the page does not scroll sideways: {wide}")
        for violation in browser.violations(axe):
            check(False, f"axe-core, {name}: {violation}")
    for complaint in browser.complaints():
        check(False, complaint)

checks.exit()
