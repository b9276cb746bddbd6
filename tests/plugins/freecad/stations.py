"""A running station receives what the workbench sends, and the workbench finds its answer.

Run by freecadcmd, with `ISOMARK` naming the program.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from xml.etree import ElementTree

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

harness.use_plugin()

import FreeCAD
import Part
from freecad.Isomark import choice, dxf, job, part, program, station
from PySide import QtCore
from surfaces import Vector, polylines

#: The longest time that anything here may take, s.
PATIENCE = 60.0

application = QtCore.QCoreApplication.instance() or QtCore.QCoreApplication([])


class Running:
    """A station in a folder of its own; `watch` runs it until the end of the `with` block."""

    def __init__(self, watched=True):
        self.watched = watched
        self.process = None

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="isomark-station-")
        code, _, errors = harness.isomark("init", self.folder)
        assert code == 0, errors
        self.file = os.path.join(self.folder, "station.toml")
        self.station = station.open_station(self.file)
        if self.watched:
            self.watch()
        return self

    def watch(self):
        self.process = subprocess.Popen(
            [program.find(""), "watch", self.file],
            env=program.environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def __exit__(self, *_):
        if self.process is not None:
            self.process.terminate()
            self.process.wait(PATIENCE)
        shutil.rmtree(self.folder, ignore_errors=True)

    def status(self):
        _, output, errors = harness.isomark("status", self.file, "--json")
        return program.answer(0, output, errors)


def until(ready, what):
    """Waits until a function returns something, and returns it."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = ready()
        if found:
            return found
        application.processEvents()
        time.sleep(0.02)
    raise AssertionError("not within %g s: %s" % (PATIENCE, what))


def made_can(height=0.0):
    """The files of a can of radius 30 mm with a line of 20 mm and a circle at a height, and the drawing's settings."""
    return framed_can(height)[:2]


def framed_can(height):
    """The same, with the marking frame."""
    document = FreeCAD.newDocument()
    item = document.addObject("Part::Feature", "Can")
    item.Shape = Part.makeCylinder(30.0, 80.0)
    sketch = document.addObject("Sketcher::SketchObject", "Label")
    sketch.addGeometry(Part.LineSegment(Vector(-10, 0, 0), Vector(10, 0, 0)))
    sketch.addGeometry(Part.Circle(Vector(0, 10, 0), Vector(0, 0, 1), 5.0))
    # The middle of the field is the part's own origin, so the sketch is at its height.
    sketch.Placement = FreeCAD.Placement(Vector(0, -30, height), FreeCAD.Rotation(Vector(1, 0, 0), 90))
    item.Placement = FreeCAD.Placement(Vector(0, 0, -40), FreeCAD.Rotation())
    document.recompute()
    chosen = choice.Choice()
    chosen.part, chosen.drawing = choice.Ref.of(item), [choice.Ref.of(sketch)]
    frame = chosen.frame()
    tessellated = part.at_once(part.tessellate(chosen.part.shape()))
    return job.files(chosen, tessellated, frame), station.sidecar({"anchor": "origin"}, frame), frame


def send(to, made, sidecar, product="can", name="label", drawing=None):
    names = station.drop_names(product, name, made.ending)
    station.refuse_another_frame(to.hot, names, sidecar)
    answer = station.Answer(to, product, names[0], names[2])
    station.send(to.hot, list(zip(names, (made.part, sidecar, drawing or made.drawing))))
    return answer


def final(answer):
    def look():
        state, document = answer.look()
        return (state, document) if state != station.WAITING else None

    return until(look, "an answer of the station")


