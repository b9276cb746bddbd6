#!/usr/bin/env python3
"""Clicks through the panel in a real window of Blender 3.4, on a screen of its own, and photographs it.

    python3 window.py --isomark PROGRAM --pictures DIR [--blender PROGRAM]

Needs Xvfb, openbox, xdotool and ImageMagick (import, convert). Writes a picture of each step into DIR, and panel.png, the
picture of README. Fails if a step does not happen.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
WIDTH, HEIGHT = 1180, 940
LIMIT_S = 60
DRAWN_S = 3
CLICKS, NOTICED_S = 5, 12
STATION = """[station]
name = "Laser 1"
[folders]
hot = "hot"
import = "import"
[field]
width_mm = 250
height_mm = 250
"""
# Where things are in a window of this size.
VIEW, EMPTY_SPOT, TAB = (250, 640), (180, 700), (961, 270)
USE_SELECTED, SHOW, UNCORRECTED, SEND = (848, 147), (838, 364), (773, 614), (838, 728)
PREFERENCES, LIVE = (919, 429), (919, 364)
# In the window of the preferences, which opens over the panel.
TEST, CLOSE = (1074, 454), (1168, 169)
# What README shows: the view with its panel.
SHOWN = "790x740+183+100"


def until(condition, what, otherwise=lambda: None):
    """Waits for a condition."""
    deadline = time.monotonic() + LIMIT_S
    while not (value := condition()):
        if time.monotonic() > deadline:
            otherwise()
            raise SystemExit(f"FAILED: {what} did not happen within {LIMIT_S} s")
        time.sleep(0.1)
    print(f"ok: {what}", flush=True)
    return value


class Window:
    """A Blender with a window, and the programs around it."""

    def __init__(self, folder, pictures, isomark, blender):
        self.folder, self.pictures, self.count, self.children = folder, pictures, 0, []
        subprocess.run([sys.executable, HERE.parent / "package.py", folder], check=True, stdout=subprocess.DEVNULL)
        for name in ("hot", "import"):
            (folder / name).mkdir()
        station = folder / "station.toml"
        station.write_text(STATION)
        self.use_program(isomark)
        reading, writing = os.pipe()
        self.start(["Xvfb", "-displayfd", str(writing), "-screen", "0", f"{WIDTH}x{HEIGHT}x24"], pass_fds=[writing])
        os.close(writing)
        with os.fdopen(reading) as pipe:
            display = pipe.readline().strip()
        path = os.pathsep.join([os.path.dirname(blender), os.environ.get("PATH", "")])
        self.environment = dict(os.environ, DISPLAY=f":{display}", LIBGL_ALWAYS_SOFTWARE="1", PATH=path,
                                BLENDER_USER_RESOURCES=str(folder))
        self.start(["openbox"], env=self.environment)
        self.start([isomark, "watch", str(station)])
        self.start([blender, "--factory-startup", "--window-geometry", "0", "0", str(WIDTH), str(HEIGHT), "-P",
                    str(HERE / "window_scene.py"), "--", str(folder), str(station)], env=self.environment)

    def start(self, command, **options):
        """Starts a program that ends with this script."""
        self.children.append(subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                              stderr=subprocess.DEVNULL, **options))

    def end(self):
        """Ends all programs."""
        for child in reversed(self.children):
            child.kill()
            child.wait()

    def use_program(self, path):
        """Changes the path of isomark in the add-on's preferences, as soon as Blender looks."""
        (self.folder / "program.part").write_text(str(path))
        os.replace(self.folder / "program.part", self.folder / "program.txt")

    def ask(self, name, what):
        """Asks the script in Blender for something and waits until it is done."""
        (self.folder / name).touch()
        until(lambda: not (self.folder / name).exists(), what)

    def state(self):
        """What Blender reported last."""
        try:
            return json.loads((self.folder / "state.json").read_text())
        except (OSError, ValueError):
            return {}

    def when(self, condition, what):
        """Waits for a state."""
        return until(lambda: (state := self.state()) and condition(state) and state, what,
                     lambda: self.photograph("failed"))

    def run(self, *command):
        """Runs a command on the screen."""
        subprocess.run(command, env=self.environment, check=True)

    def click(self, place):
        """Clicks as a hand does: Blender misses a press and a release in the same moment."""
        self.run("xdotool", "mousemove", *map(str, place), "sleep", "0.4", "mousedown", "1", "sleep", "0.3", "mouseup",
                 "1", "sleep", "0.6")

    def press(self, place, condition, what):
        """Clicks until the state is reached: on a busy machine, Blender misses some clicks."""
        for _ in range(CLICKS):
            self.click(place)
            deadline = time.monotonic() + NOTICED_S
            while time.monotonic() < deadline:
                if (state := self.state()) and condition(state):
                    print(f"ok: {what}", flush=True)
                    return state
                time.sleep(0.1)
        self.photograph("failed")
        raise SystemExit(f"FAILED: {what} did not happen after {CLICKS} clicks")

    def key(self, place, name):
        """Presses a key with the mouse at a place."""
        self.run("xdotool", "mousemove", *map(str, place), "sleep", "0.3", "key", name, "sleep", "0.8")

    def photograph(self, name):
        """Writes a picture of the screen and returns its path. Without a graphics card, drawing takes a moment."""
        time.sleep(DRAWN_S)
        self.count += 1
        path = self.pictures / f"{self.count:02}-{name}.png"
        self.run("import", "-window", "root", str(path))
        return path


