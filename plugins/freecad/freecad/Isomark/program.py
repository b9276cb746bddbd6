# SPDX-License-Identifier: MIT OR Apache-2.0
"""The program `isomark`: where it is, how it is started, and what it answers. Without Qt."""

import json
import os
import shutil
import sys

from .wording import Trouble, translate

#: Variables that a packaged FreeCAD sets for itself and that mislead other programs.
UNWANTED = (
    "LD_LIBRARY_PATH",
    "LD_PRELOAD",
    "PYTHONHOME",
    "PYTHONPATH",
    "QT_PLUGIN_PATH",
    "QT_QPA_PLATFORM_PLUGIN_PATH",
)


def _usual_folders():
    home = os.path.expanduser("~")
    folders = [os.path.join(home, ".cargo", "bin"), os.path.join(home, ".local", "bin")]
    if os.name == "nt":
        for variable in ("LOCALAPPDATA", "ProgramFiles", "ProgramW6432"):
            base = os.environ.get(variable)
            if base:
                folders += [os.path.join(base, "Programs", "isomark"), os.path.join(base, "isomark")]
    else:
        folders += ["/usr/local/bin", "/usr/bin", "/opt/isomark", "/opt/isomark/bin", "/opt/homebrew/bin"]
    return folders


def _is_program(path):
    return os.path.isfile(path) and os.access(path, os.X_OK)


def install_remedy():
    text = translate("Isomark", "Install isomark, or enter the path of the program under Program and click Test.")
    if os.path.exists("/.flatpak-info"):
        text += " " + translate(
            "Isomark",
            "This FreeCAD runs in a Flatpak sandbox and cannot start programs of the system: use another package of "
            "FreeCAD, or copy isomark into a folder that the sandbox can see.",
        )
    return text


def find(preference):
    """The path of the program: from the preference, `ISOMARK`, the search path, or the usual folders.

    A path that the user or `ISOMARK` gives is used or refused, never replaced silently. Raises `Trouble`.
    """
    for path, source in (
        (preference, translate("Isomark", "the path under Program")),
        (os.environ.get("ISOMARK", ""), translate("Isomark", "the variable ISOMARK")),
    ):
        path = os.path.expanduser(path.strip())
        if not path:
            continue
        if os.path.isdir(path):
            path = os.path.join(path, "isomark.exe" if os.name == "nt" else "isomark")
        if not os.path.exists(path):
            raise Trouble(
                translate("Isomark", "There is no program {path} ({source}).", path=path, source=source),
                translate("Isomark", "Correct the path, or empty it to search for isomark."),
            )
        if not _is_program(path):
            raise Trouble(
                translate("Isomark", "{path} is not a program ({source}).", path=path, source=source),
                translate("Isomark", "Enter the path of isomark itself, and make sure that you may run it."),
            )
        return path
    name = "isomark.exe" if os.name == "nt" else "isomark"
    found = shutil.which("isomark")
    for path in [found] if found else [os.path.join(folder, name) for folder in _usual_folders()]:
        if _is_program(path):
            return path
    raise Trouble(translate("Isomark", "isomark was not found on this computer."), install_remedy())


def environment():
    """The environment of the program: that of FreeCAD without what FreeCAD set for itself."""
    return {name: value for name, value in os.environ.items() if name not in UNWANTED}


def correct_arguments(part, drawing, out, on_part, cache, sku, options):
    """The arguments that correct a drawing for the panel."""
    arguments = ["correct", part, drawing, "--out", out, "--on-part", on_part, "--json"]
    arguments += ["--sku", sku, "--cache", cache, "--anchor", options.get("anchor", "origin")]
    if options.get("rotate_deg"):
        arguments += ["--rotate", "%g" % options["rotate_deg"]]
    if options.get("width_mm"):
        arguments += ["--width", "%g" % options["width_mm"]]
    if options.get("station"):
        arguments += ["--station", options["station"]]
    return arguments


def answer(code, output, errors):
    """The JSON document that the program wrote. Raises `Trouble` if it did not do what was asked."""
    try:
        document = json.loads(output.decode("utf-8"))
    except ValueError:
        document = None
    if code == 0 and isinstance(document, dict):
        return document
    said = errors.decode("utf-8", "replace").strip()
    reason = document if isinstance(document, dict) else {}
    if code == 2 and "--on-part" in reason.get("what", said):
        raise Trouble(
            translate("Isomark", "This isomark is too old: it cannot draw the mark on the part (--on-part)."),
            translate("Isomark", "Install the isomark that this workbench came with, or a newer one."),
        )
    if reason.get("what"):
        raise Trouble(*words_of(reason))
    if not said:
        said = translate("Isomark", "It ended with code {code} and without an answer.", code=code)
    raise Trouble(
        translate("Isomark", "The program is not isomark, or it failed: {said}", said=said[:500]),
        translate("Isomark", "Check the path under Program with Test."),
    )


def words_of(reason):
    """What is wrong, with the item that it concerns if the sentence does not name it, and what to do."""
    what = in_panel(reason.get("what", ""))
    item = (reason.get("place") or {}).get("item")
    return "%s: %s" % (item, what) if item and item not in what else what, _remedy(reason)


def in_panel(sentence):
    """A sentence of isomark in the words of the panel, which gives the selected faces the name `mark`."""
    for words in ("faces of the part named `mark`", "faces named `mark`"):
        sentence = sentence.replace(words, translate("Isomark", "selected faces"))
    return sentence


def _remedy(reason):
    """What to do: in the panel, where isomark's own sentence names options of its command line."""
    here = {
        "off-surface": translate(
            "Isomark", "Move the drawing over the part, make it smaller, or turn its plane towards the part."
        ),
        "outside-mark": translate(
            "Isomark",
            "Move the drawing, make it smaller, select more faces, or switch off “Only on the selected faces”.",
        ),
        "frame-into-part": translate(
            "Isomark",
            "Switch “Laser on the other side” on or off, or move the drawing in front of the face where the mark belongs.",
        ),
    }
    return here.get(reason.get("code"), reason.get("remedy", ""))


def version(output):
    """The line of `isomark --version`. Raises `Trouble` if another program answered."""
    text = output.decode("utf-8", "replace").strip()
    if not text.startswith("isomark "):
        raise Trouble(
            translate("Isomark", "This program is not isomark: it answers “{text}”.", text=text[:80]),
            translate("Isomark", "Enter the path of isomark."),
        )
    return text.splitlines()[0]


if sys.version_info < (3, 8):
    raise ImportError("the isomark workbench needs Python 3.8 or newer")
