# SPDX-License-Identifier: GPL-3.0-or-later
"""A station as seen from a design program: sends files to its hot folder and waits for its answer."""

import json
import os
import threading
import time
import unicodedata
from collections import namedtuple
from pathlib import Path

from . import program
from .trouble import Trouble, of_system

# The folders that are used; `reports` and `rejected` are None where they are not known, `file` without a station file.
Station = namedtuple("Station", "file hot reports rejected")

# The station's answer: `kind` is one of the names below, `what` and `remedy` are for people, `report` is isomark's.
Answer = namedtuple("Answer", "kind what remedy report", defaults=("", None))
SENDING, SENT, WAITING, DELIVERED, REJECTED, FAILED = "sending", "sent", "waiting", "delivered", "rejected", "failed"
# Nothing is sent until the user presses the button again.
ASKING = "asking"
# Nobody looks any more, and the answer is not known.
LEFT = "left"
FINAL = (DELIVERED, REJECTED, FAILED, ASKING, LEFT)

_PAUSE_S = 0.3
_STATUS_EVERY_S = 2.0
# A drop that was filed without a report or a reason within this time was a repeat.
_FILED_S = 5.0
_GIVE_UP_S = 1800.0
# The start of names that isomark ignores, and the age after which such a file is left over.
_HIDDEN = ".isomark-"
_LEFTOVER_S = 3600
_TRIES, _TRY_PAUSE_S = 20, 0.1


def at(station_file="", hot_folder=""):
    """The station of a settings file, or that of a hot folder alone.

    Raises Trouble if neither is given, the file cannot be read, or the hot folder does not exist.
    """
    if station_file.strip():
        file = Path(station_file.strip()).expanduser()
        try:
            folders = _folders(file.read_text(encoding="utf-8-sig"))
        except (OSError, UnicodeDecodeError) as error:
            raise of_system("read the station's settings", file, error) if isinstance(error, OSError) else Trouble(
                f"The file {file} is not a text in UTF-8.", "Choose the station's settings file, station.toml.") from error
        if not hot_folder.strip() and "hot" not in folders:
            raise Trouble(f"The file {file} names no hot folder.", "Choose the station's settings file, station.toml.")
        place = {name: file.parent / folders.get(name, name) for name in ("hot", "reports", "rejected")}
        station = Station(str(file), place["hot"], place["reports"], place["rejected"])
        if hot_folder.strip():
            station = station._replace(hot=Path(hot_folder.strip()).expanduser())
    elif hot_folder.strip():
        hot = Path(hot_folder.strip()).expanduser()
        beside = {name: hot.parent / name for name in ("reports", "rejected")}
        station = Station(None, hot, *(folder if folder.is_dir() else None for folder in beside.values()))
    else:
        raise Trouble("The add-on does not know the hot folder.",
                      "Enter the station's settings file or its hot folder in the add-on's preferences.")
    if not station.hot.is_dir():
        raise Trouble(f"There is no hot folder {station.hot}.",
                      "Connect the share, or correct the folder in the add-on's preferences.")
    return station


def _folders(text):
    """The paths in the table [folders] of a station's settings. Python has a reader of TOML only from 3.11 on."""
    try:
        import tomllib
    except ImportError:
        return _plain_folders(text)
    try:
        folders = tomllib.loads(text).get("folders", {})
    except tomllib.TOMLDecodeError:
        # isomark reports the mistake; what can be read is enough here.
        return _plain_folders(text)
    return {name: path for name, path in folders.items() if isinstance(path, str)}


def _plain_folders(text):
    table, folders = "", {}
    for line in text.splitlines():
        line = line.strip()
        if line.startswith("["):
            table = line.strip("[] ").split("]")[0].strip()
        elif table == "folders" and "=" in line:
            name, value = (part.strip() for part in line.split("=", 1))
            quote = value[:1]
            if quote in ('"', "'") and quote in value[1:]:
                value = value[1:value.index(quote, 1)]
                folders[name] = value.replace("\\\\", "\\") if quote == '"' else value
    return folders


# Most bytes of the name of a product or of a drawing.
_LONGEST_NAME = 96