def walk(window, isomark):
    """The way of a user through the panel."""
    window.when(bool, "Blender shows its window")
    window.key(VIEW, "n")
    window.click(TAB)
    window.photograph("panel")
    window.press(USE_SELECTED, lambda state: state["part"] == "Can" and state["drawings"] == ["Ring", "Title"],
                 "the selection is used")
    window.click(PREFERENCES)
    window.photograph("preferences")
    window.press(TEST, lambda state: state["version"].startswith("isomark "), "Test shows the version")
    window.photograph("tested")
    window.click(CLOSE)
    window.click(EMPTY_SPOT)

    # A program that never answers: the window stays alive, and ESC ends the program.
    slow, marker = window.folder / "slow", window.folder / "pid"
    slow.write_text(f"#!/bin/sh\necho $$ > {marker}\nexec sleep 600\n")
    slow.chmod(0o755)
    window.use_program(slow)
    until(lambda: not (window.folder / "program.txt").exists(), "the slow program is used")
    window.press(SHOW, lambda state: state["running"], "the slow program runs and the window answers")
    until(lambda: marker.is_file() and marker.read_text().strip(), "its process is known")
    window.photograph("working")
    window.key(VIEW, "Escape")
    window.when(lambda state: not state["running"], "ESC cancels")
    until(lambda: not Path(f"/proc/{marker.read_text().strip()}").exists(), "its process is gone")

    window.use_program(window.folder / "not-there")
    until(lambda: not (window.folder / "program.txt").exists(), "a wrong path is used")
    window.press(SHOW, lambda state: "not-there" in state["outcome"].get("what", ""), "the panel states the wrong path")
    # The message at the mouse goes away when the mouse leaves it.
    window.key(VIEW, "F13")
    window.photograph("wrong-path")

    window.use_program(isomark)
    until(lambda: not (window.folder / "program.txt").exists(), "the right path is used")
    shown = window.press(SHOW, lambda state: state["marks"] == ["isomark"], "the mark is shown")
    assert shown["outcome"]["after_mm"] < 0.1 < shown["outcome"]["before_mm"], shown
    window.key(VIEW, "ctrl+z")
    window.when(lambda state: not state["marks"], "undo removes the mark")
    window.key(VIEW, "ctrl+shift+z")
    window.when(lambda state: state["marks"] == ["isomark"], "redo shows it again")
    window.photograph("mark")

    window.press(LIVE, lambda state: state["live"], "Live is on")
    window.ask("grow.txt", "the ring becomes larger")
    longer = shown["outcome"]["length_mm"] + 10
    window.when(lambda state: state["outcome"].get("length_mm", 0) > longer, "Live corrects it again")
    window.photograph("live")
    window.press(LIVE, lambda state: not state["live"], "Live is off")
    window.press(UNCORRECTED, lambda state: len(state["marks"]) == 2, "the uncorrected drawing is shown beside it")
    window.photograph("uncorrected")
    window.press(SEND, lambda state: state["answer"], "the files are sent")
    window.when(lambda state: state["answer"] == "delivered", "the station's answer is shown")
    assert (window.folder / "import" / "Can@Ring.dxf").is_file()
    window.ask("hide.txt", "the flat drawing is hidden")
    whole = window.photograph("delivered")
    window.run("convert", str(whole), "-crop", SHOWN, "+repage", "-colors", "64", str(window.pictures / "panel.png"))


def main():
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--isomark", required=True)
    parser.add_argument("--pictures", required=True, type=Path)
    parser.add_argument("--blender", default=shutil.which("blender"))
    options = parser.parse_args()
    options.pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="isomark-window-") as folder:
        window = Window(Path(folder), options.pictures, os.path.abspath(options.isomark), options.blender)
        try:
            walk(window, os.path.abspath(options.isomark))
        finally:
            window.end()


if __name__ == "__main__":
    main()
