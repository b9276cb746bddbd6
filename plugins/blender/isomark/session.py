# SPDX-License-Identifier: GPL-3.0-or-later
"""What runs at the moment: one correction, one test of the program, one courier. Nothing of it is saved in a file."""

import json
import shutil
import tempfile
from pathlib import Path

import bpy

from . import drawing, dxf, glb, mark, part, program, station
from .trouble import InputTrouble, Trouble

_RUN_LIMIT_S = 300

run = None
courier = None
version = ""
version_trouble = None
live_digest = None
send_trouble = None

_folder = None
_last_glb = {}


def preferences(context):
    """The add-on's preferences."""
    return context.preferences.addons[__package__].preferences


def path_of(text):
    """A path from a field of Blender, where `//` is the folder of the saved file."""
    return bpy.path.abspath(text) if text else ""


def find_program(context):
    """The path of isomark. Raises Trouble if there is none."""
    return program.find(path_of(preferences(context).program))


def names(settings):
    """The names of the product and of the drawing under which the files are sent; None for what is not chosen yet."""
    first = next((entry.item for entry in settings.drawings if entry.item is not None), None)
    sku, name = settings.sku or settings.part and settings.part.name, settings.name or first and first.name
    return sku and station.plain_name(sku, "part"), name and station.plain_name(name, "drawing")


def choices(context):
    """What a person chooses and shows beside the objects themselves, as a value that changes with any of it."""
    settings, chosen = context.scene.isomark, preferences(context)
    items = (settings.part, settings.frame, *(entry.item for entry in settings.drawings))
    return (context.scene.unit_settings.scale_length, settings.sku, settings.name, chosen.program, chosen.station,
            tuple(item and (item.name, item.name in context.view_layer.objects,
                            item.visible_get(view_layer=context.view_layer)) for item in items))


class Export:
    """The part and the drawing of a scene as files, with sentences about what was not taken as it is."""

    def __init__(self, context):
        """Reads the scene. Raises InputTrouble with what is missing or wrong."""
        settings = context.scene.isomark
        items = [entry.item for entry in settings.drawings if entry.item is not None]
        frame = drawing.frame_of(settings.frame, context)
        read_part = part.read(settings.part, frame if settings.frame else None, context)
        read_drawing = drawing.read(items, frame, context)
        # Origin in mm, z and x; None without a frame.
        origin = (frame.origin * drawing.millimetres(context.scene)).tolist()
        self.frame = (origin, frame.axes[:, 2].tolist(), frame.axes[:, 0].tolist()) if settings.frame else None
        self.sku, self.name = names(settings)
        self.part, self.drawing = read_part.glb, dxf.write(read_drawing.paths)
        self.notices = [*read_part.notices, *read_drawing.notices]

    def files(self):
        """What is sent to a hot folder, in the order in which a station needs it: part, settings, drawing."""
        stem = f"{self.sku}@{self.name}"
        return [(f"{self.sku}.glb", self.part), (f"{stem}.toml", station.sidecar(self.frame)), (f"{stem}.dxf", self.drawing)]

    def digest(self):
        """A value that changes with any of the files."""
        return hash((self.part, self.drawing, self.sku, self.name))


