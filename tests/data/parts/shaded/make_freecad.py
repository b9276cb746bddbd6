"""Makes the FreeCAD samples of this folder: freecadcmd make_freecad.py </dev/null (FreeCAD 0.20)."""

import FreeCAD
import MeshPart
import Part

box = Part.makeBox(50, 50, 30, FreeCAD.Vector(-25, -25, 0))
top = [edge for edge in box.Edges if all(vertex.Point.z == 30 for vertex in edge.Vertexes)]
for name, edges, deflection, angle in (("fc020-fillets.obj", box.Edges, 1.0, 0.5), ("fc020-top-fillets.stl", top, 0.1, 0.523)):
    shape = box.makeFillet(5, edges)
    MeshPart.meshFromShape(Shape=shape, LinearDeflection=deflection, AngularDeflection=angle).write(name)
