# SPDX-License-Identifier: MIT OR Apache-2.0
"""The task panel: what is marked where, how accurate it is, and the station's answer."""

import html
import os

import FreeCAD
import FreeCADGui
from PySide import QtCore, QtGui

from . import choice, follow, job, mark, part, program, settings, station
from .child import Background, Child, Newest
from .overlay import Overlay
from .wording import Trouble, dividable, translate

#: Pause after the last change before the drawing is corrected again, ms.
SETTLE_MS = 300
#: Pause between two looks at the station's folders, and between two questions for its status, s.
LOOK_S, STATUS_S = 1.0, 5.0
#: Pause between two looks at the file of the drawing and at the 3-D views, ms.
LOOK_AROUND_MS = 1000

_open = None


def open_panel():
    """Opens the panel for the active document."""
    global _open
    _open = Panel(FreeCAD.ActiveDocument)
    FreeCADGui.Control.showDialog(_open)
    return _open


def opened():
    """The panel that is open, or `None`."""
    return _open


class Panel:
    """The task panel of one document."""

    def __init__(self, document):
        self.document = document.Name
        #: The documents that the part and the drawing come from.
        self.documents = {document.Name}
        self.choice = choice.Choice()
        self.folder = job.Folder()
        self.overlay = Overlay(document.Name)
        self.child = None
        self.tester = None
        self.steps = None
        self.tessellated = None
        self.tessellated_key = None
        self.made = None
        self.frame = None
        self.result = None
        #: The station's settings that the result was made with; empty without.
        self.station_file = ""
        #: The part and the drawing that the names of product and drawing were made for.
        self._named = ("", "")
        self.sending = Sending(self)
        self.form = QtGui.QWidget()
        self.form.setObjectName("IsomarkPanel")
        self.form.setWindowTitle(translate("Isomark", "Mark on part"))
        self.form.setWindowIcon(
            QtGui.QIcon(os.path.join(os.path.dirname(__file__), "resources", "icons", "Isomark.svg"))
        )
        self._timer = QtCore.QTimer()
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.correct)
        self._stepper = QtCore.QTimer()
        self._stepper.timeout.connect(self._step)
        self._file = follow.File(self.changed)
        self._reader = Newest()
        self._looker = QtCore.QTimer()
        self._looker.timeout.connect(self._look_around)
        self._looker.start(LOOK_AROUND_MS)
        self._build()
        for edit in (self.product, self.drawing_name):
            edit.setMinimumWidth(40)
        self._observer = follow.Documents(self)
        FreeCAD.addDocumentObserver(self._observer)
        QtCore.QCoreApplication.instance().aboutToQuit.connect(self.close)
        try:
            self.use_selection()
        except BaseException:
            # Without a panel, nobody would end what was started.
            self.close()
            raise

    # The widgets.

    def _build(self):
        layout = QtGui.QVBoxLayout(self.form)
        layout.setContentsMargins(0, 0, 0, 0)

        what = self._group(layout, translate("Isomark", "What is marked"))
        self.part_label, self.drawing_label = self._row_label(), self._row_label()
        what.addRow(translate("Isomark", "Part"), self.part_label)
        what.addRow(translate("Isomark", "Drawing"), self.drawing_label)
        row = QtGui.QHBoxLayout()
        self.select_button = self._button(row, translate("Isomark", "Use selection"), self.use_selection)
        self.file_button = self._button(row, translate("Isomark", "File…"), self.choose_file)
        self.file_button.setToolTip(
            translate("Isomark", "A DXF file or a picture as the drawing, at the clicked point")
        )
        what.addRow(row)
        self.rotate = _Number()
        self.rotate.setRange(-360.0, 360.0)
        self.rotate.setSuffix("°")
        self.rotate.valueChanged.connect(self.changed)
        what.addRow(translate("Isomark", "Rotate"), self.rotate)
        self.width = _Number()
        self.width.setRange(0.0, 10000.0)
        self.width.setSuffix(" mm")
        self.width.setSpecialValueText(translate("Isomark", "as in the file"))
        self.width.valueChanged.connect(self.changed)
        self.width_label = QtGui.QLabel(translate("Isomark", "Width of picture"))
        what.addRow(self.width_label, self.width)
        self.other_side = self._check(what, translate("Isomark", "Laser on the other side"), False)
        self.other_side.toggled.connect(self.changed)
        self.bound = self._check(what, translate("Isomark", "Only on the selected faces"), False)
        self.bound.toggled.connect(self.changed)

        result = self._group(layout, translate("Isomark", "Result"))
        self.result_box = result.parentWidget()
        self.table = _Message()
        self.table.hide()
        self.table.setTextInteractionFlags(QtCore.Qt.TextSelectableByMouse)
        result.addRow(self.table)
        self.message = self._message()
        result.addRow(self.message)
        self.show_drawn = self._check(result, translate("Isomark", "Show without correction"), False)
        self.show_view = self._check(result, translate("Isomark", "Show the laser's view"), False)
        for box, name in ((self.show_drawn, "drawn"), (self.show_view, "view")):
            box.toggled.connect(lambda on, name=name: self.overlay.set_visible(name, on))
            self.overlay.set_visible(name, False)
        self.overlay.set_visible("mark", True)
        self.overlay.set_visible("mark-ink", True)
        row = QtGui.QHBoxLayout()
        self.keep_button = self._button(row, translate("Isomark", "Keep in document"), self.keep)
        result.addRow(row)

        send = self._group(layout, translate("Isomark", "Station"))
        self.station, row = self._path(settings.station(), self.choose_station)
        self.station.setPlaceholderText(translate("Isomark", "station.toml, or a hot folder"))
        self.station.editingFinished.connect(self._station_changed)
        send.addRow(translate("Isomark", "Station"), row)
        self.product, self.drawing_name = QtGui.QLineEdit(), QtGui.QLineEdit()
        for edit in (self.product, self.drawing_name):
            edit.editingFinished.connect(self.changed)
        send.addRow(translate("Isomark", "Product"), self.product)
        send.addRow(translate("Isomark", "Name"), self.drawing_name)
        row = QtGui.QHBoxLayout()
        self.send_button = self._button(row, translate("Isomark", "Send to hot folder"), self.sending.send)
        send.addRow(row)
        self.answer = self._message()
        send.addRow(self.answer)

        found = self._group(layout, translate("Isomark", "Program"))
        self.program, row = self._path(settings.program(), self.choose_program)
        self.program.setPlaceholderText(translate("Isomark", "search for isomark"))
        self.program.editingFinished.connect(self._program_changed)
        self.test_button = self._button(row, translate("Isomark", "Test"), self.test)
        found.addRow(row)
        self.version = self._message()
        found.addRow(self.version)
        layout.addStretch(1)
        for name in (
            "select_button file_button rotate width other_side bound table message show_drawn show_view keep_button station "
            "product drawing_name send_button answer program test_button version part_label drawing_label"
        ).split():
            getattr(self, name).setObjectName("Isomark_" + name)

    def _group(self, layout, title):
        box = QtGui.QGroupBox(title)
        form = QtGui.QFormLayout(box)
        form.setFieldGrowthPolicy(QtGui.QFormLayout.AllNonFixedFieldsGrow)
        form.setContentsMargins(4, 4, 4, 4)
        form.setVerticalSpacing(4)
        layout.addWidget(box)
        return form

    def _row_label(self):
        label = QtGui.QLabel()
        label.setWordWrap(True)
        label.setTextFormat(QtCore.Qt.PlainText)
        return label

    def _message(self):
        label = _Message()
        label.setWordWrap(True)
        label.setTextFormat(QtCore.Qt.RichText)
        label.setTextInteractionFlags(QtCore.Qt.TextSelectableByMouse)
        label.hide()
        return label

    def _button(self, row, text, slot):
        button = QtGui.QPushButton(text)
        button.setAutoDefault(False)
        button.setMinimumWidth(40)
        button.clicked.connect(lambda *_: slot())
        row.addWidget(button)
        return button

    def _check(self, form, text, on):
        box = QtGui.QCheckBox(text)
        box.setChecked(on)
        form.addRow(box)
        return box

    def _path(self, text, slot):
        row = QtGui.QHBoxLayout()
        edit = QtGui.QLineEdit(text)
        edit.setMinimumWidth(40)
        row.addWidget(edit)
        button = QtGui.QToolButton()
        button.setText("…")
        button.clicked.connect(lambda *_: slot())
        row.addWidget(button)
        return edit, row

    # What FreeCAD asks of a task panel.

    def getStandardButtons(self):
        button = QtGui.QDialogButtonBox.Close
        try:
            return int(button)
        except TypeError:  # PySide6
            return button

    def isAllowedAlterDocument(self):
        return True

    def isAllowedAlterView(self):
        return True

    def isAllowedAlterSelection(self):
        return True

    def reject(self):
        self.close()
        FreeCADGui.Control.closeDialog()
        return True

    def close(self):
        """Ends everything that the panel started, and removes what it drew."""
        global _open
        if self.folder is None:
            return
        for timer in (self._timer, self._stepper, self._looker):
            timer.stop()
        self._file.close()
        self._reader.close()
        FreeCAD.removeDocumentObserver(self._observer)
        QtCore.QCoreApplication.instance().aboutToQuit.disconnect(self.close)
        for child in (self.child, self.tester):
            if child is not None:
                child.kill()
        self.sending.close()
        self.overlay.close()
        self.folder.close()
        self.folder = None
        _open = None

    # What is marked.

    def use_selection(self):
        """Takes the part and the drawing from the selection."""
        try:
            # Of all documents: what is selected in another one is named.
            new = choice.of_selection(FreeCADGui.Selection.getSelectionEx("*", 0), self.document)
        except (Trouble, *SHAPE_ERRORS) as error:
            trouble = error if isinstance(error, Trouble) else _of_freecad(error)
            self._show_choice()
            self._say(self.message, trouble.what, trouble.remedy, True)
            return
        # A selected object is shown in another colour, which would hide the mark.
        FreeCADGui.Selection.clearSelection()
        if new.elsewhere and new.is_incomplete() and not self.choice.is_incomplete():
            trouble = choice.in_other_document(*new.elsewhere[0])
            self._say(self.message, trouble.what, trouble.remedy, True)
            return
        if new.part or new.drawing or new.unusable:
            if not new.drawing and new.part is not None:
                # A new place for the drawing that is already chosen.
                new.drawing, new.file = self.choice.drawing, self.choice.file
            elif new.drawing and new.part is None:
                new.take_part(self.choice)
            self.choice = new
            self._suggest()
        else:
            self.choice.elsewhere = new.elsewhere
            self.suggest_names()
        self._show_choice()
        self.changed()

    def choose_file(self):
        """Asks for a file as the drawing."""
        kinds = " ".join("*" + ending for ending in station.DRAWINGS)
        path, _ = QtGui.QFileDialog.getOpenFileName(
            self.form,
            translate("Isomark", "Choose a drawing"),
            "",
            translate("Isomark", "Drawings ({kinds})", kinds=kinds),
        )
        if path:
            self.set_file(path)

    def set_file(self, path):
        """Makes a file the drawing."""
        self.choice.drawing = []
        self.choice.file = path
        self._suggest()
        self._show_choice()
        self.changed()

    def _suggest(self):
        """The names and the side that follow from what is chosen."""
        try:
            self.other_side.setChecked(bool(self.choice.drawing) and self.choice.suggests_other_side())
        except (Trouble, *SHAPE_ERRORS):
            # `correct` shows it.
            pass
        self.suggest_names()

    def document_saved(self):
        """Names the product after the document."""
        before = self.names()
        self.suggest_names()
        if self.names() != before:
            # Each product has its own settings.
            self.changed()

    def suggest_names(self):
        """The names that follow from what is chosen, and from the name of the document."""
        named = self._named
        try:
            self._named = (
                self.choice.part.names() if self.choice.part else "",
                self.choice.file or "".join(ref.names() for ref in self.choice.drawing[:1]),
            )
            # What the user entered stays as long as it is for the same part or the same drawing.
            if self._named[0] != named[0] or not self.product.text().strip():
                self.product.setText(self._product_name())
            if self._named[1] != named[1] or not self.drawing_name.text().strip():
                self.drawing_name.setText(self._name_of_drawing())
        except Trouble:
            # `correct` shows it.
            pass

    def _product_name(self):
        """The name of the document and the part; empty for a document without a name."""
        document = FreeCAD.getDocument(self.document)
        if self.choice.part is None or not document.FileName:
            return ""
        stem = os.path.splitext(os.path.basename(document.FileName))[0]
        return station.plain_name("%s-%s" % (stem, self.choice.part.label))

    def _name_of_drawing(self):
        if self.choice.file:
            return station.plain_name(os.path.splitext(os.path.basename(self.choice.file))[0])
        return station.plain_name(self.choice.drawing[0].label) if self.choice.drawing else ""

    def _show_choice(self):
        nothing = translate("Isomark", "nothing selected")
        try:
            faces = ", ".join("Face%d" % (number + 1) for number in self.choice.faces)
            label = self.choice.part.label if self.choice.part else nothing
            self.part_label.setText("%s (%s)" % (label, faces) if faces else label)
            labels = ", ".join(ref.label for ref in self.choice.drawing)
        except Trouble:
            labels = ""
        self.drawing_label.setText(labels or os.path.basename(self.choice.file) or nothing)
        is_picture = self.choice.is_picture()
        for widget in (self.width, self.width_label):
            widget.setVisible(is_picture)
        self.other_side.setVisible(not self.choice.file)
        self.bound.setVisible(bool(self.choice.faces))

    def options(self):
        """The settings of the drawing."""
        return {
            "anchor": "center" if self.choice.file else "origin",
            "rotate_deg": self.rotate.value(),
            "width_mm": self.width.value() if self.choice.is_picture() else 0.0,
            "station": self.station_file,
        }

    def names(self):
        """The names of product and drawing; placeholders while they are empty."""
        return self.product.text().strip() or "part", self.drawing_name.text().strip() or "drawing"

    # The correction.

    def _look_around(self):
        """Notices what FreeCAD does not report: views that were opened, and a file that another program wrote."""
        self.overlay.attach()
        self._file.look()

    def changed(self, *_):
        """Corrects the drawing again, soon."""
        if self.folder is not None:
            self.sending.forget_answer()
            self._timer.start(SETTLE_MS)

    def correct(self):
        """Makes the files of what is chosen, a little at a time, and starts the program."""
        self._stop()
        self.result = None
        self.made = None
        self._show_choice()
        try:
            self.choice.check()
            self.documents = {self.document} | self.choice.documents()
            self.frame = self.choice.frame(self.other_side.isChecked() and not self.choice.file)
            shape = self.choice.part.shape()
            bounding = tuple(self.choice.faces) if self.bound.isChecked() else ()
            # The shape itself is kept: the hash of one that no longer exists may be that of a new one.
            key = (shape, bounding)
            self._busy(True)
            known = self.tessellated_key
            if known is not None and shape.isSame(known[0]) and bounding == known[1]:
                self._start()
                return
            self.steps = part.tessellate(shape, bounding)
            self.tessellated_key = key
            self.tessellated = None
            self._stepper.start(0)
        except Trouble as trouble:
            self._trouble(trouble)
        except SHAPE_ERRORS as error:
            self._trouble(_of_freecad(error))

    def _busy(self, busy):
        # The last result stays until the next one is there, so that the panel does not jump.
        self.result_box.setTitle(
            translate("Isomark", "Result: calculating…") if busy else translate("Isomark", "Result")
        )

    def _stop(self):
        self._busy(False)
        self._stepper.stop()
        self._reader.forget()
        self.steps = None
        if self.tessellated is None:
            self.tessellated_key = None
        if self.child is not None:
            self.child.kill()
            self.child = None

    def _step(self):
        try:
            next(self.steps)
        except StopIteration as end:
            self._stepper.stop()
            self.tessellated = end.value
            try:
                self._start()
            except Trouble as trouble:
                self._trouble(trouble)
            except SHAPE_ERRORS as error:
                self._trouble(_of_freecad(error))
        except Trouble as trouble:
            self._stop()
            self._trouble(trouble)
        except SHAPE_ERRORS as error:
            self._stop()
            self._trouble(_of_freecad(error))

    def _start(self):
        product, drawing = self.names()
        station.check_name(product, translate("Isomark", "product"))
        station.check_name(drawing, translate("Isomark", "drawing"))
        text, file = self.station.text().strip(), self.choice.file

        def done(found, error):
            try:
                if error is not None:
                    raise error
                seen, data, self.station_file, trouble = found
                self._file.begin(file, seen)
                if trouble is not None:
                    raise trouble
                self._run(product, drawing, data)
            except Trouble as trouble:
                self._trouble(trouble)
            except SHAPE_ERRORS as error:
                self._trouble(_of_freecad(error))

        self._reader.run(lambda: _read(text, file), done)

    def _run(self, product, drawing, data):
        """Starts the program; `data` is what was read from the file of the drawing."""
        self.made = job.files(self.choice, self.tessellated, self.frame, data)
        run = job.Run(self.folder, self.made, product, drawing, self.options())
        path = program.find(self.program.text())

        def done(code, output, errors):
            self.child = None
            try:
                self._show(*run.result(code, output, errors))
            except Trouble as trouble:
                self._trouble(trouble)

        def failed(words, remedy):
            self.child = None
            self._trouble(Trouble(words, remedy))

        self.child = Child(path, run.arguments, done, failed, self.folder.path)

    def _show(self, report, found):
        self._busy(False)
        self.result = (report, found)
        self.overlay.show(found)
        cells = "".join(
            "<tr><td>%s&nbsp;</td><td align='right'>%s</td></tr>" % (html.escape(name), html.escape(value))
            for name, value in job.numbers(report)
        )
        self.table.setText("<table>%s</table>" % cells)
        self.table.show()
        lines = [_line(severity == "warning", words) for severity, words in job.notices(report)]
        lines = self._placement(report) + lines
        self.message.setText("".join(lines))
        self.message.setVisible(bool(lines))

    def _placement(self, report):
        """What the user should know about the place of the mark."""
        lines = []
        words = station.frame_words(report, self.frame)
        if words:
            lines.append(_line(True, *words))
        if self.choice.assumed:
            lines.append(_line(False, *self.choice.assumed))
        turned = (report.get("placement") or {}).get("rotate_deg", 0.0)
        if turned and not self.rotate.value():
            lines.append(
                _line(
                    False,
                    translate("Isomark", "The settings of the station rotate the drawing by {angle:g}°.", angle=turned),
                    translate("Isomark", "Enter an angle under Rotate to replace it; 360 is no rotation."),
                )
            )
        return lines

    def _trouble(self, trouble):
        """Shows why there is no result."""
        self._busy(False)
        self.result = None
        self.overlay.clear()
        self.table.setText("")
        self.table.hide()
        self._say(self.message, trouble.what, trouble.remedy, True)

    def _say(self, label, what, remedy="", wrong=False):
        label.setText(_line(wrong, what, remedy))
        label.show()

    # The document.

    def keep(self):
        """Keeps the mark in the document."""
        if self.result is None or self._timer.isActive():
            self._trouble(
                Trouble(
                    translate("Isomark", "There is no mark to keep."),
                    translate("Isomark", "Wait for the result, or resolve what is shown here."),
                )
            )
            self.changed()
            return
        report, found = self.result
        product, drawing = self.names()
        refs = [self.choice.part.names()] + [ref.names() for ref in self.choice.drawing] + [self.choice.file]
        after = (report.get("quality") or {}).get("after") or {}
        facts = [
            ("Product", product),
            ("Drawing", drawing),
            ("LengthError", "%.3f mm" % after.get("length_error_mm", 0.0)),
            ("Program", str(report.get("program", ""))),
        ]
        title = translate("Isomark", "Mark {drawing} on {part}", drawing=drawing, part=self.choice.part.label)
        # The observer must not answer to what the panel itself adds.
        self._observer.quiet = True
        try:
            mark.keep(FreeCAD.getDocument(self.document), found, title, " ".join(refs).strip(), facts)
        finally:
            self._observer.quiet = False

    # The station and the program.

    def choose_station(self):
        path, _ = QtGui.QFileDialog.getOpenFileName(
            self.form,
            translate("Isomark", "Choose the settings of the station"),
            os.path.dirname(self.station.text()),
            translate("Isomark", "Station (*.toml);;All files (*)"),
        )
        if path:
            self.station.setText(path)
            self._station_changed()

    def _station_changed(self):
        if self.station.text().strip() != settings.station():
            settings.set_station(self.station.text().strip())
            self.changed()

    def choose_program(self):
        path, _ = QtGui.QFileDialog.getOpenFileName(self.form, translate("Isomark", "Choose the program isomark"))
        if path:
            self.program.setText(path)
            self._program_changed()

    def _program_changed(self):
        if self.program.text().strip() != settings.program():
            settings.set_program(self.program.text().strip())
            self.changed()

    def test(self):
        """Shows which isomark is used."""
        self._program_changed()
        if self.tester is not None:
            self.tester.kill()
            self.tester = None
        try:
            path = program.find(self.program.text())
        except Trouble as trouble:
            self._say(self.version, trouble.what, trouble.remedy, True)
            return

        def done(_code, output, _errors):
            self.tester = None
            try:
                words = translate("Isomark", "{version} ({path})", version=program.version(output), path=path)
                self._say(self.version, words)
                if self.result is None and self.child is None:
                    # It may have been installed since.
                    self.changed()
            except Trouble as trouble:
                self._say(self.version, trouble.what, trouble.remedy, True)

        def failed(words, remedy):
            self.tester = None
            self._say(self.version, words, remedy, True)

        self.tester = Child(path, ["--version"], done, failed, self.folder.path, limit_s=10.0)


