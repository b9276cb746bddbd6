#!/usr/bin/env python3
"""Tests the add-on in Blender without a window.

    python3 run.py --isomark PROGRAM [--blender PROGRAM] [TEST ...]

Runs in this Python if it has the module bpy, otherwise in the Blender named or on PATH. Exit code 77: there is neither.
Settings and add-ons of the user are not touched.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
NO_BLENDER = 77
LIMIT_S = 600


def main():
    """Runs the tests in a host and returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--isomark", required=True, type=Path)
    parser.add_argument("--blender")
    parser.add_argument("tests", nargs="*")
    options = parser.parse_args()
    host = host_command(options.blender)
    if host is None:
        print("neither the module bpy nor Blender is installed")
        return NO_BLENDER
    with tempfile.TemporaryDirectory(prefix="isomark-blender-") as folder:
        subprocess.run([sys.executable, HERE.parent / "package.py", folder], check=True, stdout=subprocess.DEVNULL)
        result = Path(folder) / "result.txt"
        environment = dict(os.environ, BLENDER_USER_RESOURCES=folder, PYTHONDONTWRITEBYTECODE="1")
        # Debian's Blender uses the libraries of the first python3 on PATH, which must be that of the system.
        environment["PATH"] = os.pathsep.join([os.path.dirname(host[0]), environment.get("PATH", "")])
        arguments = [str(options.isomark.resolve()), folder, *options.tests]
        ended = subprocess.run([*host, *arguments], env=environment, timeout=LIMIT_S, check=False)
        # Some Blenders crash in their exit handlers after the work is done; the file states how the tests ended.
        ok = result.is_file() and result.read_text() == "ok"
        if not ok:
            print(f"the tests failed (exit code {ended.returncode})")
        return 0 if ok else 1


def host_command(blender=None):
    """The command that runs host.py, up to its own arguments; None without Blender."""
    script = str(HERE / "host.py")
    if blender is None and importlib.util.find_spec("bpy"):
        return [sys.executable, script, "--"]
    blender = blender or shutil.which("blender")
    return blender and [blender, "-b", "--factory-startup", "--python-exit-code", "3", "-P", script, "--"]


if __name__ == "__main__":
    sys.exit(main())
