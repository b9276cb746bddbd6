"""Makes the GLB files of this folder: python3 make.py with CadQuery 2.8 or build123d 0.13 (those that are installed).

Each is a block from (0, 0, 0) to (60, 40, 25) in CAD; the placed ones are turned by 30 degrees about Z, or about Y, and moved
by (5, 0, 10) then.
"""

try:
    import cadquery

    block = cadquery.Workplane().box(60, 40, 25, centered=False)
    cadquery.Assembly(block, name="block").export("cadquery.glb")
    place = cadquery.Location((5, 0, 10), (0, 0, 1), 30)
    cadquery.Assembly(block, name="block", loc=place).export("cadquery-placed.glb")
    added = cadquery.Assembly(name="all")
    added.add(block, name="block", loc=place)
    added.export("cadquery-added.glb")
except ImportError:
    pass

try:
    from build123d import Align, Box, Pos, Rot, export_gltf

    block = Box(60, 40, 25, align=(Align.MIN, Align.MIN, Align.MIN))
    export_gltf(Pos(5, 0, 10) * block, "build123d-moved.glb", binary=True)
    export_gltf(Pos(5, 0, 10) * Rot(0, 0, 30) * block, "build123d-placed.glb", binary=True)
    export_gltf(Pos(5, 0, 10) * Rot(0, 30, 0) * block, "build123d-tilted.glb", binary=True)
except ImportError:
    pass