def a_running_station_delivers_what_is_sent():
    made, sidecar = made_can()
    with Running() as running:
        state, report = final(send(running.station, made, sidecar))
        assert state == station.DELIVERED, (state, report)
        assert report["quality"]["after"]["length_error_mm"] < 0.1
        assert abs(report["quality"]["after"]["length_mm"] - 20.0 - 31.415927) < 0.01
        assert os.path.isfile(os.path.join(running.folder, "import", "can@label.dxf"))
        assert leftovers(running) == []
        # The same again is answered again.
        state, _ = final(send(running.station, made, sidecar))
        assert state in (station.DELIVERED, station.FILED)
        if state == station.FILED:
            assert "delivered the same before" in station.filed_words(running.status(), "can@label.dxf")[0]


def a_rejected_drawing_comes_back_with_its_reason():
    made, sidecar = made_can()
    with Running() as running:
        too_wide = dxf.write([dxf.Path("Label", [(-200.0, 0.0, 0.0), (200.0, 0.0, 0.0)])])
        state, reason = final(send(running.station, made, sidecar, drawing=too_wide))
        assert state == station.REJECTED
        assert reason["what"] and reason["remedy"] and reason["drop"] == "can@label.dxf"
        # A later drawing of this name is not taken for the rejected one.
        state, document = final(send(running.station, made, sidecar))
        assert state == station.DELIVERED, document


def a_rejected_part_is_the_answer_to_its_drawing():
    made, sidecar = made_can()
    with Running() as running:
        # Lines instead of triangles.
        assert b'"mode":4' in made.part
        made.part = made.part.replace(b'"mode":4', b'"mode":1')
        state, reason = final(send(running.station, made, sidecar))
        assert state == station.REJECTED and reason["drop"] == "can.glb", reason


def a_station_that_does_not_run_is_named():
    made, sidecar = made_can()
    with Running() as running:
        # It ran once, so that it has a status, and was stopped.
        until(lambda: os.path.exists(os.path.join(running.folder, "state", "status.json")), "a status")
        running.process.terminate()
        running.process.wait(PATIENCE)
        answer = send(running.station, made, sidecar)
        assert answer.look() == (station.WAITING, None)
        what, remedy = station.waiting_words(running.status(), answer.drops)
        assert "not running" in what and "isomark watch" in remedy, (what, remedy)
        running.watch()
        assert final(answer)[0] == station.DELIVERED


def a_drawing_that_waits_is_shown_with_what_it_waits_for():
    made, sidecar = made_can()
    with Running() as running:
        os.rmdir(os.path.join(running.folder, "import"))
        answer = send(running.station, made, sidecar)

        def words():
            found = station.waiting_words(running.status(), answer.drops)
            return found if "import" in found[0] and found[1] else None

        try:
            until(words, "the reason for waiting")
        finally:
            os.mkdir(os.path.join(running.folder, "import"))
        assert final(answer)[0] == station.DELIVERED


def heights(running, name):
    """The lowest and the highest y of a delivered drawing, which is the height on the can."""
    with open(os.path.join(running.folder, "import", name), "rb") as file:
        ys = [y for corners, _ in polylines(file.read()) for _, y in corners]
    return min(ys), max(ys)


def a_second_drawing_does_not_move_one_that_waits():
    """The frame belongs to the part: the part of the second drawing must not replace that of the first."""
    above, above_settings, above_frame = framed_can(15.0)
    below, below_settings, below_frame = framed_can(-15.0)
    with Running(watched=False) as running:
        first = send(running.station, above, above_settings, name="above")
        # The same frame again is no problem.
        send(running.station, above, above_settings, name="again")
        try:
            send(running.station, below, below_settings, name="below")
        except station.Trouble as trouble:
            assert "can@above" in trouble.what and "product" in trouble.remedy, trouble
        else:
            raise AssertionError("the part of a waiting drawing was replaced")
        assert not os.path.exists(os.path.join(running.station.hot, "can@below.dxf"))
        # A product of its own is accepted, and so is the same drawing that moved.
        second = send(running.station, below, below_settings, product="can-2", name="below")
        running.watch()
        for answer, frame in ((first, above_frame), (second, below_frame)):
            state, report = final(answer)
            assert state == station.DELIVERED and station.frame_words(report, frame) is None, report
        low, high = heights(running, "can@above.dxf")
        assert abs(low - 15.0) < 0.05 and abs(high - 30.0) < 0.05, (low, high)
        # Delivered, it still would be moved by a later correction.
        for name, product, frame, others in (
            ("below.dxf", "can", below_frame, ["can@above.dxf", "can@again.dxf"]),
            ("below.dxf", "can", above_frame, []),
            ("below.dxf", "can-3", below_frame, []),
        ):
            found = lambda: sorted(station.placed_elsewhere(running.station, product, name, frame)) == others
            until(found, "%s in another place than %s of %s" % (others, name, product))
        low, high = heights(running, "can-2@below.dxf")
        assert abs(low + 15.0) < 0.05 and abs(high - 0.0) < 0.05, (low, high)


