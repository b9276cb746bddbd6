"""Drawings by ezdxf, each with a line and one entity that isomark does not mark: `losses.py FOLDER`.

The name of the file states whether the entity is lost ink (`ink-…`) or not (`none-…`).
"""

import sys

import ezdxf
from ezdxf.render import forms

FOLDER = sys.argv[1]


def write(name, draw):
    doc = ezdxf.new("R2010", setup=True)
    doc.units = ezdxf.units.MM
    doc.layers.add("MARK")
    space = doc.modelspace()
    space.add_line((0, 0), (10, 0), dxfattribs={"layer": "MARK"})
    draw(doc, space, {"layer": "MARK"})
    doc.saveas(f"{FOLDER}/{name}.dxf")


def image(doc, space, look):
    picture = doc.add_image_def(filename="logo.png", size_in_pixel=(64, 64))
    space.add_image(picture, insert=(0, 0), size_in_units=(5, 5), dxfattribs=look)


def underlay(doc, space, look):
    definition = doc.add_underlay_def(filename="plan.pdf", fmt="pdf", name="1")
    space.add_underlay(definition, insert=(0, 0), dxfattribs=look)


def missing_block(doc, space, look):
    doc.blocks.new("GONE").add_circle((0, 0), 1)
    space.add_blockref("GONE", (0, 0), dxfattribs=look)
    doc.blocks.delete_block("GONE", safe=False)


def hidden(state):
    def draw(doc, space, look):
        getattr(doc.layers.add("ASIDE"), state)()
        space.add_text("株", dxfattribs={"layer": "ASIDE", "height": 3})

    return draw


def not_plotted(doc, space, look):
    doc.layers.add("ASIDE").dxf.plot = 0
    space.add_3dface([(0, 0), (1, 0), (1, 1)], dxfattribs={"layer": "ASIDE"})


def in_block(layer):
    def draw(doc, space, look):
        doc.layers.add("ASIDE").off()
        doc.blocks.new("B").add_3dface([(0, 0), (1, 0), (1, 1)], dxfattribs={"layer": layer})
        space.add_blockref("B", (0, 0), dxfattribs=look)

    return draw


def mesh(doc, space, look):
    forms.cube().render_mesh(space, dxfattribs=look)


def polyface(doc, space, look):
    forms.cube().render_polyface(space, dxfattribs=look)


write("ink-text", lambda doc, space, look: space.add_text("LOT 株", dxfattribs={**look, "height": 3}))
write("ink-mtext", lambda doc, space, look: space.add_mtext("LOT {\\H2x;株}", dxfattribs=look))
write("ink-face", lambda doc, space, look: space.add_3dface([(0, 0), (1, 0), (1, 1)], dxfattribs=look))
write("ink-mesh", mesh)
write("ink-polyface", polyface)
write("ink-leader", lambda doc, space, look: space.add_leader([(0, 0), (5, 5), (9, 5)], dxfattribs=look))
write("ink-mline", lambda doc, space, look: space.add_mline([(0, 0), (5, 5)], dxfattribs=look))
write("ink-image", image)
write("ink-underlay", underlay)
write("ink-wipeout", lambda doc, space, look: space.add_wipeout([(0, 0), (5, 5)], dxfattribs=look))
write("ink-block", missing_block)
write("ink-in-block", in_block("0"))
write("none-ray", lambda doc, space, look: space.add_ray((0, 0), (1, 0), dxfattribs=look))
write("none-xline", lambda doc, space, look: space.add_xline((0, 0), (1, 0), dxfattribs=look))
write("none-point-line", lambda doc, space, look: space.add_lwpolyline([(3, 3)], dxfattribs=look))
write("none-attdef", lambda doc, space, look: space.add_attdef("TAG", (0, 0), "X", dxfattribs=look))
write("none-blank", lambda doc, space, look: space.add_text("  ", dxfattribs={**look, "height": 3}))
write("none-off", hidden("off"))
write("none-frozen", hidden("freeze"))
write("none-not-plotted", not_plotted)
write("none-in-block", in_block("ASIDE"))
write("none-paper", lambda doc, space, look: doc.layout("Layout1").add_3dface([(0, 0), (1, 0), (1, 1)]))