def plain_name(text, instead):
    """A name of a product or drawing that isomark and every file system accept."""
    text = unicodedata.normalize("NFC", text)
    text = "".join("_" if letter in '/\\:*?"<>|@' or unicodedata.category(letter) == "Cc" else letter for letter in text)
    text = text.strip(". ")
    if text and not (text[0].isalnum() or text[0] == "_"):
        text = "_" + text
    # Two names, an ending and the start of a hidden name fit into the 255 bytes of a file name.
    text = text[:80].encode()[:_LONGEST_NAME].decode(errors="ignore").strip(". ")
    devices = {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}
    devices |= {device + digit for device in ("COM", "LPT") for digit in "0123456789¹²³"}
    if text.split(".")[0].rstrip().upper() in devices:
        text = "_" + text
    return text or instead


# The start of the line that names the frame of a drawing in its settings, for the plugins of other programs, too.
_FRAME_LINE = "# isomark frame: "
_DRAWINGS = (".dxf", ".svg", ".png", ".bmp")
# Most reports that are read to find drawings with another frame.
_MOST_REPORTS = 100


def sidecar(frame):
    """The settings of a drawing as a file beside it; a comment names its marking frame: origin in mm, z and x, or None."""
    if frame is None:
        return f"{_FRAME_LINE}none\n".encode()
    numbers = " ".join(f"{round(number, 4) + 0.0:.4f}" for axis in frame for number in axis)
    return f'{_FRAME_LINE}{numbers}\n[placement]\nanchor = "origin"\n'.encode()


def refuse_another_frame(hot, files):
    """Raises Trouble while another drawing of the SKU waits in the hot folder with another marking frame.

    The frame belongs to the part, and the newer part would replace the one that the other drawing was sent with. `files` are
    part, settings and drawing.
    """
    part, settings, _ = (_key(os.path.splitext(name)[0]) for name, _ in files)
    ours = _frame_line(files[1][1])
    try:
        there = os.listdir(hot)
    except OSError:
        # `put` states it.
        return
    stems = {_key(os.path.splitext(name)[0]) for name in there if name.lower().endswith(_DRAWINGS)}
    for name in sorted(there):
        stem, ending = os.path.splitext(_key(name))
        if ending != ".toml" or not stem.startswith(part + "@") or stem == settings or stem not in stems:
            continue
        try:
            theirs = _frame_line((Path(hot) / name).read_bytes())
        except OSError:
            # The station took it.
            continue
        if theirs not in (None, ours):
            raise Trouble(f"The drawing {os.path.splitext(name)[0]} of the same SKU still waits in the hot folder, and it has "
                          "another frame. Sent now, this drawing would move its mark.",
                          "Wait until the station delivered it, or enter another SKU for this drawing.")


def _frame_line(settings):
    lines = settings.decode("utf-8", "replace").splitlines()
    return next((line for line in lines if line.startswith(_FRAME_LINE)), None)


def placed_elsewhere(reports, drawing, frame):
    """The drawings in a folder of reports, without this one, that were placed with another marking frame.

    The part with the new frame makes them outdated, and a correction would move their marks.
    """
    ending, found = ".report.json", []
    try:
        places = [entry for entry in os.scandir(reports) if entry.name.endswith(ending) and entry.name != drawing + ending]
        places.sort(key=lambda entry: entry.stat().st_mtime, reverse=True)
    except OSError:
        return []
    for entry in places[:_MOST_REPORTS]:
        used = ((_document(entry.path) or {}).get("placement") or {}).get("frame") or {}
        if used.get("source") == "part" and not program.is_same_frame(used, frame):
            found.append(entry.name[:-len(ending)])
    return found


def _key(name):
    """The name of a SKU's folder: two spellings that some file systems treat as one have one folder."""
    return unicodedata.normalize("NFC", name).lower()