def a_drawing_that_was_placed_with_another_frame_is_pointed_out():
    above, above_settings, frame = framed_can(15.0)
    below = framed_can(-15.0)[0]
    with Running(watched=False) as running:
        answer = send(running.station, above, above_settings)
        # Another program sends the part with another frame before the station looks.
        station.send(running.station.hot, [("can.glb", below.part)])
        running.watch()
        state, report = final(answer)
        assert state == station.DELIVERED and heights(running, "can@label.dxf")[0] < -14.0
        what, remedy = station.frame_words(report, frame)
        assert "another place" in what and "Do not mark it" in remedy, (what, remedy)


def a_rotation_in_the_settings_is_marked_as_it_is_shown():
    """Of the station and of a product, with and without a rotation in the panel."""
    made, _, frame = framed_can(0.0)
    with Running(watched=False) as running:
        with open(running.file, encoding="utf-8") as file:
            text = file.read()
        assert "\nrotate_deg = 0 " in text
        with open(running.file, "w", encoding="utf-8") as file:
            file.write(text.replace("\nrotate_deg = 0 ", "\nrotate_deg = 90 "))
        with open(os.path.join(running.folder, "skus", "own.toml"), "w", encoding="utf-8") as file:
            file.write("[placement]\nrotate_deg = 45\n")
        running.watch()
        for product, rotate, expected in (("can", 0.0, 90.0), ("own", 0.0, 45.0), ("can", 30.0, 30.0), ("own", 360.0, 360.0)):
            options = {"anchor": "origin", "rotate_deg": rotate, "station": running.file}
            folder = job.Folder()
            try:
                run = job.Run(folder, made, product, "label", options)
                shown, _ = run.result(*harness.isomark(*run.arguments))
            finally:
                folder.close()
            name = "label%g" % rotate
            state, report = final(send(running.station, made, station.sidecar(options, frame), product, name))
            assert state == station.DELIVERED, report
            for found in (shown, report):
                assert abs(found["placement"]["rotate_deg"] - expected) < 1e-9, (product, rotate, found["placement"])
    # A hot folder alone has settings that are not known here: nothing is left to them.
    assert b"rotate_deg = 0" in station.sidecar({"anchor": "origin", "station": ""}, frame)


def settings_that_replace_the_frame_are_pointed_out():
    made, sidecar, frame = framed_can(15.0)
    with Running(watched=False) as running:
        with open(os.path.join(running.folder, "skus", "can.toml"), "w", encoding="utf-8") as file:
            file.write('[part]\nfacing = "-y"\n')
        running.watch()
        state, report = final(send(running.station, made, sidecar))
        # The same side, but not the height of the drawing.
        assert state == station.DELIVERED and heights(running, "can@label.dxf")[0] < 1.0
        what, remedy = station.frame_words(report, frame)
        assert "another place" in what and "facing" in remedy, (what, remedy)


