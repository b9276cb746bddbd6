# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrects again while a person draws: waits for a pause, runs isomark in the background, shows the new mark."""

import bpy

from . import session
from .trouble import Trouble

_EVERY_S = 0.25
# The name of the scene that it follows: undo replaces the scene itself. None while it is off.
_scene = None
_current = None
_changed = False
_choices = None
_quiet = True


def is_on(scene):
    """Whether it follows this scene."""
    return _scene is not None and _scene == scene.name


def switch(scene, on):
    """Starts it for this scene, or ends it."""
    stop()
    if on:
        _start(scene)


def _start(scene):
    global _changed, _scene
    _changed, _scene = True, scene.name
    if _note_change not in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.append(_note_change)
    bpy.app.timers.register(_tick, first_interval=_EVERY_S)


def stop():
    """Ends it, with its child process."""
    global _current, _scene
    _scene = None
    if _note_change in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.remove(_note_change)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    if _current is not None:
        _current.end()
        _current = None
        session.run = None
    session.live_digest = None


def _note_change(_, depsgraph):
    global _changed, _quiet
    if any(update.is_updated_geometry or update.is_updated_transform for update in depsgraph.updates):
        _changed, _quiet = True, False


def _tick():
    """Called by Blender between events; returns when to call again."""
    global _quiet
    scene = bpy.data.scenes.get(_scene) if _scene is not None else None
    if scene is None:
        # It was removed or renamed. Another scene keeps its mark.
        stop()
        session.redraw()
        return None
    try:
        if _current is not None:
            _finish()
        elif bpy.context.scene == scene:
            _begin(bpy.context)
    except Trouble as trouble:
        session.note(scene, trouble)
        session.redraw()
    # A change since the last call means that somebody is moving something.
    _quiet = True
    return _EVERY_S


def _finish():
    """Shows the mark as soon as the child process has ended."""
    global _current
    run, is_over = _current, True
    try:
        is_over = run.cancelled or run.poll()
    finally:
        # Also after the time limit, which raises Trouble.
        if is_over:
            _current = session.run = None
    if run.cancelled:
        run.end()
    elif is_over:
        run.finish()
    else:
        return
    session.redraw()


def _begin(context):
    """Starts a correction if something has changed and nobody is moving it."""
    global _current, _changed, _choices
    # Blender reports neither what is chosen in the panel, nor what is hidden, nor the unit of the scene.
    if _choices != (_choices := session.choices(context)):
        _changed, session.live_digest = True, None
    if _changed and _quiet and session.run is None:
        try:
            export = session.Export(context)
        except Trouble:
            session.live_digest = None
            raise
        finally:
            # Reading what is being edited makes Blender report a change.
            _changed = False
        # The new mark is a change of the scene, too.
        if export.digest() != session.live_digest:
            session.live_digest = export.digest()
            _current = session.run = session.Run(context, export)
            session.redraw()
