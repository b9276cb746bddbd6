# SPDX-License-Identifier: GPL-3.0-or-later
"""What went wrong, and what to do about it."""


class Trouble(Exception):
    """A failure for people: `what` is one sentence, `remedy` starts with a verb."""

    def __init__(self, what, remedy):
        super().__init__(f"{what} {remedy}")
        self.what = what
        self.remedy = remedy


class InputTrouble(Trouble):
    """A Trouble of the part, the drawing or the frame: they cannot be corrected as they are."""


def of_system(action, path, error):
    """The Trouble for an OSError: `action` is what failed, such as "write"."""
    text = error.strerror or str(error)
    remedies = {
        PermissionError: "Ask for permission to write there, or choose another folder in the add-on's preferences.",
        FileNotFoundError: "Check that the folder exists and that the share is connected.",
    }
    remedy = next((remedy for kind, remedy in remedies.items() if isinstance(error, kind)), None)
    if "read-only" in text.lower():
        remedy = remedies[PermissionError]
    return Trouble(f"Cannot {action} {path}: {text}.", remedy or "Check the disk, its free space and the permissions.")
