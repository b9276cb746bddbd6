#!/usr/bin/env python3
"""Clicks through the panel in a real window of Blender 3.4 without a screen, and photographs it.

    python3 window.py --isomark PROGRAM --pictures DIR [--blender PROGRAM]

Needs Xvfb, openbox, xdotool and ImageMagick (import, convert). Writes one picture for each step into DIR; the last one cut to
the panel and the part is panel.png, the picture of README. Fails if a step does not happen.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
WIDTH, HEIGHT = 1180, 860
LIMIT_S = 120
STATION = """[station]
name = "Laser 1"
[folders]
hot = "hot"
import = "import"
[field]
width_mm = 250
height_mm = 250
"""


def until(condition, what):
    """Waits for a condition."""
    deadline = time.monotonic() + LIMIT_S
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise SystemExit(f"{what} did not happen within {LIMIT_S} s")
        time.sleep(0.1)
    return value


class Window:
    """A Blender on a screen of its own."""

    def __init__(self, environment, pictures):
        self.environment, self.pictures, self.count = environment, pictures, 0

    def run(self, *command):
        """Runs a command on the screen and returns its output."""
        ended = subprocess.run(command, env=self.environment, check=True, capture_output=True, text=True)
        return ended.stdout

    def click(self, x, y, button=1):
        """Clicks as a hand does: Blender misses a press and a release in the same moment."""
        self.run("xdotool", "mousemove", str(x), str(y), "sleep", "0.4", "mousedown", str(button), "sleep", "0.3",
                 "mouseup", str(button), "sleep", "0.6")

    def key(self, x, y, name):
        """Presses a key with the mouse over a place."""
        self.run("xdotool", "mousemove", str(x), str(y), "sleep", "0.3", "key", name, "sleep", "0.8")

    def photograph(self, name):
        """Writes a picture of the screen."""
        self.count += 1
        path = self.pictures / f"{self.count:02}-{name}.png"
        self.run("import", "-window", "root", str(path))
        return path
