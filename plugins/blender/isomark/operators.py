# SPDX-License-Identifier: GPL-3.0-or-later
"""What the buttons do."""

import math
import time

import bpy
from bpy.props import IntProperty
from mathutils import Matrix, Vector

from . import drawing, live, mark, part, program, session, station
from .trouble import Trouble

_TICK_S = 0.1


class IsomarkUseSelected(bpy.types.Operator):
    """Uses the selected mesh as the part, the selected curves, texts and strokes as the drawing, and the selected empty as
    the frame"""
    bl_idname = "isomark.use_selected"
    bl_label = "Use Selected"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        settings = context.scene.isomark
        chosen = [item for item in context.selected_objects if not mark.is_ours(item)]
        parts = [item for item in chosen if item.type in part.TYPES]
        drawings = sorted((item for item in chosen if item.type in drawing.TYPES), key=lambda item: item.name)
        empties = [item for item in chosen if drawing.is_frame(item)]
        instances = [item.name for item in chosen if drawing.shows_collection(item)]
        if instances:
            self.report({"ERROR"}, f"{instances[0]} shows a collection: it is neither a part nor a frame. Make its objects real "
                                   "with Object > Apply > Make Instances Real, and select the part.")
            return {"CANCELLED"}
        for items, what in ((parts, "meshes"), (empties, "empties")):
            if len(items) > 1:
                names = ", ".join(item.name for item in items)
                self.report({"ERROR"}, f"Several {what} are selected: {names}. Select one of them.")
                return {"CANCELLED"}
        if not (parts or drawings or empties):
            self.report({"ERROR"}, "Nothing is selected that can be used. Select the part, the curves and texts of the "
                                   "drawing, and the empty that is the frame; then press Use Selected.")
            return {"CANCELLED"}
        if parts:
            settings.part = parts[0]
        if drawings:
            settings.drawings.clear()
            for item in drawings:
                settings.drawings.add().item = item
        if empties:
            settings.frame = empties[0]
        return {"FINISHED"}


class IsomarkRemoveDrawing(bpy.types.Operator):
    """Removes the object from the drawing; the object stays in the scene"""
    bl_idname = "isomark.remove_drawing"
    bl_label = "Remove from Drawing"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(options={"HIDDEN"})

    def execute(self, context):
        context.scene.isomark.drawings.remove(self.index)
        return {"FINISHED"}


class IsomarkAddFrame(bpy.types.Operator):
    """Adds an empty as the frame, on the part at the point that is nearest to the 3D cursor (Shift + right click)"""
    bl_idname = "isomark.add_frame"
    bl_label = "Add Frame at 3D Cursor"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT"

    def execute(self, context):
        settings = context.scene.isomark
        origin, z, size = context.scene.cursor.location.copy(), Vector((0, 0, 1)), 0.02
        item = settings.part
        if item is not None:
            origin, z = part.nearest(item, origin, context) or (origin, z)
            size = max(item.dimensions) * 0.2
        level = Vector((0, 0, 1)).cross(z)
        x = level.normalized() if level.length > 0.1 else Vector((1, 0, 0))
        x = (x - z * x.dot(z)).normalized()
        empty = bpy.data.objects.new("frame", None)
        empty.empty_display_type = "ARROWS"
        empty.empty_display_size = size
        axes = Matrix((x, z.cross(x), z)).transposed().to_4x4()
        empty.matrix_world = Matrix.Translation(origin) @ axes
        context.scene.collection.objects.link(empty)
        settings.frame = empty
        return {"FINISHED"}


class IsomarkLayOnFrame(bpy.types.Operator):
    """Lays the drawing on the frame: the origin of its first object on the frame's origin, with X and Y along the frame's.
    Objects that are parallel to the first keep their place beside it; others are laid on the origin, too"""
    bl_idname = "isomark.lay_on_frame"
    bl_label = "Lay Drawing on Frame"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and context.scene.isomark.frame is not None

    def execute(self, context):
        settings = context.scene.isomark
        items = [entry.item for entry in settings.drawings if entry.item is not None]
        context.view_layer.update()
        try:
            frame = drawing.frame_of(settings.frame, context)
            places = _places_on(frame, items)
        except Trouble as trouble:
            self.report({"ERROR"}, str(trouble))
            return {"CANCELLED"}
        # A parent takes its children along, so it is laid before them.
        for item, place in sorted(places, key=lambda entry: _depth(entry[0])):
            # Blender states every mirror of a matrix as three negative scales; this keeps the axis that is mirrored.
            signs = _signs(item)
            item.matrix_world = place @ Matrix.Diagonal((*signs, 1))
            item.scale = [scale * sign for scale, sign in zip(item.scale, signs)]
            context.view_layer.update()
        held = [item.name for item, place in places if not _is_close(item.matrix_world, place)]
        if held:
            self.report({"WARNING"}, f"Not laid on the frame: {', '.join(held)}. Remove what holds it: constraints, drivers, "
                                     "animation, locks, or a parent whose scale differs between the axes.")
        return {"FINISHED"}