def put(hot, files):
    """Puts files, pairs of name and bytes, into the hot folder: each whole or not at all, and in this order.

    All are written under names that isomark ignores before the first gets its real name. Raises Trouble if a file cannot
    be written; nothing is left then.
    """
    hidden = [hot / f"{_HIDDEN}{os.getpid()}-{threading.get_ident()}-{name}.part" for name, _ in files]
    try:
        _remove_leftovers(hot)
        for place, (_, data) in zip(hidden, files):
            with open(place, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        for place, (name, _) in zip(hidden, files):
            _rename(place, hot / name)
    except OSError as error:
        raise of_system("write to the hot folder", hot, error) from error
    finally:
        for place in hidden:
            try:
                place.unlink()
            except OSError:
                # It has its real name, or was never written.
                pass


def _remove_leftovers(hot):
    """Removes files that a program left here which was killed while it sent."""
    for place in hot.glob(f"{_HIDDEN}*.part"):
        try:
            if time.time() - place.stat().st_mtime > _LEFTOVER_S:
                place.unlink()
        except OSError:
            # Another program removed it.
            pass


def _rename(place, name):
    """Renames; on Windows, a file that a reader has open cannot be replaced for a moment."""
    for last in range(_TRIES, -1, -1):
        try:
            os.replace(place, name)
            return
        except PermissionError:
            if os.name != "nt" or last == 0:
                raise
            time.sleep(_TRY_PAUSE_S)


class Courier(threading.Thread):
    """Sends files and follows what the station does with them, without blocking the window.

    `answer` is the newest Answer. A stopped courier no longer looks; the files stay where they are.
    """

    def __init__(self, find_station, sku, files, find_program, frame=None, is_confirmed=False):
        """`find_station` returns the Station; it is called in the background, because a share may not answer. `files` are
        pairs of name and bytes in the order of their arrival: part, settings, drawing. `frame` is the marking frame: origin
        in mm, z and x. `is_confirmed`: the user knows that other drawings of the SKU become outdated."""
        super().__init__(name="isomark courier", daemon=True)
        self.station, self.files, self.frame, self.is_confirmed = None, files, frame, is_confirmed
        self.find_station, self.find_program = find_station, find_program
        self.folder = _key(sku)
        self.drawing = files[-1][0]
        self.answer = Answer(SENDING, f"Sending {self.drawing}.")
        self._stopped = threading.Event()
        self._child = None

    def stop(self):
        """Ends the watch and a running status command."""
        self._stopped.set()

    def run(self):
        try:
            self.station = self.find_station()
            refuse_another_frame(self.station.hot, self.files)
            if not self.is_confirmed and (others := self._others()):
                self.answer = Answer(ASKING, f"Not sent yet. Of this SKU, {others} has another frame. If you send this drawing, "
                                             f"a later correction of {others} moves its mark.",
                                     "Enter another SKU for this drawing, or press Send again to send it all the same.")
                return
            before = self._snapshot()
            put(self.station.hot, self.files)
            self._follow(before)
        except Trouble as trouble:
            self.answer = Answer(FAILED, trouble.what, trouble.remedy)
        except Exception as error:  # A thread that ends silently would leave "sending" in the panel.
            self.answer = Answer(FAILED, f"The add-on failed: {error}.", "Report this to the project.")

    def _follow(self, before):
        station = self.station
        if not (station.reports or station.rejected or station.file):
            self.answer = Answer(SENT, f"Sent {self.drawing}. Its folders reports and rejected are not beside the hot folder, "
                                       "so the answer cannot be shown.",
                                 "Enter the station's settings file in the add-on's preferences.")
            return
        self.answer = Answer(WAITING, f"Sent {self.drawing}. Waiting for the station.")
        begin = time.monotonic()
        next_status, filed_since, state = begin + 0.5, None, None
        while not self._stopped.wait(_PAUSE_S) and time.monotonic() < begin + _GIVE_UP_S:
            if answer := self._filed(before):
                self.answer = answer
                return
            now = time.monotonic()
            if now >= next_status:
                state, next_status = self._status(), now + _STATUS_EVERY_S
            is_there = os.path.lexists(station.hot / self.drawing)
            busy = isinstance(state, dict) and any(job.get("drop") == self.drawing for job in state.get("under_way", []))
            filed_since = None if is_there or busy else filed_since or now
            if filed_since and now - filed_since > _FILED_S:
                self.answer = self._filed(before) or self._left(self._status())
                return
            self.answer = self._waiting(state)
        if not self._stopped.is_set():
            self.answer = Answer(LEFT, f"The station has not answered for {_GIVE_UP_S / 60:.0f} minutes, and the add-on no longer "
                                       f"looks for its answer. {self.answer.what}",
                                 self.answer.remedy or "Look for the drawing in the station's folders, or send it again.")

    def _others(self):
        """The names of drawings of the SKU with another frame, as a text."""
        reports = self.station.reports
        names = placed_elsewhere(reports / self.folder, self.drawing, self.frame) if reports else []
        return ", ".join(names[:3]) + (", …" if names[3:] else "")

    def _snapshot(self):
        return {place: _stamp(place) for place in [self._report(), *self._reasons()] if place}

    def _report(self):
        reports = self.station.reports
        return reports / self.folder / f"{self.drawing}.report.json" if reports else None

    def _reasons(self):
        """Places of reasons for these files: a taken name goes to the folder (2), (3) and so on."""
        rejected, places = self.station.rejected, []
        if rejected:
            for name, _ in self.files:
                number = 1
                while True:
                    folder = rejected if number == 1 else rejected / f"({number})"
                    places.append(folder / f"{name}.reason.json")
                    if not os.path.lexists(places[-1]):
                        break
                    number += 1
        return places

    def _filed(self, before):
        """The final answer if there is one: a report or a reason that is newer than the files."""
        for place in self._reasons():
            if _stamp(place) not in (None, before.get(place)):
                if reason := _document(place):
                    name = reason.get("drop") or place.name[:-len(".reason.json")]
                    return Answer(REJECTED, f"{name} was rejected: {reason.get('what', '')}", reason.get("remedy", ""))
        report = self._report()
        if report and _stamp(report) not in (None, before.get(report)):
            if document := _document(report):
                unused = program.unused_frame(document, self.frame) or ""
                return Answer(DELIVERED, f"Delivered as {self.drawing}.", unused, document)
        return None

    def _status(self):
        """The station's status; None if it cannot be asked, a Trouble if isomark states why it has none."""
        if not self.station.file:
            return None
        try:
            child = program.Child(self.find_program(), ["status", self.station.file, "--json"], 20)
            try:
                while (ended := child.poll()) is None:
                    if self._stopped.wait(0.02):
                        return None
            finally:
                child.end()
            return program.result(ended)
        except Trouble as trouble:
            return trouble

    def _left(self, state):
        """What became of a drawing that left the hot folder without a report or a reason."""
        finished = state.get("finished", []) if isinstance(state, dict) else []
        result = next((entry.get("result") for entry in finished if entry.get("drop") == self.drawing), None)
        if result == "repeated":
            return Answer(DELIVERED, f"The station had delivered the same {self.drawing} before; the result is unchanged.")
        if result in ("delivered", "delivered-again"):
            return Answer(DELIVERED, f"Delivered as {self.drawing}. Its report is not in the folder reports.")
        if result == "uncertain":
            return Answer(LEFT, f"It is not known whether {self.drawing} was delivered.",
                          "Check the import folder, and run isomark retry with the name of the drawing.")
        if result == "handed-over":
            return Answer(LEFT, f"The station handed {self.drawing} over to its line. It is not known here whether it is delivered.",
                          "Run isomark fleet status to see the line.")
        return Answer(LEFT, f"{self.drawing} left the hot folder, and no report and no reason was found.",
                      "Check the import folder, or run isomark status for the station.")

    def _waiting(self, state):
        """What the files wait for."""
        still = f"Waiting for the station: {self.drawing}."
        if state is None:
            return Answer(WAITING, still)
        if isinstance(state, Trouble):
            return Answer(WAITING, f"{still} Its state is not known: {state.what}", state.remedy)
        names = [name for name, _ in self.files]
        for kind in ("waiting", "incomplete"):
            for drop in state.get(kind, {}).get("first", []):
                if drop.get("drop") in names:
                    reason = drop.get("reason", {})
                    return Answer(WAITING, f"{drop['drop']} waits: {reason.get('what', '')}", reason.get("remedy", ""))
        if state.get("state") == "silent":
            return Answer(WAITING, f"The station {state.get('station', '')} runs, but does not report its state. {self.drawing} "
                                   "waits.", "Read its log, or end it and start it again.")
        if state.get("state") != "running":
            return Answer(WAITING, f"The station {state.get('station', '')} is not running, so {self.drawing} waits.",
                          f"Start it: isomark watch {self.station.file}")
        troubles = state.get("troubles", [])
        return Answer(WAITING, still, troubles[0] if troubles else "")


def _stamp(path):
    try:
        stat = os.stat(path)
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


def _document(path):
    """A JSON document, or None while it cannot be read."""
    try:
        document = json.loads(Path(path).read_bytes())
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) else None
