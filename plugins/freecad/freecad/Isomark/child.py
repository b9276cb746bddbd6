# SPDX-License-Identifier: MIT OR Apache-2.0
"""Runs a program or a function without blocking the window."""

import queue
import threading

from PySide import QtCore

from . import program
from .wording import translate


class Child:
    """One run of a program. `done(code, output, errors)` or `failed(what, remedy)` is called once, unless it is killed."""

    #: Those that run: Qt's signals alone would not keep them.
    _running = set()

    def __init__(self, path, arguments, done, failed, folder=None, limit_s=None):
        self._done = done
        self._failed = failed
        self._process = process = QtCore.QProcess(QtCore.QCoreApplication.instance())
        environment = QtCore.QProcessEnvironment()
        for name, value in program.environment().items():
            environment.insert(name, value)
        process.setProcessEnvironment(environment)
        if folder:
            process.setWorkingDirectory(folder)
        process.finished.connect(self._on_finished)
        process.errorOccurred.connect(self._on_error)
        self._timer = None
        if limit_s:
            self._timer = QtCore.QTimer()
            self._timer.setSingleShot(True)
            self._timer.timeout.connect(self._on_limit)
            self._timer.start(int(limit_s * 1000))
        Child._running.add(self)
        process.start(path, arguments)
        process.closeWriteChannel()

    def running(self):
        return self._process is not None

    def kill(self):
        """Ends the program at once and forgets it."""
        process = self._release()
        if process is not None and process.state() != QtCore.QProcess.NotRunning:
            process.kill()
            process.waitForFinished(1000)
        if process is not None:
            process.deleteLater()

    def _release(self):
        process, self._process = self._process, None
        Child._running.discard(self)
        if self._timer is not None:
            self._timer.stop()
            self._timer = None
        if process is not None:
            process.finished.disconnect(self._on_finished)
            process.errorOccurred.disconnect(self._on_error)
        return process

    def _on_finished(self, code, *_):
        process = self._release()
        if process is None:
            return
        output = bytes(process.readAllStandardOutput().data())
        errors = bytes(process.readAllStandardError().data())
        process.deleteLater()
        if process.exitStatus() == QtCore.QProcess.NormalExit:
            self._done(code, output, errors)
        else:
            self._failed(
                translate("Isomark", "The program crashed, or the system ended it."),
                translate("Isomark", "Close other programs if memory is short, and try again. If it happens again, report it."),
            )

    def _on_error(self, error):
        # After a crash, `finished` follows.
        if error == QtCore.QProcess.FailedToStart and self._process is not None:
            words = self._process.errorString()
            self._release().deleteLater()
            self._failed(
                translate("Isomark", "The program cannot be started: {words}.", words=words.rstrip(".")),
                program.install_remedy(),
            )

    def _on_limit(self):
        failed = self._failed
        self.kill()
        failed(
            translate("Isomark", "The program did not answer in time."),
            translate("Isomark", "Check that it is isomark, and that its drive or share answers."),
        )


class Newest:
    """Runs functions in threads, one at a time: while one of them hangs, the newest of the others waits for its end."""

    def __init__(self):
        self._work = None
        self._done = None
        self._waiting = None

    def run(self, work, done):
        """Runs a function instead of the ones before: `done(result, error)` is called for it alone."""
        self._done, self._waiting = None, (work, done)
        self._advance()

    def forget(self):
        """Calls nothing for what was run."""
        self._done = self._waiting = None

    def close(self):
        self.forget()
        if self._work is not None:
            self._work.forget()

    def _advance(self):
        if self._work is None and self._waiting is not None:
            (work, self._done), self._waiting = self._waiting, None
            self._work = Background(work, self._answered)

    def _answered(self, result, error):
        self._work = None
        done, self._done = self._done, None
        if done is not None:
            done(result, error)
        self._advance()


class Background:
    """Runs a function in a thread; `done(result, error)` is called in the thread of the window, unless it is forgotten."""

    def __init__(self, work, done):
        self._done = done
        self._results = queue.Queue()
        # A share that hangs must not keep FreeCAD from ending.
        threading.Thread(target=self._run, args=(work,), daemon=True).start()
        self._timer = QtCore.QTimer()
        self._timer.timeout.connect(self._look)
        self._timer.start(50)

    def forget(self):
        self._timer.stop()
        self._done = None

    def _run(self, work):
        try:
            self._results.put((work(), None))
        except Exception as error:  # the window's thread shows it
            self._results.put((None, error))

    def _look(self):
        try:
            result, error = self._results.get_nowait()
        except queue.Empty:
            return
        self._timer.stop()
        if self._done is not None:
            self._done(result, error)
