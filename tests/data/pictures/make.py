"""Makes the pictures of this folder: `pip install pillow pypng ezdxf`, `apt install librsvg2-bin`, `python make.py`.

Nothing of isomark is used. librsvg draws `letters.png` from the outlines of ../patterns/abc.dxf, 24 pixels per mm. The
other files show the same asymmetric figure, written by pypng and Pillow in all the ways in which files differ.
"""

import io
import struct
import subprocess
import zlib

import ezdxf
import png
from PIL import Image

# Letters: 39 x 13 mm with a border of 0.5 mm, so 40 x 14 mm on 960 x 336 pixels.
WIDTH, HEIGHT, DOTS_PER_MM = 40.0, 14.0, 24
document = ezdxf.readfile("../patterns/abc.dxf")
paths = []
for entity in document.modelspace().query("LWPOLYLINE"):
    assert entity.closed and not entity.has_arc
    corners = " L ".join(f"{x + WIDTH / 2:.6f} {HEIGHT / 2 - y:.6f}" for x, y in entity.get_points("xy"))
    paths.append(f"M {corners} Z")
svg = (
    f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH * DOTS_PER_MM:.0f}" height="{HEIGHT * DOTS_PER_MM:.0f}" '
    f'viewBox="0 0 {WIDTH} {HEIGHT}"><path fill-rule="evenodd" d="{" ".join(paths)}"/></svg>'
)
drawn = subprocess.run(["rsvg-convert", "-b", "white"], input=svg.encode(), capture_output=True, check=True).stdout
Image.open(io.BytesIO(drawn)).convert("L").save("letters.png", dpi=(DOTS_PER_MM * 25.4,) * 2, optimize=True)

# The figure: an F with a foot, 12 x 9 pixels, each drawn 2 x 2. Every rotation and mirror image looks different.
FIGURE = [
    "............",
    ".#########..",
    ".##.........",
    ".##.........",
    ".######.....",
    ".##.........",
    ".##.........",
    ".##......##.",
    "............",
]
rows = [[dot == "#" for dot in row for _ in range(2)] for row in FIGURE for _ in range(2)]
width, height = len(rows[0]), len(rows)


def pypng(name, writer, values, physical=True):
    """Rows of flattened pixels; `values` gives the samples of a dark and of a light pixel."""
    dark, light = values
    with open(name, "wb") as file:
        if physical:
            writer.x_pixels_per_unit = writer.y_pixels_per_unit = 11811
            writer.unit_is_meter = True
        if writer.interlace:
            flat = [sample for row in rows for dot in row for sample in (dark if dot else light)]
            writer.write_array(file, flat)
        else:
            writer.write(file, [[sample for dot in row for sample in (dark if dot else light)] for row in rows])


def writer(**options):
    return png.Writer(width, height, **options)


pypng("grey-1.png", writer(greyscale=True, bitdepth=1), [(0,), (1,)])
pypng("grey-4.png", writer(greyscale=True, bitdepth=4), [(2,), (14,)])
pypng("grey-16.png", writer(greyscale=True, bitdepth=16), [(300,), (65000,)])
pypng("grey-alpha.png", writer(greyscale=True, alpha=True), [(0, 255), (0, 0)])
pypng("grey-alpha-16.png", writer(greyscale=True, alpha=True, bitdepth=16), [(0, 65535), (0, 0)])
pypng("rgb-16.png", writer(greyscale=False, bitdepth=16), [(0, 0, 65535), (65535, 65535, 0)])
pypng("rgba.png", writer(greyscale=False, alpha=True), [(200, 0, 0, 255), (200, 0, 0, 0)])
pypng("interlaced.png", writer(greyscale=True, interlace=True), [(0,), (255,)])
pypng("palette-2.png", writer(palette=[(255, 255, 255), (20, 20, 90), (0, 0, 0)], bitdepth=2), [(1,), (0,)])
pypng("palette-transparent.png", writer(palette=[(0, 0, 0, 0), (0, 0, 0, 255)]), [(1,), (0,)])
pypng("transparent-grey.png", writer(greyscale=True, transparent=7), [(0,), (7,)])
pypng("no-size.png", writer(greyscale=True), [(0,), (255,)], physical=False)
pypng("white-on-transparent.png", writer(greyscale=True, alpha=True), [(255, 255), (255, 0)])

grey = Image.new("L", (width, height))
grey.putdata([0 if dot else 255 for row in rows for dot in row])
dpi = (300, 300)
grey.save("grey.png", dpi=dpi)
grey.save("grey.bmp", dpi=dpi)
grey.convert("1").save("one-bit.bmp", dpi=dpi)
grey.convert("RGB").save("rgb.bmp", dpi=dpi)
grey.convert("P").save("palette.bmp", dpi=dpi)
grey.save("no-size.bmp", dpi=(0, 0))
# Rotated 90 degrees counter-clockwise, marked to be rotated back (Exif orientation 6).
exif = Image.Exif()
exif[0x0112] = 6
grey.rotate(90, expand=True).save("exif-turned.png", dpi=dpi, exif=exif)
# Mirrored, and marked so (Exif orientation 2).
exif[0x0112] = 2
grey.transpose(Image.Transpose.FLIP_LEFT_RIGHT).save("exif-mirrored.png", dpi=dpi, exif=exif)

# Pixels twice as high as wide, stated in a pHYs chunk without a unit: every other row is omitted.
def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

lines = b"".join(b"\0" + bytes(0 if dot else 255 for dot in row) for row in rows[::2])
with open("pixels-not-square.png", "wb") as file:
    file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height // 2, 8, 0, 0, 0, 0)))
    file.write(chunk(b"pHYs", struct.pack(">IIB", 2, 1, 0)) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))
# A small file that expands to 60,000 x 60,000 pixels.
with open("bomb.png", "wb") as file:
    data = zlib.compress(bytes(1 << 20))
    file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 60000, 60000, 8, 0, 0, 0, 0)))
    file.write(chunk(b"IDAT", data) + chunk(b"IEND", b""))

# Shades of grey as in a photograph: a ramp from black to white.
ramp = Image.linear_gradient("L").resize((64, 64))
ramp.save("shades.png", dpi=dpi)
Image.new("L", (20, 20), 255).save("all-white.png", dpi=dpi)
Image.new("L", (20, 20), 0).save("all-black.png", dpi=dpi)
