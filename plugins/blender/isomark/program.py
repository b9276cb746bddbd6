# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the installed program isomark and runs it as a child process, without waiting for it."""

import atexit
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections import namedtuple
from pathlib import Path

from .trouble import InputTrouble, Trouble, of_system

# Set by Blender's packages for their own libraries; a child process must not load these.
_NOT_FOR_CHILDREN = ("LD_LIBRARY_PATH", "LD_PRELOAD", "DYLD_LIBRARY_PATH", "PYTHONHOME", "PYTHONPATH", "QT_PLUGIN_PATH")
# The exit code for an input that isomark rejects; others are about the settings or the computer.
_REJECTED = 1
_LONGEST_OUTPUT = 64 * 1024 * 1024
_INSTALL = "Install isomark, or enter its path in the add-on's preferences and press Test."

# How a child process ended: its exit code, and its standard output and error as text.
Ended = namedtuple("Ended", "code out err")

_running = set()


def find(preference=""):
    """The path of the program: from the preference, the variable ISOMARK, PATH, or the usual folders, in this order.

    Raises Trouble if the preference or the variable names no program, or if none is found.
    """
    stated = ((preference, "the add-on's preferences name"), (os.environ.get("ISOMARK", ""), "the variable ISOMARK names"))
    for path, who in stated:
        if path.strip():
            path = Path(path.strip()).expanduser()
            program = path / _name() if path.is_dir() else path
            if not program.is_file():
                raise Trouble(f"There is no program {program}, which {who}.", _INSTALL)
            if not os.access(program, os.X_OK):
                raise Trouble(f"The file {program}, which {who}, is not a program.", _INSTALL)
            return str(program.absolute())
    found = shutil.which("isomark", path=os.pathsep.join([os.environ.get("PATH", os.defpath), *_usual_folders()]))
    if not found:
        raise Trouble("The program isomark is not installed, or not where it is searched for.", _INSTALL)
    return os.path.abspath(found)


def _name():
    return "isomark.exe" if os.name == "nt" else "isomark"


def _usual_folders():
    """Folders that are often missing from the PATH of programs that are started from a menu."""
    home = Path.home()
    folders = [home / ".cargo" / "bin"]
    if os.name == "nt":
        for variable in ("ProgramFiles", "ProgramW6432"):
            folders.append(Path(os.environ.get(variable, "C:/Program Files")) / "isomark")
        local = os.environ.get("LOCALAPPDATA")
        folders += [Path(local) / "Programs" / "isomark"] if local else []
    else:
        folders = [Path("/usr/local/bin"), *folders, home / ".local" / "bin", Path("/usr/bin"),
                   Path("/opt/isomark/bin"), Path("/opt/isomark"), Path("/opt/homebrew/bin")]
    return [str(folder) for folder in folders]


