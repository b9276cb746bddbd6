# SPDX-License-Identifier: MIT OR Apache-2.0
"""Texts for people: translation, and troubles with a remedy."""

try:
    from FreeCAD import Qt as _Qt

    _translate = _Qt.translate
except (ImportError, AttributeError):

    def _translate(_context, text):
        return text


def translate(context, text, /, **values):
    """The text in the user's language, with `{name}` replaced by `values`."""
    text = _translate(context, text)
    return text.format(**values) if values else text


class Trouble(Exception):
    """Why something cannot be done, and what to do about it: two sentences for people."""

    def __init__(self, what, remedy):
        super().__init__(what + " " + remedy)
        self.what = what
        self.remedy = remedy