def a_hot_folder_that_may_not_be_written_has_a_remedy():
    made, sidecar = made_can()
    with Running(watched=False) as running:
        os.chmod(running.folder, 0o755)
        os.chmod(running.station.hot, 0o555)
        user = os.geteuid()
        if user == 0:
            # Nothing is forbidden to root.
            os.seteuid(65534)
        try:
            send(running.station, made, sidecar)
        except station.Trouble as trouble:
            assert "may not write" in trouble.what and trouble.remedy, trouble
        else:
            raise AssertionError("a folder that may not be written was written")
        finally:
            os.seteuid(user)
            os.chmod(running.station.hot, 0o755)
        assert os.listdir(running.station.hot) == []


def a_missing_hot_folder_has_a_remedy():
    made, sidecar = made_can()
    with Running(watched=False) as running:
        os.rmdir(running.station.hot)
        try:
            send(running.station, made, sidecar)
        except station.Trouble as trouble:
            assert "not available" in trouble.what and trouble.remedy, trouble
            return
        raise AssertionError("a missing folder was written")


def killed_while_sending_nothing_half_is_left():
    """Sends a large part again and again from a FreeCAD that is killed at different moments."""
    with Running(watched=False) as running, tempfile.TemporaryDirectory() as folder:
        script = os.path.join(folder, "sender.py")
        with open(script, "w", encoding="utf-8") as file:
            file.write(
                "import sys; sys.path.insert(0, %r); import harness; harness.use_plugin()\n"
                "from freecad.Isomark import station\n"
                "data = bytes(range(256)) * 40000\n"
                "while True: station.send(%r, [('can.glb', data), ('can@a.toml', data), ('can@a.dxf', data)])\n"
                % (os.path.dirname(os.path.abspath(__file__)), running.station.hot)
            )
        whole = 256 * 40000
        seen = set()
        for moment in range(8):
            sender = subprocess.Popen(
                [shutil.which("freecadcmd") or shutil.which("FreeCADCmd"), script],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            # Killed after so many changes of the names in the folder. Sizes change while one file is written, and would end
            # every sending in its first file.
            states = set()
            end = time.monotonic() + PATIENCE
            while len(states) < 2 * moment + 2 and time.monotonic() < end:
                states.add(tuple(name for name, _ in listing(running)))
            sender.send_signal(signal.SIGKILL)
            sender.wait()
            for name, size in listing(running):
                if not name.startswith("."):
                    seen.add(name)
                    assert size == whole, "%s has %d bytes" % (name, size)
        assert seen == {"can.glb", "can@a.toml", "can@a.dxf"}, seen
        # What is left has ignored names, and is removed by a later sending when it is old.
        assert leftovers(running), "no kill interrupted a sending"
        for name in leftovers(running):
            os.utime(os.path.join(running.station.hot, name), (0, 0))
        station.send(running.station.hot, [("can.glb", b"x")])
        assert leftovers(running) == []


def listing(running):
    """The names and sizes of the files in the hot folder."""
    found = []
    for entry in os.scandir(running.station.hot):
        try:
            found.append((entry.name, entry.stat().st_size))
        except FileNotFoundError:
            # It was renamed since.
            pass
    return tuple(sorted(found))


def leftovers(running):
    return [name for name in os.listdir(running.station.hot) if name.startswith(".")]


def the_station_file_is_understood_like_isomark_does():
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "station.toml")
        for text, hot, reports in (
            ('[station]\nname="x"\n[folders]\nhot = "in"  # comment\nimport = "import"\n', "in", "reports"),
            ("[folders]\nhot = 'a b/in'\nreports = '../r'\n[field]\nhot = 3\n", "a b/in", "../r"),
            ('folders.hot = "h\\u00e4t"\nfolders.reports = "/abs"\n', "hät", "/abs"),
        ):
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
            found = station.open_station(path)
            assert found.hot == os.path.join(folder, hot), found.hot
            assert found.reports == os.path.join(folder, reports)
            # Without a TOML parser, as in Python 3.10 and older.
            assert station._folders_of_lines(text)["hot"] == hot
        by_folder = station.open_station(os.path.join(folder))
        assert by_folder.file == path
        try:
            station.open_station(os.path.join(folder, "none.toml"))
        except station.Trouble as trouble:
            assert trouble.remedy
        else:
            raise AssertionError("a missing station file was accepted")
        # A hot folder on a drive that is not connected: the drawing can be calculated, and sending states what is missing.
        gone = station.open_station(os.path.join(folder, "gone", "hot"))
        assert (gone.file, gone.hot) == ("", os.path.join(folder, "gone", "hot"))
        try:
            station.send(gone.hot, [("can.glb", b"x")])
        except station.Trouble as trouble:
            assert "hot folder" in trouble.what and "Connect the drive" in trouble.remedy, trouble
        else:
            raise AssertionError("a missing hot folder was written")


