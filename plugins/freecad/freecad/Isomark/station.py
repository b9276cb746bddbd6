# SPDX-License-Identifier: MIT OR Apache-2.0
"""A station's folders: files go in complete or not at all, and its answer comes back. Without Qt."""

import errno
import json
import os
import re
import time
import unicodedata
import uuid

from .frame import Frame, dot
from .wording import Trouble, translate

#: The longest name that the station accepts, in bytes.
_LONGEST = 230
_PREFIX = ".isomark-freecad-"
_FORBIDDEN = '/\\:*?"<>|@'
#: Endings of drawings that isomark reads.
DRAWINGS = (".dxf", ".svg", ".png", ".bmp")


class Station:
    """The folders of a station: `file` is its settings, or empty if only the hot folder is known."""

    def __init__(self, file, hot, reports, rejected):
        self.file = file
        self.hot = hot
        self.reports = reports
        self.rejected = rejected


def open_station(path):
    """The station of a `station.toml`, or of a hot folder, which may be missing. Raises `Trouble`."""
    path = os.path.abspath(os.path.expanduser(path.strip()))
    if os.path.isdir(path) or not (os.path.exists(path) or path.lower().endswith(".toml")):
        inside = os.path.join(path, "station.toml")
        if not os.path.isfile(inside):
            beside = os.path.dirname(path)
            return Station("", path, os.path.join(beside, "reports"), os.path.join(beside, "rejected"))
        path = inside
    try:
        with open(path, encoding="utf-8-sig") as file:
            folders = _folders(file.read())
    except (OSError, UnicodeDecodeError) as error:
        raise Trouble(
            translate("Isomark", "The station file {path} cannot be read: {error}.", path=path, error=_short(error)),
            translate("Isomark", "Choose the station.toml of your station, or its hot folder."),
        ) from error
    base = os.path.dirname(path)
    if not folders.get("hot"):
        raise Trouble(
            translate("Isomark", "The station file {path} names no hot folder.", path=path),
            translate("Isomark", "Run `isomark check` on this file, or choose the hot folder itself."),
        )
    hot, reports, rejected = (os.path.join(base, folders.get(name, name)) for name in ("hot", "reports", "rejected"))
    return Station(path, hot, reports, rejected)


def _folders(text):
    """The table `[folders]`."""
    try:
        import tomllib
    except ImportError:  # Python before 3.11
        return _folders_of_lines(text)
    try:
        folders = tomllib.loads(text).get("folders", {})
    except tomllib.TOMLDecodeError:
        # isomark names the mistake when it reads the file.
        return _folders_of_lines(text)
    return {name: value for name, value in folders.items() if isinstance(value, str)}


def _folders_of_lines(text):
    folders, table = {}, ""
    for line in text.splitlines():
        header = re.match(r"\s*\[\s*([\w.-]+)\s*\]", line)
        entry = re.match(r"""\s*(?:folders\.)?(\w+)\s*=\s*("(?:[^"\\]|\\.)*"|'[^']*')""", line)
        if header:
            table = header.group(1)
        elif entry and (table == "folders" or line.strip().startswith("folders.")):
            value = entry.group(2)
            folders[entry.group(1)] = value[1:-1] if value[0] == "'" else _unescaped(value)
    return folders


def _unescaped(text):
    try:
        return json.loads(text)
    except ValueError:
        return text[1:-1]


def check_name(name, what):
    """Raises `Trouble` for a product or drawing name that the station does not accept."""
    wrong = next((c for c in name if c in _FORBIDDEN or ord(c) < 32), None)
    if not name:
        problem = translate("Isomark", "The {what} has no name.", what=what)
    elif wrong:
        problem = translate("Isomark", "The name of the {what} contains {character}.", what=what, character=wrong)
    elif not (name[0].isalnum() or name[0] == "_") or name[-1] in ". ":
        problem = translate("Isomark", "The name of the {what} starts or ends with a wrong character.", what=what)
    elif len(name) > 100:
        problem = translate("Isomark", "The name of the {what} is longer than 100 characters.", what=what)
    else:
        return
    raise Trouble(
        problem,
        translate("Isomark", "Enter a name of letters, digits, - and _."),
    )