class Run:
    """One correction by isomark, in a child process."""

    def __init__(self, context, export=None):
        """Exports and starts. Raises Trouble."""
        self.export = export or Export(context)
        # Its name, because undo replaces the scene itself.
        self._scene = context.scene.name
        found, settings_file = find_program(context), path_of(preferences(context).station)
        folder = _work_folder()
        place, pattern = folder / f"{self.export.sku}.glb", folder / f"{self.export.name}.dxf"
        self._on_part = folder / "on-part.glb"
        try:
            self._on_part.unlink(missing_ok=True)
            place.write_bytes(self.export.part)
            pattern.write_bytes(self.export.drawing)
            (folder / "out").mkdir(exist_ok=True)
        except OSError as error:
            raise Trouble(f"Cannot write to {folder}: {error.strerror}.", "Free space on the disk.") from error
        # Its own cache: a trial must not replace the surface that a station keeps for this product.
        arguments = ["correct", str(place), str(pattern), "--out", str(folder / "out" / "corrected.dxf"), "--sku",
                     self.export.sku, "--cache", str(folder / "cache"), "--on-part", str(self._on_part), "--json"]
        if self.export.frame is not None:
            arguments += ["--anchor", "origin"]
        if settings_file:
            arguments += ["--station", settings_file]
        self.cancelled = False
        self._child = program.Child(found, arguments, _RUN_LIMIT_S)

    def poll(self):
        """Whether the child process has ended. Raises Trouble after the time limit."""
        return self._child.poll() is not None

    @property
    def scene(self):
        """The scene that it was started for; None if that was removed or renamed."""
        return bpy.data.scenes.get(self._scene)

    def finish(self):
        """Waits, then shows the mark and the values in the scene that it was started for.

        Raises InputTrouble with isomark's reason, and Trouble if there is no result or no scene for it.
        """
        report = program.result(self._child.wait())
        try:
            data = self._on_part.read_bytes()
        except OSError as error:
            raise Trouble("isomark did not write the mark on the part.", "Install the newest isomark.") from error
        on_part = glb.read_on_part(data)
        scene = self.scene
        if scene is None:
            raise Trouble(f"The scene {self._scene} was removed or renamed before the mark was ready.",
                          "Press Show Mark on Part again.")
        _last_glb[scene.name] = on_part
        mark.show(scene, on_part, scene.isomark)
        scene.isomark.outcome = json.dumps(_outcome(report, self.export))

    def end(self):
        """Ends the child process."""
        self._child.end()


def show_again(context):
    """Shows the mark of the last run with changed settings of the display."""
    on_part = _last_glb.get(context.scene.name)
    if on_part and mark.find(context.scene, "mark"):
        mark.show(context.scene, on_part, context.scene.isomark)


def note(scene, trouble):
    """Shows the trouble in the panel of a scene (None for one that is gone). Returns whether this changed the scene.

    A drawing that cannot be corrected removes the mark, which is that of an earlier one; a program that is missing does not.
    """
    if scene is None:
        return False
    outcome = json.dumps({"what": trouble.what, "remedy": trouble.remedy})
    is_changed = scene.isomark.outcome != outcome
    scene.isomark.outcome = outcome
    if isinstance(trouble, InputTrouble):
        is_changed = mark.clear(scene) or is_changed
    return is_changed


def _outcome(report, export):
    """The values for the panel from isomark's report."""
    after, before = report["quality"]["after"], report["quality"].get("before") or {}
    notices = [entry for entry in report.get("notices", []) if entry.get("severity") == "warning"]
    warnings = [*export.notices, *(entry.get("message", "") for entry in notices)]
    if unused := program.unused_frame(report, export.frame):
        warnings.insert(0, unused)
    return {
        "length_mm": after["length_mm"],
        "before_mm": before.get("length_error_mm"),
        "after_mm": after["length_error_mm"],
        "stretch_before": before.get("largest_stretch"),
        "stretch_after": after["largest_stretch"],
        "incidence_deg": report["exposure"]["incidence_deg"],
        "warnings": warnings,
        "program": report.get("program", ""),
    }


def _work_folder():
    global _folder
    if _folder is None or not _folder.is_dir():
        try:
            _folder = Path(tempfile.mkdtemp(prefix="isomark-"))
        except OSError as error:
            raise Trouble(f"Cannot create a temporary folder: {error.strerror or error}.",
                          "Free space on the disk, or choose another folder under Preferences > File Paths > Temporary Files.") from error
    return _folder


def end():
    """Ends everything that runs, and removes the temporary files."""
    global run, courier, _folder, live_digest
    if run is not None:
        run.end()
        run = None
    if courier is not None:
        courier.stop()
        courier = None
    program.end_all()
    live_digest = None
    _last_glb.clear()
    if _folder is not None:
        shutil.rmtree(_folder, ignore_errors=True)
        _folder = None


def redraw():
    """Draws the panels again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "PREFERENCES"):
                area.tag_redraw()
