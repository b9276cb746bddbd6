"""Round parts with a drilled hole of D4 or a boss of D4, as FreeCAD writes them: freecadcmd make.py"""

import Part
from FreeCAD import Vector

rod = Part.makeCylinder(25, 80, Vector(0, 0, 0), Vector(1, 0, 0))
hole = Part.makeCylinder(2, 60, Vector(40, 0, 0), Vector(0, 0, 1))
bore = Part.makeCylinder(20, 80, Vector(0, 0, 0), Vector(1, 0, 0))
boss = Part.makeCylinder(2, 15, Vector(40, 0, 15), Vector(0, 0, 1))
rod.cut(hole).exportStep("hole.step")
rod.cut(bore).cut(hole).exportStep("tube.step")
rod.fuse(boss).exportStep("boss.step")
drill = Part.makeCylinder(2, 60, Vector(0, 0, 0), Vector(0, 0, 1))
Part.makeSphere(40).cut(drill).exportStep("ball.step")