def plain_name(text):
    """A name made of a text that the station accepts; empty if nothing is left."""
    name = re.sub(r"[\s%s]+" % re.escape(_FORBIDDEN), "-", text)
    name = "".join(c for c in name if ord(c) >= 32).lstrip("-.~ ")[:60].rstrip("-. ")
    return name if not name or name[0].isalnum() or name[0] == "_" else ("_" + name)[:60]


#: The start of the line that names the frame of a drawing in its settings, for the plugins of other programs, too.
_FRAME_LINE = "# isomark frame: "


def sidecar(options, frame):
    """The settings of a drawing as a file beside it; a comment names its marking frame.

    They say what `program.correct_arguments` says, so that the station marks what the panel shows.
    """
    numbers = [round(number, 4) + 0.0 for axis in (frame.origin, frame.z, frame.x) for number in axis]
    lines = [_FRAME_LINE + " ".join("%.4f" % number for number in numbers)]
    lines += ["[placement]", 'anchor = "%s"' % options.get("anchor", "origin")]
    # Without a rotation in the panel, that of the station's settings is used. If these are not known here, there is none.
    if options.get("rotate_deg") or not options.get("station"):
        lines.append("rotate_deg = %g" % options.get("rotate_deg", 0.0))
    if options.get("width_mm"):
        lines += ["", "[pattern]", "width_mm = %g" % options["width_mm"]]
    return ("\n".join(lines) + "\n").encode("utf-8")


def drop_names(product, drawing, ending):
    """The names of part, settings and drawing in the hot folder. Raises `Trouble` for names that are too long."""
    stem = "%s@%s" % (product, drawing)
    if len((stem + ending).encode("utf-8")) > _LONGEST:
        raise Trouble(
            translate("Isomark", "The names of product and drawing are too long."),
            translate("Isomark", "Enter shorter names."),
        )
    return product + ".glb", stem + ".toml", stem + ending


def refuse_another_frame(hot, names, settings):
    """Raises `Trouble` while another drawing of the product waits in the hot folder with another marking frame.

    The frame belongs to the part, and the newer part would replace the one that the other drawing was sent with. `names`
    are those of `drop_names`, `settings` is the sidecar.
    """
    start = _key(os.path.splitext(names[0])[0] + "@")
    own, ours = _key(os.path.splitext(names[1])[0]), _frame_line(settings)
    try:
        there = os.listdir(hot)
    except OSError:
        # `send` states it.
        return
    stems = {_key(os.path.splitext(name)[0]) for name in there if name.lower().endswith(DRAWINGS)}
    for name in sorted(there):
        stem, ending = os.path.splitext(_key(name))
        if ending != ".toml" or not stem.startswith(start) or stem == own or stem not in stems:
            continue
        try:
            with open(os.path.join(hot, name), "rb") as file:
                theirs = _frame_line(file.read(10000))
        except OSError:
            # The station took it.
            continue
        if theirs not in (None, ours):
            raise Trouble(
                translate(
                    "Isomark",
                    "The drawing {name} of the same product still waits in the hot folder, and it has another plane or "
                    "origin. Sent now, this drawing would move its mark.",
                    name=os.path.splitext(name)[0],
                ),
                translate("Isomark", "Wait until the station delivered it, or enter another product for this drawing."),
            )


def _frame_line(settings):
    for line in settings.decode("utf-8", "replace").splitlines():
        if line.startswith(_FRAME_LINE):
            return line
    return None


#: The most reports that are read to find drawings with another frame.
_MOST_REPORTS = 100


def placed_elsewhere(station, product, drawing, frame):
    """The delivered drawings of the product, without this one, that were placed with another marking frame.

    The part with the new frame makes them outdated, and a correction would move their marks.
    """
    ending = ".report.json"
    try:
        reports = [entry for entry in os.scandir(os.path.join(station.reports, _key(product)))]
        reports = [entry for entry in reports if entry.name.endswith(ending) and entry.name != drawing + ending]
        reports.sort(key=lambda entry: entry.stat().st_mtime, reverse=True)
    except OSError:
        return []
    found = []
    for entry in reports[:_MOST_REPORTS]:
        used = ((_json(entry.path) or {}).get("placement") or {}).get("frame") or {}
        if used.get("source") == "part" and not _frame_in(used).is_same(frame):
            found.append(entry.name[: -len(ending)])
    return found