def a_drawing_file_that_changed_is_noticed():
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "a.svg")
        made = job.Files(b"part", b"one", ".svg", path)
        assert not made.is_current()
        for data, is_current in ((b"one", True), (b"two", False), (b"one", True)):
            with open(path, "wb") as file:
                file.write(data)
            assert made.is_current() == is_current
        assert job.Files(b"part", b"one", ".dxf").is_current()


def a_file_that_is_written_while_it_is_followed_is_noticed():
    from freecad.Isomark import follow

    calls = []
    file = follow.File(lambda: calls.append(1))

    def look():
        file.look()
        until(lambda: file._work is None, "an answer")
        return len(calls)

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "a.svg")
        # It does not exist when it is chosen.
        file.begin(path, station.stamp(path))
        assert look() == 0
        with open(path, "wb") as written:
            written.write(b"one")
        assert look() == 1 and look() == 1
        seen = station.stamp(path)
        with open(path, "wb") as written:
            written.write(b"longer")
        # Written after it was read, and before the first look.
        file.begin(path, seen)
        assert look() == 2 and look() == 2
        # Read while the look was under way: what was seen is not older than what was read.
        file.look()
        file.begin(path, (0, 0, 0))
        until(lambda: file._work is None, "an answer")
        assert len(calls) == 2
        file.begin("")
        assert look() == 2
    file.close()


def a_share_that_hangs_does_not_block_and_gets_one_thread():
    from freecad.Isomark import follow
    from freecad.Isomark.child import Newest

    answers, asked, threads = threading.Event(), [], []

    def hangs(path):
        asked.append(path)
        threads.append(threading.current_thread())
        assert answers.wait(PATIENCE)
        return path

    stamp, follow.stamp = follow.stamp, hangs
    try:
        changed = []
        file = follow.File(lambda: changed.append(1))
        # As the panel does it, once a second and after each correction.
        for path in ("slow", "slow", "other", "other"):
            file.begin(path, path)
            file.look()
        until(lambda: asked, "a first look")
        reader, done = Newest(), []
        for path in ("first", "second", "third"):
            reader.run(lambda path=path: hangs(path), lambda result, error: done.append((result, error)))
        until(lambda: len(asked) == 2, "a first reading")
        assert asked == ["slow", "first"] and threading.main_thread() not in threads, asked
        answers.set()
        until(lambda: done, "a reading")
        until(lambda: file._work is None, "an answer")
        file.look()
        until(lambda: file._work is None, "an answer of the other file")
        assert done == [("third", None)] and changed == [], (done, changed)
        assert sorted(asked) == ["first", "other", "slow", "third"], asked
        # What nobody waits for any longer is not told.
        reader.run(lambda: hangs("fourth"), lambda result, error: done.append(result))
        reader.forget()
        until(lambda: reader._work is None, "the end of the reading")
        assert len(done) == 1
    finally:
        answers.set()
        follow.stamp = stamp