# Cosine of the angle up to which two planes are parallel: 0.1 degrees.
_PARALLEL = 1 - 1.5e-6


def _places_on(frame, items):
    """The objects with their matrices on the frame.

    Raises Trouble if one has no axes, because its scale is 0.
    """
    found, first = [], None
    place = Matrix.Translation(frame.origin) @ Matrix(frame.axes.tolist()).to_4x4()
    for item in items:
        axes = _axes(item, place.col[2].to_3d())
        first = first or axes.inverted()
        beside = first @ axes
        if beside[2][2] > _PARALLEL:
            # Beside the first, and in its plane.
            beside[2][3] = 0
        else:
            beside = Matrix.Identity(4)
        found.append((item, place @ beside @ axes.inverted() @ item.matrix_world))
    return found


def _signs(item):
    """1 for each axis of an object, -1 where its own scale mirrors it."""
    return [math.copysign(1, scale * delta) for scale, delta in zip(item.scale, item.delta_scale)]


def _axes(item, normal):
    """The origin of an object and its axes X and Y, without scale; a mirrored object has those of before the mirror.

    `normal` is that of the frame: who sees an object in another plane sees it from above.
    """
    world, signs = item.matrix_world, _signs(item)
    if abs(world.determinant()) <= 1e-12 * max(1e-12, math.prod(axis.length for axis in world.to_3x3().col)):
        raise Trouble(f"The object {item.name} has the scale 0.", "Clear its scale with Alt+S.")
    x, y = world.col[0].to_3d(), world.col[1].to_3d()
    z = x.cross(y)
    above = normal if abs(z.normalized().dot(normal)) > _PARALLEL else Vector((0, 0, 1))
    is_mirrored = world.determinant() < 0
    if is_mirrored != (math.prod(signs) < 0) or signs == [-1, -1, -1] and z.dot(above) < 0:
        # A parent mirrors it, or a matrix did, from which Blender made three negative scales.
        signs = [-1 if is_mirrored else 1, 1, 1]
    x, z = (x * signs[0]).normalized(), (z * signs[0] * signs[1]).normalized()
    return Matrix.Translation(world.translation) @ Matrix((x, z.cross(x), z)).transposed().to_4x4()


def _depth(item):
    """The number of an object's parents."""
    return 0 if item.parent is None else 1 + _depth(item.parent)


def _is_close(matrix, other):
    size = max(abs(value) for row in other for value in row)
    return all(abs(one - two) <= 1e-4 * size for row, second in zip(matrix, other) for one, two in zip(row, second))


