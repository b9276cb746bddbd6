"""Starts isomark for the tests, and ends them with a code that the caller sees."""

import os
import subprocess
import traceback

PLUGIN = os.path.join(os.path.dirname(__file__), "..", "..", "..", "plugins", "freecad", "freecad")


def use_plugin():
    """Makes the workbench importable without installing it."""
    import freecad

    if PLUGIN not in freecad.__path__:
        freecad.__path__.append(PLUGIN)


def isomark(*arguments):
    """Exit code and outputs of the program, started as the workbench starts it."""
    from freecad.Isomark import program

    done = subprocess.run(
        [program.find("")] + list(arguments), capture_output=True, env=program.environment(), timeout=120
    )
    return done.returncode, done.stdout, done.stderr


def say(*words):
    """Prints a line; FreeCAD leaves unfinished lines with its progress on standard output."""
    print("\n" + " ".join(str(word) for word in words), flush=True)


def run(tests):
    """Runs the functions, prints one line for each, and ends the process: FreeCAD's own exit code does not show failures."""
    wrong = 0
    for test in tests:
        try:
            test()
            say("ok", test.__name__)
        except BaseException:
            wrong += 1
            say("FAILED", test.__name__, traceback.format_exc())
    os._exit(1 if wrong else 0)