def a_rejection_is_told_in_the_words_of_the_panel():
    reason = {
        "code": "outside-mark",
        "what": "5.0 % of the ink is outside the faces of the part named `mark`, by up to 1.00 mm.",
        "remedy": "Set `outside_mark`.",
    }
    what, remedy = program.words_of(reason)
    assert what == "5.0 % of the ink is outside the selected faces, by up to 1.00 mm." and "Only on the selected" in remedy
    what, remedy = program.words_of({"code": "frame-into-part", "what": "The marking frame points into the part.", "remedy": "x"})
    assert "Laser on the other side" in remedy


def suggested_names_are_accepted():
    for text, expected in (
        ("Größe/Ü 1", "Größe-Ü-1"),
        ("(1) mug-Body", "_(1)-mug-Body"),
        ("..", ""),
        ("-x", "x"),
        ("~tmp", "tmp"),
        ("a@b. ", "a-b"),
        ("💥", "_💥"),
        ("日本語", "日本語"),
        ("x" * 300, "x" * 60),
        ("(" + "x" * 300, "_(" + "x" * 58),
    ):
        name = station.plain_name(text)
        assert name == expected, (text, name)
        if name:
            station.check_name(name, "product")


def programs_that_are_not_isomark_have_a_remedy():
    with tempfile.TemporaryDirectory() as folder:
        wrong = os.path.join(folder, "wrong")
        with open(wrong, "w", encoding="utf-8") as file:
            file.write("#!/bin/sh\necho hello\n")
        for path in (os.path.join(folder, "missing"), wrong):
            try:
                program.find(path)
            except program.Trouble as trouble:
                assert path in trouble.what and trouble.remedy
            else:
                raise AssertionError("%s was accepted" % path)
        os.chmod(wrong, 0o755)
        assert program.find(wrong) == wrong
        for answer in (b"hello\n", b"", b"\xff"):
            try:
                program.version(answer)
            except program.Trouble as trouble:
                assert trouble.remedy
            else:
                raise AssertionError("%r was accepted" % answer)
        old = json.dumps({"code": "usage", "what": "Unexpected argument '--on-part' found.", "remedy": "x"})
        for output, errors in ((old.encode(), b""), (b"", b"error: unexpected argument '--on-part' found")):
            try:
                program.answer(2, output, errors)
            except program.Trouble as trouble:
                assert "too old" in trouble.what and trouble.remedy
            else:
                raise AssertionError("an old isomark was accepted")


def the_program_gets_a_clean_environment():
    for name in program.UNWANTED:
        os.environ[name] = "of FreeCAD"
    try:
        assert not set(program.environment()) & set(program.UNWANTED)
    finally:
        for name in program.UNWANTED:
            del os.environ[name]


def a_child_that_is_killed_leaves_no_process():
    from freecad.Isomark.child import Child

    called = []
    child = Child(shutil.which("sleep"), ["600"], lambda *_: called.append(1), lambda *_: called.append(2))
    process = child._process
    until(lambda: process.state() == QtCore.QProcess.Running, "a running program")
    number = int(process.processId())
    child.kill()
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        pass
    else:
        raise AssertionError("process %d still runs" % number)
    application.processEvents()
    assert called == []
    Child(os.path.join(tempfile.gettempdir(), "no-such-program"), [], None, lambda *words: called.append(words))
    until(lambda: called, "a sentence")
    assert "cannot be started" in called[0][0] and "Install isomark" in called[0][1]
    called.clear()
    Child(shutil.which("sh"), ["-c", "kill -9 $$"], None, lambda *words: called.append(words))
    until(lambda: called, "a sentence")
    assert "crashed" in called[0][0] and "try again" in called[0][1]


def long_words_do_not_widen_the_panel():
    from freecad.Isomark.wording import LONGEST_WORD, dividable

    path = "/home/user/" + "folder/" * 20 + "station.toml"
    shown = dividable("The file %s is missing." % path)
    assert max(len(piece) for piece in re.split("[ \u200b]", shown)) <= LONGEST_WORD
    assert shown.replace("\u200b", "") == "The file %s is missing." % path
    assert dividable("A short sentence, and a/path.") == "A short sentence, and a/path."
    assert len(dividable("x" * 100000)) < 2000


