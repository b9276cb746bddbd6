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
FINAL = (DELIVERED, REJECTED, FAILED)

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


def plain_name(text, instead):
    """A name of a product or drawing that isomark and every file system accept."""
    text = unicodedata.normalize("NFC", text)
    text = "".join("_" if letter in '/\\:*?"<>|@' or unicodedata.category(letter) == "Cc" else letter for letter in text)
    text = text.strip(". ")[:80].strip(". ")
    if text and not (text[0].isalnum() or text[0] == "_"):
        text = "_" + text
    devices = {"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}
    devices |= {device + digit for device in ("COM", "LPT") for digit in "0123456789¹²³"}
    if text.split(".")[0].rstrip().upper() in devices:
        text = "_" + text
    return text or instead


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

    def __init__(self, find_station, sku, files, find_program, direction=None):
        """`find_station` returns the Station; it is called in the background, because a share may not answer. `files` are
        pairs of name and bytes in the order of their arrival; the last is the drawing. `direction` is the Z of the marking
        frame, if there is one."""
        super().__init__(name="isomark courier", daemon=True)
        self.station, self.files, self.direction = None, files, direction
        self.find_station, self.find_program = find_station, find_program
        self.folder = unicodedata.normalize("NFC", sku).lower()
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
                if answer := self._filed(before):
                    self.answer = answer
                else:
                    self.answer = Answer(DELIVERED, f"The station had delivered the same {self.drawing} before; "
                                                    "the result is unchanged.")
                return
            self.answer = self._waiting(state)

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
                unused = program.unused_frame(document, self.direction) or ""
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
