"""Runs inside Blender: installs the zip as a user does, then runs the tests. Started by run.py."""

import importlib
import os
import sys
import traceback
import unittest
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))


def install(folder):
    """Installs and enables the add-on from the zip in the folder; returns the name of its module."""
    archive = str(next(Path(folder).glob("isomark-blender-*.zip")))
    if bpy.app.version < (4, 2, 0):
        bpy.ops.preferences.addon_install(filepath=archive)
        bpy.ops.preferences.addon_enable(module="isomark")
        return "isomark"
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    return "bl_ext.user_default.isomark"


def main():
    """Runs the tests named on the command line, or all."""
    isomark, folder, *names = sys.argv[sys.argv.index("--") + 1:]
    module = install(folder)
    assert module in bpy.context.preferences.addons, "the add-on is not enabled"
    bench = importlib.import_module("bench")
    bench.ISOMARK, bench.MODULE = isomark, module
    print(f"Blender {bpy.app.version_string}", file=sys.stderr)
    loader = unittest.defaultTestLoader
    tests = loader.loadTestsFromNames(names) if names else loader.discover(str(HERE))
    return unittest.TextTestRunner(verbosity=2).run(tests).wasSuccessful()


if __name__ == "__main__":
    good = False
    try:
        good = main()
    except BaseException:
        traceback.print_exc()
    if good:
        (Path(sys.argv[sys.argv.index("--") + 2]) / "result.txt").write_text("ok")
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender 4.2 without a window crashes in its exit handlers.
    os._exit(0 if good else 1)