class Child:
    """One run of the program, with its output in files, so that it never waits for a reader."""

    def __init__(self, program, arguments, limit_s):
        """Starts the program; after `limit_s` it is ended. Raises Trouble if it cannot be started."""
        environment = {name: value for name, value in os.environ.items() if name not in _NOT_FOR_CHILDREN}
        self._out, self._err = tempfile.TemporaryFile(), tempfile.TemporaryFile()
        self._limit_s, self._deadline = limit_s, time.monotonic() + limit_s
        self._ended = None
        flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
        try:
            self._process = subprocess.Popen([program, *arguments], stdin=subprocess.DEVNULL, stdout=self._out,
                                             stderr=self._err, env=environment, creationflags=flags)
        except OSError as error:
            self._close()
            raise of_system("start", program, error) from error
        _running.add(self)

    def poll(self):
        """How it ended, or None while it runs. Raises Trouble after the time limit."""
        if self._ended is None:
            code = self._process.poll()
            if code is None and time.monotonic() > self._deadline:
                self.end()
                raise Trouble(f"The program did not finish within {self._limit_s:.0f} s and was ended.",
                              "Use fewer triangles or fewer points, or check the path of the program.")
            if code is None:
                return None
            texts = []
            for file in (self._out, self._err):
                file.seek(0)
                texts.append(file.read(_LONGEST_OUTPUT).decode("utf-8", "replace"))
            self._ended = Ended(code, *texts)
            self._close()
        return self._ended

    def wait(self):
        """How it ended; waits for it."""
        while (ended := self.poll()) is None:
            time.sleep(0.01)
        return ended

    def end(self):
        """Ends the process if it still runs, and leaves none behind."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._close()

    def _close(self):
        _running.discard(self)
        self._out.close()
        self._err.close()


def end_all():
    """Ends every child process that still runs."""
    for child in list(_running):
        child.end()


atexit.register(end_all)


# What to do in Blender, where isomark's own sentence names options of its command line.
_REMEDIES = {
    "off-surface": "Move the drawing or the frame over the part, make the drawing smaller, or turn the Z of the frame to the side "
                   "that is marked.",
    "outside-mark": "Move the drawing, make it smaller, or give more faces the material `mark`.",
}


def result(ended):
    """The JSON document of a run with `--json`.

    Raises InputTrouble with isomark's reason why the input is rejected; otherwise Trouble, also for an isomark that is too old.
    """
    try:
        document = json.loads(ended.out)
    except ValueError:
        document = {}
    schema = document.get("schema", "") if isinstance(document, dict) else ""
    if ended.code == 0 and schema:
        return document
    what = str(document.get("what", "")) if schema.startswith("isomark.reason/") else ""
    if ended.code == 2 and "--on-part" in what:
        raise Trouble("This isomark is too old: it cannot show the mark on the part.",
                      "Install the newest isomark, or enter the path of a newer one in the add-on's preferences.")
    if what:
        kind = InputTrouble if ended.code == _REJECTED else Trouble
        raise kind(what, _REMEDIES.get(document.get("code"), str(document.get("remedy", ""))))
    lines = (ended.err.strip() or ended.out.strip()).splitlines()
    detail = f": {lines[-1][:200]}" if lines else ""
    raise Trouble(f"The program ended with code {ended.code} and without a result{detail}.",
                  "Check in the add-on's preferences, with Test, that the path is that of isomark.")


# How far two frames may differ and be the same: their origins in mm, their axes as the cosine of the angle.
_SAME_ORIGIN, _SAME_AXIS = 0.02, 0.999999


def is_same_frame(used, frame):
    """Whether the marking frame in a report (None for none) is this one: origin in mm, z and x (None for no frame)."""
    used = used if used and used.get("source") == "part" else None
    if frame is None or used is None:
        return frame is used
    origin, z, x = frame
    away = max(abs(a - b) for a, b in zip(used["origin_mm"], origin))
    return away <= _SAME_ORIGIN and min(_dot(used["z"], z), _dot(used["x"], x)) >= _SAME_AXIS


def _dot(a, b):
    return sum(p * q for p, q in zip(a, b))


def unused_frame(report, frame):
    """A sentence if the report shows that isomark placed the drawing with another marking frame than this one, which is
    origin in mm, z and x (or None for no frame); otherwise None."""
    placement = report.get("placement") or {}
    used = placement.get("frame") or {}
    if is_same_frame(used, frame):
        return None
    if used.get("source") == "part":
        return ("Do not mark it: it is at another place, because another drawing of this SKU was sent with another frame. Enter "
                "another SKU for this drawing, and send it again.")
    return ("The frame was not used: the settings name another side (`facing`), or this isomark is too old for frames. "
            "Remove `facing` from the settings, or install the newest isomark.")


def version(ended):
    """The text of `isomark --version`. Raises Trouble if another program answered."""
    text = ended.out.strip()
    if ended.code != 0 or not text.startswith("isomark "):
        raise Trouble("The program does not answer like isomark.", _INSTALL)
    return text.splitlines()[0]


