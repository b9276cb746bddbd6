#!/usr/bin/env python3
"""Draws examples/mark-on-part.png, the 3-D picture of the README: `python3 examples/mark_on_part.py [ISOMARK]`.

Needs Chromium and a built isomark (target/release/isomark by default).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parent
sys.path.insert(0, str(EXAMPLES.parent / "tests" / "browser"))
from chromium import Chromium  # noqa: E402

SIZE = (900, 760)


def main():
    isomark = sys.argv[1] if len(sys.argv) > 1 else EXAMPLES.parent / "target" / "release" / "isomark"
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        subprocess.run(
            [isomark, "correct", EXAMPLES / "parts" / "mouse.glb", EXAMPLES / "patterns" / "letters.dxf",
             "--place", "0,8", "--out", page.with_suffix(".dxf"), "--report-html", page],
            check=True, stderr=subprocess.DEVNULL,
        )
        with Chromium("--use-angle=swiftshader", "--enable-unsafe-swiftshader") as browser:
            browser.open(str(page), *SIZE)
            browser.until("document.querySelector('#viewer').offsetHeight > 0")
            box = browser.evaluate(
                "(() => { const box = document.querySelector('#stage').getBoundingClientRect();"
                " return [box.x, box.y + scrollY, box.width, box.height]; })()"
            )
            (EXAMPLES / "mark-on-part.png").write_bytes(browser.png(clip=box))


if __name__ == "__main__":
    main()