def a_drawing_that_left_without_a_report_is_not_called_delivered():
    """Only a station that says so delivered the same before."""

    def words(result, drop="can@label.dxf"):
        status = {"finished": [{"drop": "other.dxf", "result": "delivered"}, {"drop": drop, "result": result}]}
        return station.filed_words(status, "can@label.dxf")

    assert "delivered the same before" in words("repeated")[0]
    assert "not known whether" in words("uncertain")[0] and "isomark retry" in words("uncertain")[1]
    assert "handed the drawing over" in words("handed-over")[0] and "fleet" in words("handed-over")[1]
    for unknown in (words("repeated", "can@old.dxf"), words("something new"), station.filed_words({}, "can@label.dxf")):
        assert "no report" in unknown[0] and "import folder" in unknown[1], unknown


def a_hot_folder_alone_states_whether_its_answer_can_be_seen():
    with tempfile.TemporaryDirectory() as folder:
        hot = os.path.join(folder, "hot")
        os.mkdir(hot)
        answer = station.Answer(station.open_station(hot), "can", "can.glb", "can@a.dxf")
        assert not answer.can_be_seen()
        os.mkdir(os.path.join(folder, "reports"))
        assert answer.can_be_seen()


def the_package_names_what_it_contains():
    folder = os.path.dirname(harness.PLUGIN)
    space = "{https://wiki.freecad.org/Package_Metadata}"
    root = ElementTree.parse(os.path.join(folder, "package.xml")).getroot()
    classes = [entry.text for entry in root.iter(space + "classname")]
    with open(os.path.join(harness.PLUGIN, "Isomark", "init_gui.py"), encoding="utf-8") as file:
        source = file.read()
    assert classes == ["IsomarkWorkbench"] and "class IsomarkWorkbench(" in source
    files = [entry.text for entry in root.iter(space + "icon")]
    files += [entry.get("file") for entry in root.iter(space + "license")]
    assert len(files) == 4
    for name in files:
        assert os.path.isfile(os.path.join(folder, name)), name
    for name in ("LICENSE-MIT", "LICENSE-APACHE"):
        with open(os.path.join(folder, name)) as ours, open(os.path.join(folder, "..", "..", name)) as theirs:
            assert ours.read() == theirs.read(), name
    from freecad import Isomark

    assert root.find(space + "version").text == Isomark.__version__


harness.run(
    [
        the_package_names_what_it_contains,
        the_station_file_is_understood_like_isomark_does,
        a_drawing_file_that_changed_is_noticed,
        a_file_that_is_written_while_it_is_followed_is_noticed,
        a_share_that_hangs_does_not_block_and_gets_one_thread,
        a_rejection_is_told_in_the_words_of_the_panel,
        suggested_names_are_accepted,
        programs_that_are_not_isomark_have_a_remedy,
        the_program_gets_a_clean_environment,
        a_child_that_is_killed_leaves_no_process,
        long_words_do_not_widen_the_panel,
        a_hot_folder_alone_states_whether_its_answer_can_be_seen,
        a_drawing_that_left_without_a_report_is_not_called_delivered,
        a_running_station_delivers_what_is_sent,
        a_rejected_drawing_comes_back_with_its_reason,
        a_rejected_part_is_the_answer_to_its_drawing,
        a_station_that_does_not_run_is_named,
        a_drawing_that_waits_is_shown_with_what_it_waits_for,
        a_second_drawing_does_not_move_one_that_waits,
        a_drawing_that_was_placed_with_another_frame_is_pointed_out,
        a_rotation_in_the_settings_is_marked_as_it_is_shown,
        settings_that_replace_the_frame_are_pointed_out,
        a_hot_folder_that_may_not_be_written_has_a_remedy,
        a_missing_hot_folder_has_a_remedy,
        killed_while_sending_nothing_half_is_left,
    ]
)
