"""The workbench in a real window: what a user clicks, and what the panel then shows.

Run by freecad on an X server, with the workbench installed; `ISOMARK` names the program. Clicks are real: xdotool moves the
pointer. With `ISOMARK_PICTURES`, pictures of the window are kept in that folder; with `ISOMARK_PANEL_PICTURE`, the picture of
README is written there.
"""

import os
import shutil
import subprocess
import tempfile
import threading
import traceback

import FreeCAD
import FreeCADGui
import Part
from PySide import QtCore, QtGui

PICTURES = os.environ.get("ISOMARK_PICTURES", "")
PANEL_PICTURE = os.environ.get("ISOMARK_PANEL_PICTURE", "")
#: The longest time for any step, ms.
PATIENCE = 40000

Vector = FreeCAD.Vector
folder = tempfile.mkdtemp(prefix="isomark-window-")
station_process = None


class Until:
    """A condition to wait for."""

    def __init__(self, ready, what):
        self.ready, self.what = ready, what


def say(*words):
    print("\n" + " ".join(str(word) for word in words), flush=True)


def picture(name):
    if PICTURES:
        QtGui.QApplication.primaryScreen().grabWindow(0).save(os.path.join(PICTURES, name + ".png"))


def pointer(place, ctrl=False):
    """Clicks at a point of the screen, in Qt's coordinates: press, pause, release."""
    ratio = FreeCADGui.getMainWindow().devicePixelRatioF()
    x, y = round(place.x() * ratio), round(place.y() * ratio)
    keys = (["keydown", "ctrl"], ["keyup", "ctrl"]) if ctrl else ([], [])
    command = ["xdotool", "mousemove", str(x - 1), str(y), "mousemove", str(x), str(y), "sleep", "0.3"] + keys[0]
    command += ["mousedown", "1", "sleep", "0.2", "mouseup", "1", "sleep", "0.2"] + keys[1]
    process = subprocess.Popen(command)
    return Until(lambda: process.poll() is not None, "the pointer")


def click(widget):
    """Clicks the middle of a widget, after making it visible and when it stays at its place."""
    # While the panel changes its height, what was made visible leaves the visible part again.
    yield settled(widget)
    area = widget.parent()
    while area is not None and not isinstance(area, QtGui.QScrollArea):
        area = area.parent()
    if area is not None:
        area.ensureWidgetVisible(widget)
        QtGui.QApplication.processEvents()
    yield settled(widget)
    yield pointer(widget.mapToGlobal(widget.rect().center()))


def click_in_view(point, ctrl=False):
    """Clicks a point of the document in the 3-D view."""
    view = FreeCADGui.activeDocument().activeView()
    x, y = view.getPointOnScreen(Vector(*point))
    window = FreeCADGui.getMainWindow()
    viewports = [area for area in window.findChildren(QtGui.QGraphicsView) if area.isVisible()]
    viewport = max(viewports, key=lambda area: area.width() * area.height())
    # The y of the view points up; its unit is a pixel of the screen.
    ratio = viewport.devicePixelRatioF()
    place = viewport.mapToGlobal(QtCore.QPoint(int(x / ratio), viewport.height() - int(y / ratio)))
    return pointer(place, ctrl)


def toolbar_button(command):
    window = FreeCADGui.getMainWindow()
    for bar in window.findChildren(QtGui.QToolBar):
        for action in bar.actions():
            if action.objectName() == command or action.data() == command or action.text() == "Mark on part":
                widget = bar.widgetForAction(action)
                if widget is not None and widget.isVisible():
                    return widget
    raise AssertionError("no button for " + command)


def panel():
    from freecad.Isomark import panel

    return panel.opened()


def settled(widget):
    """A condition: the widget stays at one place; the window arranges itself in several steps."""
    seen = []

    def ready():
        found = widget() if callable(widget) else widget
        seen.append(found.mapToGlobal(found.rect().center()))
        return len(seen) > 10 and len({(place.x(), place.y()) for place in seen[-10:]}) == 1

    return Until(ready, "a window at rest")