class _Number(QtGui.QDoubleSpinBox):
    """A number with a decimal point or a decimal comma: the separator of the other languages is no group separator."""

    def validate(self, text, position):
        return super().validate(self._own(text), position)

    def valueFromText(self, text):
        return super().valueFromText(self._own(text))

    def _own(self, text):
        point = str(self.locale().decimalPoint())
        return text.replace(",", point).replace(".", point)


class _Message(QtGui.QLabel):
    """A text of several lines that gets the height that it needs: the layouts of task panels give less."""

    def setText(self, text):
        super().setText(text)
        self._fit()

    def resizeEvent(self, event):
        super().resizeEvent(event)
        self._fit()

    def _fit(self):
        # The height that a label asks for is never below its minimum.
        self.setMinimumHeight(0)
        self.setFixedHeight(max(0, self.heightForWidth(self.width())))


class Sending:
    """Sends part and drawing to the station, and shows its answer."""

    def __init__(self, panel):
        self.panel = panel
        self.work = None
        self.asked = None
        self.answer = None
        self.station = None
        #: The marking frame of what was sent.
        self.frame = None
        #: What is sent when the user clicks again, after a question.
        self.asked_about = None
        self.waiting = ("", "")
        self.since_status = 0.0
        self.timer = QtCore.QTimer()
        self.timer.timeout.connect(self._look)

    def close(self):
        """Forgets the station's answer."""
        self.timer.stop()
        if self.work is not None:
            self.work.forget()
            self.work = None
        if self.asked is not None:
            self.asked.kill()
            self.asked = None
        self.answer = None

    def forget_answer(self):
        """Hides an answer that belongs to an earlier state of the drawing."""
        if not self.timer.isActive() and self.work is None:
            self.panel.answer.hide()

    def send(self):
        """Puts the part, the drawing's settings and the drawing into the hot folder."""
        panel = self.panel
        self.close()
        try:
            product, drawing = panel.product.text().strip(), panel.drawing_name.text().strip()
            self._check(product)
            station.check_name(product, translate("Isomark", "product"))
            station.check_name(drawing, translate("Isomark", "drawing"))
            if panel.made is None or panel._timer.isActive() or panel.steps is not None and panel.tessellated is None:
                raise Trouble(
                    translate("Isomark", "The drawing is not ready."),
                    translate("Isomark", "Wait for the result above, or resolve what is shown there, and send again."),
                )
            if not panel.station.text().strip():
                raise Trouble(
                    translate("Isomark", "No station is chosen."),
                    translate("Isomark", "Choose the station.toml of your station, or its hot folder."),
                )
            names = station.drop_names(product, drawing, panel.made.ending)
            settings_file = station.sidecar(panel.options(), panel.frame)
            made, path, used = panel.made, panel.station.text(), panel.station_file
            data = (made.part, settings_file, made.drawing)
            self.frame = panel.frame
        except Trouble as trouble:
            self._show(trouble.what, trouble.remedy, True)
            return
        panel.send_button.setEnabled(False)
        self._show(translate("Isomark", "Sending…"))
        what = (product, drawing, str(settings_file))
        is_confirmed, self.asked_about = self.asked_about == what, None

        def work():
            to = station.open_station(path)
            if to.file != used:
                raise _Outdated(
                    translate("Isomark", "The result was calculated without the settings of this station."),
                    translate("Isomark", "Wait for the new result above, and send again."),
                )
            if not made.is_current():
                raise _Outdated(
                    translate("Isomark", "Not sent: the file of the drawing was changed."),
                    translate("Isomark", "Check the new result above, and send again."),
                )
            station.refuse_another_frame(to.hot, names, settings_file)
            others = [] if is_confirmed else station.placed_elsewhere(to, product, names[2], self.frame)
            if others:
                raise _Elsewhere(what, others)
            answer = station.Answer(to, product, names[0], names[2])
            station.send(to.hot, list(zip(names, data)))
            return answer, answer.can_be_seen()

        self.work = Background(work, self._sent)

    def _check(self, product):
        document = FreeCAD.getDocument(self.panel.document)
        if not product and not document.FileName:
            raise Trouble(
                translate("Isomark", "This document is not saved, so the product has no name."),
                translate("Isomark", "Save the document, or enter a product."),
            )

    def _sent(self, sent, error):
        self.work = None
        self.panel.send_button.setEnabled(True)
        if isinstance(error, _Elsewhere):
            self.asked_about = error.sending
        if isinstance(error, _Outdated):
            self.panel.changed()
        if error is not None:
            self._show(str(getattr(error, "what", error)), getattr(error, "remedy", ""), True)
            return
        answer, can_be_seen = sent
        self.answer, self.station = answer, answer.station
        self.waiting = ("", "")
        self.since_status = 0.0
        if not can_be_seen:
            self._show(
                translate("Isomark", "Sent: {name}. The station's answer cannot be shown here.", name=answer.drawing),
                translate(
                    "Isomark",
                    "Choose the station.toml of your station: the folders reports and rejected are not beside the hot folder.",
                ),
            )
            return
        self._show(translate("Isomark", "Sent. Waiting for the station."))
        self.timer.start(int(LOOK_S * 1000))

    def _look(self):
        # A share may answer slowly: never in the window's thread, and never two at a time.
        if self.work is None and self.answer is not None:
            self.work = Background(self.answer.look, self._seen)
        self.since_status += LOOK_S
        if self.since_status >= 2.0 * LOOK_S and self.asked is None and self.station.file:
            self.since_status = LOOK_S - STATUS_S
            self._ask(self._wait)

    def _seen(self, state, error):
        self.work = None
        if error is not None:
            self._show(str(error), "", True)
            return
        state, document = state
        if state == station.DELIVERED:
            self.timer.stop()
            after = ((document.get("quality") or {}).get("after") or {}).get("length_error_mm")
            words = translate("Isomark", "Delivered: {name}.", name=self.answer.drawing)
            if after is not None:
                words += " " + translate("Isomark", "Length error {error:.3f} mm.", error=after)
            wrong = station.frame_words(document, self.frame)
            if wrong:
                self._show(words + " " + wrong[0], wrong[1], True)
            else:
                self._show(words)
        elif state == station.REJECTED:
            self.timer.stop()
            what, remedy = program.words_of(document)
            self._show(translate("Isomark", "Rejected: {what}", what=what), remedy, True)
        elif state == station.FILED:
            self.timer.stop()
            if self.station.file:
                self._ask(lambda status: self._show(*station.filed_words(status, self.answer.drawing), wrong=True))
            else:
                self._show(*station.filed_words({}, self.answer.drawing), wrong=True)
            return
        else:
            self._show(translate("Isomark", "Waiting.") + " " + self.waiting[0], self.waiting[1])
        if state != station.WAITING and self.asked is not None:
            self.asked.kill()
            self.asked = None

    def _wait(self, status):
        """Keeps why the station waits."""
        self.waiting = station.waiting_words(status, self.answer.drops)

    def _ask(self, use):
        """Asks the station for its status, and gives it to a function."""
        if self.asked is not None:
            self.asked.kill()
            self.asked = None

        def no_status(what, remedy):
            self.waiting = (what, remedy)
            # A drawing that was filed waits for nothing.
            if not self.timer.isActive():
                self._show(what, remedy, True)

        def done(_code, output, errors):
            self.asked = None
            try:
                status = program.answer(0, output, errors)
            except Trouble as trouble:
                no_status(trouble.what, trouble.remedy)
                return
            if status.get("schema", "").startswith("isomark.status/"):
                use(status)
            else:
                no_status(status.get("what", ""), status.get("remedy", ""))

        def failed(words, remedy):
            self.asked = None
            no_status(words, remedy)

        try:
            path = program.find(self.panel.program.text())
        except Trouble as trouble:
            no_status(trouble.what, trouble.remedy)
            return
        self.asked = Child(path, ["status", self.station.file, "--json"], done, failed, limit_s=20.0)

    def _show(self, what, remedy="", wrong=False):
        self.panel._say(self.panel.answer, what, remedy, wrong)


