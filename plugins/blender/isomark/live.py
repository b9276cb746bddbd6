# SPDX-License-Identifier: GPL-3.0-or-later
"""Corrects again while a person draws: waits for a pause, runs isomark in the background, shows the new mark."""

import bpy

from . import session
from .trouble import Trouble

_EVERY_S = 0.25
_current = None
_changed = False
_choices = None
_quiet = True


def switch(on):
    """Starts or ends it."""
    stop()
    if on:
        _start()


def _start():
    global _changed
    _changed = True
    if _note_change not in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.append(_note_change)
    bpy.app.timers.register(_tick, first_interval=_EVERY_S)


def stop():
    """Ends it, with its child process."""
    global _current
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
    try:
        _step(bpy.context)
    except Trouble as trouble:
        session.note(bpy.context.scene, trouble)
        session.redraw()
    # A change since the last call means that somebody is moving something.
    _quiet = True
    return _EVERY_S


def _step(context):
    global _current, _changed, _choices
    # Blender reports neither what is chosen in the panel nor the unit of the scene.
    if _choices != (_choices := session.choices(context)):
        _changed, session.live_digest = True, None
    if _current is not None:
        if _current.cancelled:
            _current.end()
        elif not _current.poll():
            return
        run, _current, session.run = _current, None, None
        if not run.cancelled:
            run.finish(context)
        session.redraw()
    elif _changed and _quiet and session.run is None:
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