def shows(label, *words):
    """A condition: the label of the panel shows all words."""

    def ready():
        # Without the places where long words may be divided.
        text = label.text().replace("\u200b", "") if label.isVisible() else ""
        return all(word in text for word in words)

    return Until(ready, "%r in %s, which shows %r" % (words, label.objectName(), label.text()))


def ready_to_send(view):
    """A condition: the files of the drawing are made, and the program has answered."""
    return Until(
        lambda: view.result is not None and view.child is None and not view._timer.isActive(), "files that can be sent"
    )


def processes():
    """The processes that FreeCAD started and that still run: isomark."""
    found = subprocess.run(["ps", "-o", "args=", "--ppid", str(os.getpid())], capture_output=True, text=True)
    return [line for line in found.stdout.splitlines() if "isomark" in line and "watch" not in line]


def can_with_label():
    document = FreeCAD.newDocument("Mug")
    body = document.addObject("PartDesign::Body", "Can")
    cylinder = document.addObject("PartDesign::AdditiveCylinder", "Cylinder")
    body.addObject(cylinder)
    cylinder.Radius, cylinder.Height = 36.5, 110.0
    label = document.addObject("Sketcher::SketchObject", "Label")
    label.addGeometry(Part.Circle(Vector(0, 0, 0), Vector(0, 0, 1), 15))
    corners = [Vector(-20, -16, 0), Vector(20, -16, 0), Vector(20, 16, 0), Vector(-20, 16, 0)]
    for number in range(4):
        label.addGeometry(Part.LineSegment(corners[number], corners[(number + 1) % 4]))
    label.Placement = FreeCAD.Placement(Vector(0, -38, 55), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    document.recompute()
    # The middle of the field is the part's own origin.
    body.Placement = FreeCAD.Placement(Vector(0, 0, -55), FreeCAD.Rotation())
    label.Placement = FreeCAD.Placement(Vector(0, -38, 0), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    document.recompute()
    view = FreeCADGui.activeDocument().activeView()
    view.viewFront()
    FreeCADGui.SendMsgToActiveView("ViewFit")
    return document


def write_line(path, length):
    """An SVG drawing of one line, replaced at once as editors do."""
    with open(path + "~", "w", encoding="utf-8") as file:
        file.write(
            '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
            '<path fill="none" stroke="#000" stroke-width="0.01" d="M1 5H%g"/></svg>' % (1 + length)
        )
    os.replace(path + "~", path)


def scenes(document):
    """The scenes of the 3-D views of a document."""
    views = FreeCADGui.getDocument(document).mdiViewsOfType("Gui::View3DInventor")
    return [view.getSceneGraph() for view in views]


def view_window(title):
    """The window of a view, by the start of its title."""
    windows = FreeCADGui.getMainWindow().findChild(QtGui.QMdiArea).subWindowList()
    return next(found for found in windows if found.windowTitle().startswith(title))


def old_isomark():
    path = os.path.join(folder, "old-isomark")
    with open(path, "w", encoding="utf-8") as file:
        file.write('#!/bin/sh\n[ "$1" = --version ] && { echo isomark 0.0.1; exit; }\n')
        file.write("echo \"error: unexpected argument '--on-part' found\" >&2; exit 2\n")
    os.chmod(path, 0o755)
    return path


def long_line():
    path = os.path.join(folder, "long-line")
    with open(path, "w", encoding="utf-8") as file:
        file.write("#!/bin/sh\nprintf %0500d 0 | tr 0 x >&2; exit 1\n")
    os.chmod(path, 0o755)
    return path


def scenario():
    global station_process
    window = FreeCADGui.getMainWindow()
    window.showMaximized()
    FreeCADGui.activateWorkbench("IsomarkWorkbench")
    program = os.environ["ISOMARK"]
    document = can_with_label()
    yield settled(lambda: toolbar_button("Isomark_Mark"))

    say("step: the command without a selection")
    yield from click(toolbar_button("Isomark_Mark"))
    yield Until(lambda: panel() is not None, "the panel")
    view = panel()
    yield settled(view.select_button)
    yield shows(view.message, "Nothing is selected", "Use selection")

    say("step: a face and a sketch, clicked in the 3-D view")
    yield click_in_view((22, -36.5, 30))
    yield Until(lambda: FreeCADGui.Selection.getSelectionEx("", 0), "a selected face")
    yield click_in_view((-20, -38, 8), ctrl=True)
    yield Until(lambda: len(FreeCADGui.Selection.getSelectionEx("", 0)) == 2, "a selected face and sketch")
    yield from click(view.select_button)
    yield shows(view.table, "Length error")
    assert "Can" in view.part_label.text() and "Face" in view.part_label.text(), view.part_label.text()
    assert view.drawing_label.text() == "Label"
    report, found = view.result
    assert report["quality"]["before"]["length_error_mm"] > 1.0 > 0.1 > report["quality"]["after"]["length_error_mm"]
    assert found.strips["mark"]
    assert "another side" not in view.message.text()
    picture("result")

    say("step: the sketch changes, and the numbers follow")
    before = view.table.text()
    sketch = document.getObject("Label")
    sketch.addGeometry(Part.LineSegment(Vector(-18, 0, 0), Vector(18, 0, 0)))
    document.recompute()
    yield Until(lambda: view.table.text() not in ("", before), "other numbers")

    say("step: the part changes, and the numbers follow")
    for radius in (34.0, 36.5):
        before = view.table.text()
        document.getObject("Cylinder").Radius = radius
        document.recompute()
        yield Until(lambda: view.table.text() not in ("", before), "other numbers")

    say("step: a document that is not saved has no product name")
    view.station.setText(os.path.join(folder, "station", "station.toml"))
    yield from click(view.send_button)
    yield shows(view.answer, "not saved", "Save the document")

    say("step: saved, but the station does not exist")
    document.saveAs(os.path.join(folder, "mug.FCStd"))
    assert view.product.text() == "mug-Can"
    view.product.setText("")
    view.use_selection()
    assert view.product.text() == "mug-Can" and view.part_label.text().startswith("Can")
    yield shows(view.message, "cannot be read", "Choose the station.toml")

    say("step: the drive of a hot folder is not connected")
    view.station.setText(os.path.join(folder, "gone", "hot"))
    view.changed()
    yield ready_to_send(view)
    view.sending.send()
    yield shows(view.answer, "not available", "Connect the drive")

    say("step: a hot folder that may not be written")
    view.station.setText("/sys/kernel")
    view.changed()
    yield shows(view.table, "Length error")
    yield from click(view.send_button)
    yield shows(view.answer, "may not write", "another station")

    say("step: a station that runs delivers")
    station = os.path.join(folder, "station")
    subprocess.run([program, "init", station], check=True, capture_output=True)
    station_process = subprocess.Popen(
        [program, "watch", os.path.join(station, "station.toml")], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    view.station.setText(os.path.join(station, "station.toml"))
    view._station_changed()
    yield shows(view.table, "Length error")
    yield from click(view.send_button)
    yield shows(view.answer, "Delivered", "mug-Can@Label.dxf")
    yield settled(view.test_button)
    assert os.path.isfile(os.path.join(station, "import", "mug-Can@Label.dxf"))
    picture("delivered")

    say("step: a drawing that makes another one of its product outdated asks first")
    place = sketch.Placement
    sketch.Placement = FreeCAD.Placement(place.Base - Vector(0, 0, 3), place.Rotation)
    view.drawing_name.setText("Lower")
    document.recompute()
    view.changed()
    yield ready_to_send(view)
    yield from click(view.send_button)
    yield shows(view.answer, "Not sent yet", "mug-Can@Label.dxf", "click again")
    assert not os.path.exists(os.path.join(station, "import", "mug-Can@Lower.dxf"))
    yield from click(view.send_button)
    yield shows(view.answer, "Delivered", "mug-Can@Lower.dxf")
    os.remove(os.path.join(station, "reports", "mug-can", "mug-Can@Lower.dxf.report.json"))
    sketch.Placement = place
    view.drawing_name.setText("Label")
    document.recompute()
    yield ready_to_send(view)

    say("step: settings of the product that name another side are pointed out")
    settings = os.path.join(station, "skus", "mug-Can.toml")
    with open(settings, "w", encoding="utf-8") as file:
        file.write('[part]\nfacing = "+x"\n')
    view.changed()
    yield shows(view.message, "another side", "facing")
    os.remove(settings)
    view.changed()
    yield Until(lambda: view.table.isVisible() and "another side" not in view.message.text(), "the side of the drawing")

    say("step: a rotation in the settings of the product is pointed out")
    with open(settings, "w", encoding="utf-8") as file:
        file.write("[placement]\nrotate_deg = 90\n")
    view.changed()
    yield shows(view.message, "rotate the drawing by 90°", "Rotate")
    os.remove(settings)
    view.changed()
    yield Until(lambda: view.result is not None and "rotate" not in view.message.text(), "the direction of the drawing")

    say("step: a rejected drawing shows its reason")
    sketch.addGeometry(Part.LineSegment(Vector(20, 0, 0), Vector(80, 0, 0)))
    document.recompute()
    yield shows(view.message, "⚠")
    yield Until(lambda: view.made is not None and view.child is None, "files")
    yield from click(view.send_button)
    yield shows(view.answer, "Rejected")
    yield settled(view.test_button)
    picture("rejected")
    sketch.delGeometry(sketch.GeometryCount - 1)
    document.recompute()
    yield shows(view.table, "Length error")

    say("step: a wrong path and an old isomark")
    view.program.setText(os.path.join(folder, "nothing"))
    yield from click(view.test_button)
    yield shows(view.version, "There is no program", "Correct the path")
    view.program.setText(old_isomark())
    yield from click(view.test_button)
    yield shows(view.version, "isomark 0.0.1")
    yield shows(view.message, "too old", "newer")
    view.program.setText(program)
    yield from click(view.test_button)
    yield shows(view.version, "isomark ", program)
    yield shows(view.table, "Length error")

    say("step: isomark is installed while the panel shows that it is missing")
    del os.environ["ISOMARK"]
    searched, os.environ["PATH"] = os.environ["PATH"], folder
    view.program.setText("")
    view.test()
    yield shows(view.message, "isomark was not found", "click Test")
    os.environ["ISOMARK"] = program
    os.environ["PATH"] = searched
    view.test()
    yield shows(view.table, "Length error")
    view.program.setText(program)

    say("step: a drawing that was removed and comes back")
    document.openTransaction("Remove")
    document.removeObject("Label")
    document.commitTransaction()
    yield shows(view.message, "was removed")
    document.undo()
    yield ready_to_send(view)
    assert view.drawing_label.text() == "Label"
    sketch = document.getObject("Label")

    say("step: a selection in another document")
    other = FreeCAD.newDocument("Elsewhere")
    other.addObject("Part::Box", "Box")
    other.recompute()
    FreeCADGui.Selection.addSelection("Elsewhere", "Box", "Face6", 5, 5, 10)
    view.use_selection()
    yield shows(view.message, "Box is in another document", "Make a link")
    # Also beside a part of this document; what is chosen stays.
    view.changed()
    yield ready_to_send(view)
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face2", 0, 0, 55)
    FreeCADGui.Selection.addSelection("Elsewhere", "Box", "Face6", 5, 5, 10)
    view.use_selection()
    yield shows(view.message, "Box is in another document", "Make a link")
    assert "Face1" in view.part_label.text()
    assert view.result is not None and view.part_label.text().startswith("Can")
    FreeCAD.closeDocument("Elsewhere")
    FreeCAD.setActiveDocument("Mug")

    say("step: a line without a plane is pointed out")
    line = document.addObject("Part::Feature", "Line")
    line.Shape = Part.makeLine(Vector(-8, -38, 0), Vector(8, -38, 0))
    document.recompute()
    FreeCADGui.Selection.addSelection("Mug", "Line")
    view.use_selection()
    yield shows(view.message, "Line has no plane with an x of its own", "sketch")
    document.removeObject("Line")

    say("step: the file of a drawing changes")
    file_of_drawing = os.path.join(folder, "stamp.svg")
    lone = os.path.join(folder, "lone", "hot")
    os.makedirs(lone)
    write_line(file_of_drawing, 8)
    FreeCADGui.Selection.clearSelection()
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face1", 10, -35, 0)
    view.use_selection()
    view.set_file(file_of_drawing)
    view.station.setText(lone)
    yield shows(view.table, "Lines", "8.0 mm")
    yield ready_to_send(view)
    write_line(file_of_drawing, 18)
    yield shows(view.table, "Lines", "18.0 mm")
    yield ready_to_send(view)
    # Sent before the panel noticed it.
    write_line(file_of_drawing, 12)
    view.sending.send()
    yield shows(view.answer, "Not sent", "the file of the drawing was changed")
    assert os.listdir(lone) == []
    yield shows(view.table, "Lines", "12.0 mm")
    yield ready_to_send(view)
    view.sending.send()
    yield shows(view.answer, "Sent", "stamp.svg")
    with open(os.path.join(lone, "mug-Can@stamp.svg"), encoding="utf-8") as file:
        assert 'H13"' in file.read()
    for name in os.listdir(lone):
        os.remove(os.path.join(lone, name))
    view.station.setText(os.path.join(station, "station.toml"))
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("Mug", "Label")
    view.use_selection()
    yield ready_to_send(view)

    say("step: names that were entered stay for the same part and drawing, and not for others")
    view.product.setText("mine")
    view.drawing_name.setText("my label")
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("Mug", "Label")
    view.use_selection()
    assert (view.product.text(), view.drawing_name.text()) == ("mine", "my label")
    other = document.addObject("Part::Box", "Other")
    document.recompute()
    FreeCADGui.Selection.addSelection("Mug", "Other", "Face1", 0, 5, 5)
    view.use_selection()
    assert (view.product.text(), view.drawing_name.text()) == ("mug-Other", "my label")
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("Mug", "Label")
    view.use_selection()
    assert view.product.text() == "mug-Can"
    view.drawing_name.setText("Label")
    document.removeObject("Other")
    document.recompute()
    view.changed()
    yield ready_to_send(view)

    say("step: a decimal comma and a decimal point are the same")
    for text in ("12,5", "12.5"):
        view.rotate.setValue(0.0)
        view.rotate.lineEdit().selectAll()
        view.rotate.lineEdit().insert(text)
        view.rotate.interpretText()
        assert view.rotate.value() == 12.5, (text, view.rotate.value())
    view.rotate.setValue(0.0)
    yield ready_to_send(view)

    say("step: a mark that is outdated is not kept")
    view.rotate.setValue(1.0)
    view.keep()
    assert document.getObject("Mark") is None
    yield shows(view.message, "no mark to keep")
    view.rotate.setValue(0.0)
    yield shows(view.table, "Length error")

    say("step: a program that fails with a long line does not widen the panel")
    width = view.form.minimumSizeHint().width()
    view.program.setText(long_line())
    view.test()
    yield shows(view.message, "failed", "xxxxx")
    assert view.form.minimumSizeHint().width() < max(300, 1.2 * width), view.form.minimumSizeHint().width()
    view.program.setText(program)
    view.test()
    yield shows(view.table, "Length error")

    say("step: a hot folder without the folders of a station")
    view.station.setText(lone)
    view.changed()
    yield ready_to_send(view)
    yield from click(view.send_button)
    yield shows(view.answer, "Sent", "mug-Can@Label.dxf", "cannot be shown", "station.toml")
    view.station.setText(os.path.join(station, "station.toml"))
    view.changed()
    yield ready_to_send(view)

    say("step: the mark is kept, undone and done again")
    yield from click(view.keep_button)
    yield Until(lambda: document.getObject("Mark") is not None, "the kept mark")
    marks = document.getObject("Mark").Group
    assert [item.TypeId for item in marks][0] == "Part::Feature"
    document.undo()
    assert document.getObject("Mark") is None and document.getObject("MarkLines") is None
    document.redo()
    assert document.getObject("Mark") is not None
    FreeCADGui.activeDocument().activeView().viewIsometric()
    yield settled(view.test_button)
    picture("kept")
    if PANEL_PICTURE:
        yield from readme_picture(document, view, window)

    say("step: the panel closes, and nothing is left")
    temporary = view.folder.path
    view.changed()
    yield Until(lambda: view.child is not None, "a running program")
    close = [
        button
        for button in window.findChildren(QtGui.QPushButton)
        if button.text().replace("&", "") == "Close" and button.isVisible()
    ]
    yield from click(close[0])
    yield Until(lambda: panel() is None, "the closed panel")
    assert not os.path.exists(temporary)
    assert processes() == [], processes()

    say("step: a selection that FreeCAD cannot read does not keep the panel from opening")
    from freecad.Isomark import choice

    def unreadable(*_):
        raise ValueError("no such shape")

    readable, choice.of_selection = choice.of_selection, unreadable
    FreeCADGui.runCommand("Isomark_Mark")
    view, choice.of_selection = panel(), readable
    yield shows(view.message, "no such shape", "Check geometry")
    temporary = view.folder.path
    view.reject()
    assert panel() is None and not os.path.exists(temporary)

    say("step: the stations and files of a correction are read in another thread")
    from freecad.Isomark import station as stations

    opened, threads = stations.open_station, []

    def recorded(path):
        threads.append(threading.current_thread())
        return opened(path)

    stations.open_station = recorded
    FreeCADGui.Selection.addSelection("Mug", "Can", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("Mug", "Label")
    FreeCADGui.runCommand("Isomark_Mark")
    view = panel()
    yield ready_to_send(view)
    view.set_file(os.path.join(folder, "none.svg"))
    yield shows(view.message, "none.svg does not exist", "Choose the drawing again")
    write_line(os.path.join(folder, "none.svg"), 7)
    yield shows(view.table, "Lines", "7.0 mm")
    assert threads and threading.main_thread() not in threads
    stations.open_station = opened
    view.reject()

    say("step: a document is closed while its panel is open")
    document.save()
    FreeCADGui.runCommand("Isomark_Mark")
    view = panel()
    temporary = view.folder.path
    FreeCAD.closeDocument("Mug")
    yield Until(lambda: panel() is None and not FreeCADGui.Control.activeDialog(), "the closed dialog")
    assert not os.path.exists(temporary)

    say("step: the saved document opens again")
    document = FreeCAD.openDocument(os.path.join(folder, "mug.FCStd"))
    assert document.getObject("MarkLines").Shape.Length > 100.0
    assert document.getObject("Mark").Product == "mug-Can"

    say("step: a linked document changes, beside a spreadsheet, with another 3-D view than before")
    assembly = FreeCAD.newDocument("Assembly")
    assembly.saveAs(os.path.join(folder, "assembly.FCStd"))
    for name, linked in (("Link", "Can"), ("LinkedLabel", "Label")):
        link = assembly.addObject("App::Link", name)
        link.LinkedObject, link.LinkTransform = document.getObject(linked), True
    sheet = assembly.addObject("Spreadsheet::Sheet", "Sheet")
    assembly.recompute()
    FreeCADGui.setActiveDocument("Assembly")
    sheet.ViewObject.doubleClicked()
    FreeCADGui.Selection.clearSelection()
    FreeCADGui.Selection.addSelection("Assembly", "Link", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("Assembly", "LinkedLabel")
    FreeCADGui.runCommand("Isomark_Mark")
    view = panel()
    yield ready_to_send(view)
    marks = lambda: [scene.findChild(view.overlay._root) >= 0 for scene in scenes("Assembly")]
    assert marks() == [True], marks()
    before = view.table.text()
    document.getObject("Cylinder").Radius = 34.0
    document.recompute()
    yield Until(lambda: view.table.text() not in ("", before), "the numbers of the changed part")
    document.getObject("Cylinder").Radius = 36.5
    document.recompute()
    yield Until(lambda: view.table.text() == before, "the numbers of before")
    window.findChild(QtGui.QMdiArea).setActiveSubWindow(view_window("assembly : 1"))
    FreeCADGui.runCommand("Std_ViewCreate")
    yield Until(lambda: marks() == [True, True], "the mark in both views")
    view_window("assembly : 1").close()
    yield Until(lambda: marks() == [True], "the mark in the view that is left")
    view.reject()
    FreeCAD.closeDocument("Assembly")
    FreeCAD.setActiveDocument("mug")
    FreeCADGui.setActiveDocument("mug")
    # Otherwise FreeCAD asks at the end whether to save the changed document.
    FreeCADGui.runCommand("Std_Save")
    assert not FreeCADGui.getDocument("mug").Modified

    say("step: the window is closed while the program runs")
    slow = os.path.join(folder, "slow-isomark")
    with open(slow, "w", encoding="utf-8") as file:
        file.write("#!/bin/sh\nexec sleep 600\n")
    os.chmod(slow, 0o755)
    FreeCADGui.Selection.addSelection("mug", "Can", "Cylinder.Face1", 10, -35, 0)
    FreeCADGui.Selection.addSelection("mug", "Label")
    FreeCADGui.runCommand("Isomark_Mark")
    view = panel()
    view.program.setText(slow)
    yield Until(lambda: view.child is not None and view.child._process.processId(), "a running program")
    with open(os.path.join(os.environ["ISOMARK_FILES"], "child"), "w", encoding="utf-8") as file:
        file.write("%d\n%s\n" % (view.child._process.processId(), view.folder.path))


def readme_picture(document, view, window):
    """Writes the picture of README: the panel and the mark, beside where the drawing would be without correction."""
    kept = document.getObject("MarkLines").ViewObject
    kept.Visibility = False
    # Paths of this machine.
    view.program.setText("")
    view.version.hide()
    dock = view.form
    while dock is not None and not isinstance(dock, QtGui.QDockWidget):
        dock = dock.parent()
    window.resizeDocks([dock], [300], QtCore.Qt.Horizontal)
    camera = FreeCADGui.activeDocument().activeView()
    camera.setCameraOrientation((FreeCAD.Rotation(Vector(0, 0, 1), 28) * FreeCAD.Rotation(Vector(1, 0, 0), 72)).Q)
    FreeCADGui.SendMsgToActiveView("ViewFit")
    view.show_drawn.setChecked(True)
    yield from click(view.send_button)
    yield shows(view.answer, "Delivered")
    yield settled(view.test_button)
    grabbed = QtGui.QApplication.primaryScreen().grabWindow(0).toImage()
    # The panel and the middle of the 3-D view.
    ratio = window.devicePixelRatioF()
    top = dock.mapToGlobal(QtCore.QPoint(0, 0)) * ratio
    grabbed = grabbed.copy(
        top.x(), top.y(), round(0.8 * grabbed.width()), grabbed.height() - top.y() - round(70 * ratio)
    )
    grabbed.convertToFormat(QtGui.QImage.Format_RGB888).save(PANEL_PICTURE, "PNG", 0)
    kept.Visibility = True


class Driver:
    """Runs the scenario step by step in the window's own event loop."""

    def __init__(self):
        self.steps = scenario()
        self.condition = None
        self.waited = 0
        self.timer = QtCore.QTimer()
        self.timer.timeout.connect(self.advance)
        self.timer.start(50)

    def advance(self):
        try:
            if self.condition is not None and not self.condition.ready():
                self.waited += 50
                if self.waited > PATIENCE:
                    raise AssertionError("not in time: " + self.condition.what)
                return
            self.waited = 0
            self.condition = next(self.steps)
        except StopIteration:
            end(0)
        except BaseException:
            picture("failed")
            say("FAILED", traceback.format_exc())
            end(1)


def end(code):
    if station_process is not None:
        station_process.terminate()
        station_process.wait(30)
    shutil.rmtree(folder, ignore_errors=True)
    say("ok the window" if code == 0 else "the window failed")
    driver.timer.stop()
    if code == 0:
        FreeCADGui.getMainWindow().close()
    else:
        os._exit(code)


def start():
    global driver
    driver = Driver()


driver = None
QtCore.QTimer.singleShot(1500, start)