class _Elsewhere(Trouble):
    """Other drawings of the product are placed with another frame: a question, which a second click answers."""

    def __init__(self, sending, others):
        super().__init__(
            translate(
                "Isomark",
                "Not sent yet. Of this product, {names} has another plane or origin. If you send this drawing, a later "
                "correction of {names} moves its mark.",
                names=", ".join(others[:3]) + (", …" if others[3:] else ""),
            ),
            translate("Isomark", "Enter another product for this drawing, or click again to send it all the same."),
        )
        self.sending = sending


class _Outdated(Trouble):
    """What is sent is not what the user sees."""


def _read(path, drawing):
    """What a correction reads from drives and shares that may answer slowly: not for the window's thread.

    The stamp and the bytes of the file of the drawing, the file of the station, and what is wrong, or `None`.
    """
    seen, data, file, trouble = None, None, "", None
    try:
        if drawing:
            # Before the bytes: a file that changes meanwhile is read again.
            seen = station.stamp(drawing)
            data = job.read(drawing)
        if path:
            file = station.open_station(path).file
    except Trouble as error:
        trouble = error
    return seen, data, file, trouble


#: What FreeCAD and OpenCASCADE raise for shapes that they cannot handle.
SHAPE_ERRORS = (RuntimeError, ValueError, AttributeError, ReferenceError, FreeCAD.Base.FreeCADError, ArithmeticError)


def _of_freecad(error):
    return Trouble(
        translate("Isomark", "FreeCAD cannot read the part or the drawing: {error}.", error=str(error).rstrip(".")),
        translate("Isomark", "Check both with Part > Check geometry, and repair them."),
    )


def _line(wrong, what, remedy=""):
    """A paragraph: what is the case, and what to do about it."""
    sign = "⚠ " if wrong else ""
    remedy = "<br/><i>%s</i>" % html.escape(dividable(remedy)) if remedy else ""
    return "<p>%s%s%s</p>" % (sign, html.escape(dividable(what)), remedy)
