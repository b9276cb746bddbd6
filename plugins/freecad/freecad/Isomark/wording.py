# SPDX-License-Identifier: MIT OR Apache-2.0
"""Texts for people: translation, and troubles with a remedy."""

import re

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


#: The longest text that a panel shows, and the longest piece of it that is not divided into lines, in letters.
LONGEST_TEXT, LONGEST_WORD = 1500, 30


def dividable(text):
    """The text with places where lines may end in long words, such as paths: a word that does not fit widens a panel."""
    if len(text) > LONGEST_TEXT:
        text = text[:LONGEST_TEXT] + "…"
    return re.sub(r"\S{%d,}" % (LONGEST_WORD + 1), lambda match: _divided(match.group()), text)


def _divided(word):
    """A long word, divided behind the names of folders where that is enough."""
    pieces = re.findall(r"[^/\\]*[/\\]|[^/\\]+", word)
    cut = [piece[at : at + LONGEST_WORD] for piece in pieces for at in range(0, len(piece), LONGEST_WORD)]
    return "\u200b".join(cut)


class Trouble(Exception):
    """Why something cannot be done, and what to do about it: two sentences for people."""

    def __init__(self, what, remedy):
        super().__init__(what + " " + remedy)
        self.what = what
        self.remedy = remedy
