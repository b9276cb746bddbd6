"""Sends files and kills itself at one step. Started by test_station.py without Blender:
killed.py STATION.PY FOLDER write|sync|rename|renamed NUMBER NAME...; the content of NAME is in FOLDER/.NAME.source."""

import importlib
import os
import signal
import sys
import types
from pathlib import Path

source, folder, action, number, *names = sys.argv[1:]
package = types.ModuleType("isomark")
package.__path__ = [os.path.dirname(source)]
sys.modules["isomark"] = package
station = importlib.import_module("isomark.station")
calls = dict.fromkeys(("write", "sync", "rename", "renamed"), 0)


def step(name):
    """Counts a step; the chosen one is the last."""
    calls[name] += 1
    if name == action and calls[name] == int(number):
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))


class HalfWritten:
    """A file that has half of its content on the disk before the step, and the rest after it."""

    def __init__(self, path, mode):
        self.file = open(path, mode)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()

    def write(self, data):
        """Writes both halves."""
        self.file.write(data[:len(data) // 2])
        self.file.flush()
        step("write")
        self.file.write(data[len(data) // 2:])

    def __getattr__(self, name):
        return getattr(self.file, name)


sync, replace = os.fsync, os.replace


def counted_sync(file):
    """Flushes after the step."""
    step("sync")
    sync(file)


def counted_replace(old, new):
    """Renames between two steps."""
    step("rename")
    replace(old, new)
    step("renamed")


station.open = HalfWritten
os.fsync, os.replace = counted_sync, counted_replace
station.put(Path(folder), [(name, (Path(folder) / f".{name}.source").read_bytes()) for name in names])
