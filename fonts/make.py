"""Makes the two fonts that isomark ships: `python3 make.py DejaVuSans.ttf` (needs fonttools, skia-pathops and hershey-fonts).

`DejaVuSans-subset.ttf` keeps the outlines of European alphabets and common signs, with the kerning and the ligatures of Latin
letters, and without hints and other layout tables.
`hershey-simplex.txt` holds the strokes of Hershey's Simplex Roman, one letter a line: code point in hexadecimal,
advance, then strokes of `x,y` points; y is up from the baseline and capitals are 21 high. Letters with accents are
composed here, and the few signs in `SIGNS` are isomark's own.
"""

import sys
import unicodedata

from fontTools import subset
from fontTools.ttLib.removeOverlaps import removeOverlaps
from HersheyFonts import HersheyFonts

KEPT = [
    (0x20, 0x7E), (0xA0, 0x17F), (0x18F, 0x192), (0x218, 0x21B), (0x2C6, 0x2DD), (0x370, 0x3FF), (0x400, 0x45F), (0x490, 0x491),
    (0x1E80, 0x1E85), (0x1E9E, 0x1E9E), (0x2010, 0x2015), (0x2018, 0x2022), (0x2026, 0x2026), (0x2030, 0x2033), (0x2039, 0x203A),
    (0x2070, 0x208E), (0x20AC, 0x20AC), (0x2103, 0x2103), (0x2116, 0x2116), (0x2122, 0x2122), (0x2126, 0x2126), (0x212E, 0x212E),
    (0x2150, 0x215E), (0x2190, 0x2195), (0x2205, 0x2206), (0x2212, 0x2213), (0x221A, 0x221A), (0x221E, 0x2220), (0x2248, 0x2248),
    (0x2260, 0x2265), (0x2300, 0x2300), (0x25A0, 0x25A1), (0x25CA, 0x25CB), (0x2713, 0x2714),
]