class _Background(bpy.types.Operator):
    """An operator that waits for a child process in the background, and that ESC ends."""
    bl_options = {"INTERNAL"}
    job = None
    _timer = None

    def begin(self, context):
        """Starts; returns what has `poll` and `end`. Raises Trouble."""
        raise NotImplementedError

    def complete(self, context):
        """Uses the result. Raises Trouble."""
        raise NotImplementedError

    def fail(self, context, trouble):
        """Shows the trouble. Returns how the operator ends: only after FINISHED, Blender pushes an undo step."""
        self.report({"ERROR"}, str(trouble))
        session.redraw()
        return {"CANCELLED"}

    def invoke(self, context, _event):
        try:
            self.job = self.begin(context)
        except Trouble as trouble:
            return self.fail(context, trouble)
        self._timer = context.window_manager.event_timer_add(_TICK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        session.redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC" or getattr(self.job, "cancelled", False):
            self.cancel(context)
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if not self.job.poll():
                return {"PASS_THROUGH"}
            self.release(context)
            self.complete(context)
        except Trouble as trouble:
            self.cancel(context)
            return self.fail(context, trouble)
        session.redraw()
        return {"FINISHED"}

    def execute(self, context):
        """Waits for the result: for scripts."""
        try:
            self.job = self.begin(context)
            while not self.job.poll():
                time.sleep(_TICK_S / 10)
            self.release(context)
            self.complete(context)
        except Trouble as trouble:
            self.release(context)
            return self.fail(context, trouble)
        return {"FINISHED"}

    def cancel(self, context):
        """Ends the child process; Blender calls this, too, when a file is loaded or the window is closed."""
        self.job.end()
        self.release(context)
        session.redraw()

    def release(self, context):
        """Removes the timer."""
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None


class IsomarkShow(_Background):
    """Corrects the drawing for the part and shows the mark on it (ESC cancels)"""
    bl_idname = "isomark.show"
    bl_label = "Show Mark on Part"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, _context):
        return session.run is None

    def begin(self, context):
        session.run = session.Run(context)
        return session.run

    def complete(self, context):
        self.job.finish()

    def fail(self, context, trouble):
        scene = context.scene if self.job is None else self.job.scene
        is_changed = session.note(scene, trouble)
        ending = super().fail(context, trouble)
        return {"FINISHED"} if is_changed else ending

    def release(self, context):
        super().release(context)
        session.run = None


class IsomarkTest(_Background):
    """Runs isomark once and shows its version"""
    bl_idname = "isomark.test"
    bl_label = "Test"

    def begin(self, context):
        session.version, session.version_trouble = "", None
        self.path = session.find_program(context)
        self.child = program.Child(self.path, ["--version"], 10)
        return self.child

    def complete(self, context):
        session.version = f"{program.version(self.child.wait())} ({self.path})"
        self.report({"INFO"}, session.version)

    def fail(self, context, trouble):
        session.version_trouble = trouble
        return super().fail(context, trouble)


class IsomarkCancel(bpy.types.Operator):
    """Ends isomark"""
    bl_idname = "isomark.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    def execute(self, _context):
        if session.run is not None:
            session.run.cancelled = True
        return {"FINISHED"}


class IsomarkClear(bpy.types.Operator):
    """Removes the shown mark from the scene"""
    bl_idname = "isomark.clear"
    bl_label = "Remove Mark"
    bl_options = {"UNDO"}

    def execute(self, context):
        settings = context.scene.isomark
        is_changed = bool(settings.outcome)
        settings.outcome = ""
        return {"FINISHED"} if mark.clear(context.scene) or is_changed else {"CANCELLED"}


class IsomarkSend(bpy.types.Operator):
    """Sends the part and the drawing to the hot folder, then shows the station's answer here"""
    bl_idname = "isomark.send"
    bl_label = "Send to Hot Folder"
    bl_options = {"INTERNAL"}

    def execute(self, context):
        preferences = session.preferences(context)
        before = session.courier
        if before is not None:
            before.stop()
            session.courier = None
        path, file, folder = map(session.path_of, (preferences.program, preferences.station, preferences.hot_folder))
        try:
            export = session.Export(context)
        except Trouble as trouble:
            session.send_trouble = trouble
            self.report({"ERROR"}, str(trouble))
            return {"CANCELLED"}
        session.send_trouble = None
        is_confirmed = before is not None and before.answer.kind == station.ASKING and before.files == export.files()
        session.courier = station.Courier(lambda: station.at(file, folder), export.sku, export.files(),
                                          lambda: program.find(path), export.frame, is_confirmed)
        session.courier.start()
        if not bpy.app.timers.is_registered(_follow):
            bpy.app.timers.register(_follow, first_interval=_TICK_S)
        return {"FINISHED"}


def _follow():
    """Draws the answer again until it is final."""
    session.redraw()
    if session.courier is not None and session.courier.is_alive():
        return 0.3
    return None


CLASSES = (IsomarkUseSelected, IsomarkRemoveDrawing, IsomarkAddFrame, IsomarkLayOnFrame, IsomarkShow, IsomarkTest,
           IsomarkCancel, IsomarkClear, IsomarkSend)


@bpy.app.handlers.persistent
def _before_load(*_):
    live.stop()
    session.end()


def register():
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.app.handlers.load_pre.append(_before_load)


def unregister():
    live.stop()
    session.end()
    if bpy.app.timers.is_registered(_follow):
        bpy.app.timers.unregister(_follow)
    bpy.app.handlers.load_pre.remove(_before_load)
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
