"""Measures the drawings in this folder as resvg shows them, at 1200 pixels per inch: `python make.py` writes pixels.tsv.

Needs resvg-py, pillow and numpy. inkscape.dxf: `inkscape --export-type=dxf --export-filename=inkscape.dxf inkscape.svg`.
"""

import io
import pathlib

import numpy
import resvg_py
from PIL import Image

Image.MAX_IMAGE_PIXELS = None
here = pathlib.Path(__file__).parent
rows = ["# drawing, area in mm2 and its centroid in mm from the lower left corner"]
for file in sorted(here.glob("*.svg")):
    text = file.read_text()
    # resvg has other fonts, and the lines of Inkscape's drawing are only a few pixels wide: its export judges that one.
    if "<text" in text or file.stem == "inkscape":
        continue
    # resvg rounds pages up to whole pixels, so pages in mm get a size of 48 pixels per mm (1219 per inch).
    width, height = (60.0, 40.0) if 'width="60mm"' in text else (50.8, 25.4) if 'width="2in"' in text else (63.5, 160 * 25.4 / 96)
    text = text.replace('width="60mm" height="40mm"', 'width="2880" height="1920"')
    columns = 2880 if width == 60.0 else round(width / 25.4 * 1200)
    picture = Image.open(io.BytesIO(bytes(resvg_py.svg_to_bytes(svg_string=text, width=columns, dpi=96))))
    alpha = numpy.asarray(picture.convert("RGBA"))[:, :, 3] / 255.0
    pixel = width / alpha.shape[1]
    area = alpha.sum() * pixel**2
    cx = (alpha.sum(0) * (numpy.arange(alpha.shape[1]) + 0.5)).sum() * pixel**3 / area
    cy = height - (alpha.sum(1) * (numpy.arange(alpha.shape[0]) + 0.5)).sum() * pixel**3 / area
    rows.append(f"{file.stem}\t{area:.4f}\t{cx:.4f}\t{cy:.4f}")
(here / "pixels.tsv").write_text("\n".join(rows) + "\n")