def _frame_in(used):
    """The marking frame of a report."""
    return Frame(used["origin_mm"], used["z"], used["x"])


def frame_words(report, frame):
    """What is wrong if isomark placed the drawing with another frame than this, and what to do; otherwise `None`."""
    placement = report.get("placement") or {}
    used = placement.get("frame")
    if dot(placement.get("facing") or frame.z, frame.z) <= 0.999:
        what = translate("Isomark", "The mark is on another side of the part than the drawing.")
    elif used is None or used.get("source") != "part":
        what = translate("Isomark", "The mark may be at another place than the drawing: its plane was not used.")
    elif _frame_in(used).is_same(frame):
        return None
    else:
        return (
            translate(
                "Isomark",
                "The mark is at another place than the drawing: another drawing of this product was sent, with another "
                "plane or origin.",
            ),
            translate("Isomark", "Do not mark it. Enter another product for this drawing, and send it again."),
        )
    return what, translate(
        "Isomark",
        "Remove facing, roll_deg and frame from the settings of this product, or install a newer isomark, which supports "
        "marking frames.",
    )


def send(hot, files):
    """Puts files, pairs of a name and bytes, into the hot folder: each complete or not at all, in this order.

    All are written under names that the station ignores before the first gets its name, so an interruption leaves
    nothing that the station could read. Raises `Trouble`.
    """
    if not os.path.isdir(hot):
        raise Trouble(
            translate("Isomark", "The hot folder {hot} is not available.", hot=hot),
            translate("Isomark", "Connect the drive or share, or choose another station."),
        )
    token = uuid.uuid4().hex[:12]
    _remove_leftovers(hot)
    written = []
    try:
        for number, (name, data) in enumerate(files):
            # Without the ending of the real name: no program takes it for a part or a drawing.
            path = os.path.join(hot, "%s%s-%d.part" % (_PREFIX, token, number))
            written.append((path, os.path.join(hot, name)))
            with open(path, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        for path, final in written:
            _rename(path, final)
    except OSError as error:
        for path, _ in written:
            try:
                os.remove(path)
            except OSError:
                pass
        raise _send_trouble(hot, error) from error


def _rename(path, final):
    for _ in range(10):
        try:
            os.replace(path, final)
            return
        except PermissionError:
            # On Windows, a file of this name cannot be replaced while the station reads it.
            if os.name != "nt":
                raise
            time.sleep(0.2)
    os.replace(path, final)


def _send_trouble(hot, error):
    if isinstance(error, PermissionError) or error.errno == errno.EROFS:
        return Trouble(
            translate("Isomark", "You may not write into the hot folder {hot}.", hot=hot),
            translate("Isomark", "Ask for the right to write into it, or choose another station."),
        )
    return Trouble(
        translate("Isomark", "The hot folder {hot} cannot be written: {error}.", hot=hot, error=_short(error)),
        translate("Isomark", "Check the disk or share, then send again."),
    )


def _remove_leftovers(hot):
    """Removes what an interrupted sending left more than an hour ago."""
    try:
        names = [name for name in os.listdir(hot) if name.startswith(_PREFIX)]
    except OSError:
        return
    for name in names:
        path = os.path.join(hot, name)
        try:
            if time.time() - os.stat(path).st_mtime > 3600.0:
                os.remove(path)
        except OSError:
            pass


def _short(error):
    return getattr(error, "strerror", None) or str(error)


WAITING, DELIVERED, REJECTED, FILED = "waiting", "delivered", "rejected", "filed"


class Answer:
    """Looks for the station's answer to files that are sent after this was made."""

    def __init__(self, station, product, part, drawing):
        self.station = station
        self.drops = (part, drawing)
        self.drawing = drawing
        # The station's folders of a product have its name in lower case.
        self.report = os.path.join(station.reports, _key(product), drawing + ".report.json")
        self.report_before = stamp(self.report)
        self.reasons_before = {path: stamp(path) for path in self._reasons()}
        self.gone_since = None

    def can_be_seen(self):
        """Whether the station's folders are known: those of its settings, or beside the hot folder."""
        return bool(self.station.file) or os.path.isdir(self.station.reports) or os.path.isdir(self.station.rejected)

    def look(self):
        """The state, and the report or reason that belongs to it."""
        if stamp(self.report) not in (None, self.report_before):
            report = _json(self.report)
            if report is not None:
                return DELIVERED, report
        for path in self._reasons():
            if stamp(path) != self.reasons_before.get(path):
                reason = _json(path)
                if reason is not None and reason.get("drop") in self.drops:
                    return REJECTED, reason
        if os.path.exists(os.path.join(self.station.hot, self.drawing)) or not os.path.isdir(self.station.hot):
            self.gone_since = None
            return WAITING, None
        self.gone_since = self.gone_since or time.monotonic()
        # The station writes report and reason before it moves the drop; a share may show them later.
        return (FILED if time.monotonic() - self.gone_since > 10.0 else WAITING), None

    def _reasons(self):
        """The files with reasons that may belong to the drops: in the rejected folder and its numbered folders."""
        starts = tuple(name[:40] for name in self.drops)
        found = []
        folders = [self.station.rejected]
        try:
            folders += [
                entry.path for entry in os.scandir(self.station.rejected) if re.fullmatch(r"\(\d+\)", entry.name)
            ]
            for folder in folders:
                for entry in os.scandir(folder):
                    if entry.name.endswith(".reason.json") and entry.name.startswith(starts):
                        found.append(entry.path)
        except OSError:
            pass
        return found


def _key(product):
    """The name of the product's folder: two spellings that some file systems treat as one have one folder."""
    return unicodedata.normalize("NFC", product).lower()


def stamp(path):
    """Time, size and number of a file, which tell it from a later one; `None` if there is none."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return (status.st_mtime_ns, status.st_size, status.st_ino)


def _json(path):
    """The document of a file; `None` while it cannot be read."""
    try:
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) else None


def filed_words(status, drawing):
    """What became of a drawing that left the hot folder without a report or a reason: a sentence and a remedy.

    `status` is the station's status, or empty if it cannot be asked.
    """
    entries = status.get("finished") or []
    result = next((entry.get("result") for entry in entries if entry.get("drop") == drawing), None)
    if result == "repeated":
        return (
            translate("Isomark", "The station filed the drawing without delivering it: it delivered the same before."),
            translate("Isomark", "To deliver it again, use `isomark retry` with the drawing's name."),
        )
    if result in ("delivered", "delivered-again"):
        return translate("Isomark", "The station delivered the drawing. Its report is not in the folder reports."), ""
    if result == "uncertain":
        return _uncertain_words()
    if result == "handed-over":
        return (
            translate("Isomark", "The station handed the drawing over to its line. It is not known here whether it is delivered."),
            translate("Isomark", "Run `isomark fleet status` to see the line."),
        )
    return (
        translate("Isomark", "The drawing left the hot folder, and no report and no reason was found."),
        translate("Isomark", "Check the import folder, or run `isomark status` for the station."),
    )


def _uncertain_words():
    return (
        translate("Isomark", "It is not known whether the drawing was delivered."),
        translate("Isomark", "Check the import folder, and run `isomark retry` with the drawing's name."),
    )


def waiting_words(status, drops):
    """What the drops wait for, from the station's status: a sentence and a remedy, which may be empty."""
    state = status.get("state")
    if state in ("stopped", "ended-silently"):
        return (
            translate("Isomark", "The station is not running. The drawing waits in its hot folder."),
            translate("Isomark", "Start the station with `isomark watch`."),
        )
    if state == "silent":
        return (
            translate("Isomark", "The station runs, but does not report its state."),
            translate("Isomark", "Read its log, or start it again."),
        )
    for name in ("waiting", "incomplete"):
        for entry in (status.get(name) or {}).get("first", []):
            if entry.get("drop") in drops:
                reason = entry.get("reason") or {}
                return reason.get("what", ""), reason.get("remedy", "")
    for entry in (status.get("uncertain") or {}).get("first", []):
        if entry.get("drop") in drops:
            return _uncertain_words()
    if any(entry.get("drop") in drops for entry in status.get("under_way", [])):
        return translate("Isomark", "The station is working on the drawing."), ""
    return translate("Isomark", "The station has not looked at the drawing yet."), ""