def outlines(source):
    options = subset.Options(layout_features=["kern", "liga"], layout_scripts=["latn"], hinting=False, legacy_kern=False,
                             name_IDs=[0, 1, 2, 13, 14], notdef_outline=True)
    options.drop_tables += ["GDEF", "kern", "FFTM", "gasp", "MATH"]
    font = subset.load_font(source, options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(unicodes=[code for first, last in KEPT for code in range(first, last + 1)])
    subsetter.subset(font)
    # Marking software fills by the even-odd rule, under which overlaps would become holes.
    removeOverlaps(font)
    subset.save_font(font, "DejaVuSans-subset.ttf", options)


# Accents round x = 0, with y = 0 where the letter ends.
ABOVE = {
    0x300: [[(-3, 7), (1, 3)]],
    0x301: [[(3, 7), (-1, 3)]],
    0x302: [[(-4, 3), (0, 7), (4, 3)]],
    0x303: [[(-5, 3), (-3, 5), (-1, 5), (1, 4), (3, 4), (5, 6)]],
    0x304: [[(-4, 4), (4, 4)]],
    0x306: [[(-4, 7), (-2, 4), (0, 3), (2, 4), (4, 7)]],
    0x307: [[(0, 5), (-1, 4), (0, 3), (1, 4), (0, 5)]],
    0x308: [[(-4, 5), (-5, 4), (-4, 3), (-3, 4), (-4, 5)], [(4, 5), (3, 4), (4, 3), (5, 4), (4, 5)]],
    0x30A: [[(0, 8), (-2, 7), (-3, 5), (-2, 3), (0, 2), (2, 3), (3, 5), (2, 7), (0, 8)]],
    0x30B: [[(-1, 7), (-4, 3)], [(5, 7), (2, 3)]],
    0x30C: [[(-4, 7), (0, 3), (4, 7)]],
}
BELOW = {
    0x326: [[(0, -3), (0, -5), (-2, -7)]],
    0x327: [[(0, 0), (0, -2), (2, -3), (2, -5), (0, -6), (-2, -6)]],
    0x328: [[(2, 0), (0, -2), (0, -4), (1, -5), (3, -5)]],
}
CIRCLE = [(0, 4), (3, 3), (4, 0), (3, -3), (0, -4), (-3, -3), (-4, 0), (-3, 3), (0, 4)]


def moved(strokes, x, y):
    return [[(a + x, b + y) for a, b in stroke] for stroke in strokes]


def strokes():
    hershey = HersheyFonts()
    hershey.load_default_font("futural")
    font = {}
    for letter, glyph in hershey.all_glyphs.items():
        left = glyph._HersheyGlyph__left_side
        advance = glyph._HersheyGlyph__right_side - left
        font[ord(letter)] = (advance, [[(x - left, 9 - y) for x, y in stroke] for stroke in glyph.strokes if len(stroke) > 1])
    top = lambda glyph: max(y for stroke in glyph[1] for _, y in stroke)
    sign = lambda advance, strokes: (advance, strokes)
    dotless = (font[ord("i")][0], [stroke for stroke in font[ord("i")][1] if top((0, [stroke])) <= 14])
    font[0x131] = dotless
    letter_o, small_o, small_u = font[ord("O")], font[ord("o")], font[ord("u")]
    slash = lambda glyph, low, high: (glyph[0], glyph[1] + [[(2, low), (glyph[0] - 2, high)]])
    font[0xD8] = font[0x2300] = font[0x2205] = slash(letter_o, -2, 23)
    font[0xF8] = slash(small_o, -2, 16)
    left = min(x for stroke in small_u[1] for x, _ in stroke)
    font[0xB5] = font[0x3BC] = (small_u[0], small_u[1] + [[(left, 5), (left, -7)]])
    font[0xB0] = sign(14, moved([CIRCLE], 7, 17))
    font[0xB1] = sign(26, [[(13, 19), (13, 5)], [(4, 12), (22, 12)], [(4, 1), (22, 1)]])
    font[0xB7] = sign(10, [[(5, 10), (4, 9), (5, 8), (6, 9), (5, 10)]])
    font[0xD7] = sign(22, [[(4, 16), (18, 2)], [(18, 16), (4, 2)]])
    font[0xF7] = sign(26, [[(4, 9), (22, 9)], [(13, 17), (12, 16), (13, 15), (14, 16), (13, 17)],
                           [(13, 3), (12, 2), (13, 1), (14, 2), (13, 3)]])
    font[0xDF] = sign(19, [[(4, 0), (4, 16), (5, 19), (8, 21), (11, 21), (14, 19), (14, 16), (13, 14), (10, 12), (13, 11),
                            (15, 8), (15, 4), (14, 1), (11, 0), (9, 0)]])
    font[0x2126] = font[0x3A9] = sign(22, [[(3, 0), (8, 0), (8, 3), (5, 6), (3, 10), (3, 14), (5, 18), (8, 21), (14, 21),
                                            (17, 18), (19, 14), (19, 10), (17, 6), (14, 3), (14, 0), (19, 0)]])
    font[0x20AC] = sign(20, [[(18, 18), (15, 21), (11, 21), (8, 19), (6, 16), (5, 12), (5, 9), (6, 5), (8, 2), (11, 0),
                              (15, 0), (18, 3)], [(2, 12), (14, 12)], [(2, 9), (13, 9)]])
    for code, of in [(0x2212, "-"), (0x2013, "-"), (0x2010, "-"), (0x2011, "-"), (0x2018, "'"), (0x2019, "'"), (0xA0, " "),
                     (0x201C, '"'), (0x201D, '"'), (0x2009, " "), (0x202F, " ")]:
        font[code] = font[ord(of)]
    font[0x2014] = sign(32, [[(4, 9), (28, 9)]])
    for code, of in [(0xB9, "1"), (0xB2, "2"), (0xB3, "3")]:
        advance, lines = font[ord(of)]
        font[code] = sign(round(advance * 0.6), [[(round(x * 0.6), round(y * 0.6 + 10)) for x, y in line] for line in lines])
    for code in list(range(0xC0, 0x180)) + list(range(0x218, 0x21C)) + [0x1E9E]:
        parts = unicodedata.decomposition(chr(code)).split()
        if code in font or len(parts) != 2 or parts[0].startswith("<"):
            continue
        base, accent = (int(part, 16) for part in parts)
        if base not in font or (accent not in ABOVE and accent not in BELOW):
            continue
        advance, lines = dotless if base == ord("i") and accent in ABOVE else font[base]
        xs = [x for line in lines for x, _ in line]
        middle = round((min(xs) + max(xs)) / 2)
        mark = moved(ABOVE[accent], middle, top((0, lines))) if accent in ABOVE else moved(BELOW[accent], middle, 0)
        font[code] = sign(advance, lines + mark)
    with open("hershey-simplex.txt", "w", newline="\n") as out:
        for code in sorted(font):
            advance, lines = font[code]
            words = [f"{code:04X}", str(advance)] + [" ".join(f"{x},{y}" for x, y in line) for line in lines]
            out.write(";".join(words) + "\n")


if __name__ == "__main__":
    outlines(sys.argv[1])
    strokes()
