# SPDX-License-Identifier: MIT OR Apache-2.0
"""One drawing on one part: the files that the program reads, and what it found. Without Qt."""

import os
import tempfile

from . import dxf, glb, program, station
from .choice import is_under
from .wording import Trouble, translate


class Files:
    """The part and the drawing as the program and the station get them."""

    def __init__(self, part, drawing, ending, source=""):
        self.part = part
        self.drawing = drawing
        self.ending = ending
        #: The file that the drawing was read from; empty for objects.
        self.source = source

    def is_current(self):
        """Whether the file of the drawing is still the one that was read."""
        if not self.source:
            return True
        try:
            with open(self.source, "rb") as file:
                return file.read() == self.drawing
        except OSError:
            return False


def read(path):
    """The bytes of the file of a drawing. Raises `Trouble`."""
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError as error:
        what = translate("Isomark", "The drawing {file} does not exist.", file=path)
        if not isinstance(error, FileNotFoundError):
            what = translate("Isomark", "The drawing {file} cannot be read: {error}.", file=path, error=error.strerror)
        raise Trouble(what, translate("Isomark", "Choose the drawing again with File.")) from error


def files(choice, tessellated, frame, data=None):
    """The files of what was chosen; `data` is what was read from the file of the drawing. Raises `Trouble`."""
    part = tessellated.glb(frame)
    if choice.file:
        data = read(choice.file) if data is None else data
        return Files(part, data, os.path.splitext(choice.file)[1].lower(), choice.file)
    paths = choice.paths(frame)
    if not is_under(tessellated.points(), frame, dxf.extents(paths)):
        raise Trouble(
            translate("Isomark", "No face of the part is under the drawing."),
            translate(
                "Isomark",
                "Move the drawing in front of the part, as seen along the normal of its plane, or choose the part that "
                "is under it.",
            ),
        )
    return Files(part, dxf.write(paths), ".dxf")


class Folder:
    """A temporary folder for the program's files, with the surfaces that it keeps; it is removed with `close`."""

    def __init__(self):
        self._folder = tempfile.TemporaryDirectory(prefix="isomark-freecad-")
        self.path = self._folder.name

    def place(self, name):
        return os.path.join(self.path, name)

    def close(self):
        try:
            self._folder.cleanup()
        except OSError:
            # On Windows a virus scanner may keep a file open; the system removes its temporary files.
            pass


class Run:
    """The arguments of one run of the program, and what it wrote."""

    def __init__(self, folder, made, product, drawing, options):
        part, _, pattern = station.drop_names(product, drawing, made.ending)
        self._on_part = folder.place("on-part.glb")
        for name, data in ((part, made.part), (pattern, made.drawing)):
            with open(folder.place(name), "wb") as file:
                file.write(data)
        for stale in (self._on_part,):
            if os.path.exists(stale):
                os.remove(stale)
        self.out = folder.place("corrected.dxf")
        self.arguments = program.correct_arguments(
            folder.place(part),
            folder.place(pattern),
            self.out,
            self._on_part,
            folder.place("cache"),
            product,
            options,
        )

    def result(self, code, output, errors):
        """The report, and the mark on the part. Raises `Trouble`."""
        report = program.answer(code, output, errors)
        try:
            with open(self._on_part, "rb") as file:
                mark = glb.read_mark(file.read())
        except (OSError, glb.NotReadable) as error:
            raise Trouble(
                translate("Isomark", "isomark drew no mark that can be shown: {error}.", error=error),
                translate("Isomark", "Install the isomark that this workbench came with, or a newer one."),
            ) from error
        return report, mark


def numbers(report):
    """The rows of the panel: a name and a text with the value, before and after the correction where both exist."""
    quality = report.get("quality") or {}
    before, after = quality.get("before") or {}, quality.get("after") or {}

    def row(name, key, factor, digits, unit):
        values = ["%.*f" % (digits, side[key] * factor) if key in side else "–" for side in (before, after)]
        return (name, "%s → %s %s" % (values[0], values[1], unit))

    rows = [
        row(translate("Isomark", "Length error"), "length_error_mm", 1.0, 3, "mm"),
        row(translate("Isomark", "Largest stretch"), "largest_stretch", 100.0, 2, "%"),
    ]
    if after.get("area_mm2"):
        rows.append(row(translate("Isomark", "Area error"), "area_error_mm2", 1.0, 2, "mm²"))
    incidence = (report.get("exposure") or {}).get("incidence_deg")
    if incidence is not None:
        rows.append((translate("Isomark", "Beam to normal"), "≤ %.1f°" % incidence))
    if "length_mm" in after:
        rows.append((translate("Isomark", "Lines"), "%.1f mm" % after["length_mm"]))
    return rows


def notices(report):
    """What a person should know, warnings first: pairs of the severity and the sentence."""
    found = []
    facts = [(report.get(name) or {}).get("facts") or {} for name in ("part", "pattern")]
    for source in [report] + facts:
        for notice in source.get("notices", []):
            entry = (str(notice.get("severity", "")), program.in_panel(notice.get("message", "")))
            # The unit and the axes of the files are those that this workbench writes.
            is_about_file = notice.get("code") in ("unit-assumed", "axis-assumed") and entry[0] == "note"
            if entry not in found and not is_about_file:
                found.append(entry)
    return sorted(found, key=lambda entry: entry[0] != "warning")
