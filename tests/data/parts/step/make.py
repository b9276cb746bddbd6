"""Writes the STEP files of this folder with OpenCASCADE (cadquery-ocp 8.0 from PyPI): python3 make.py"""
import os
from math import pi

from OCP.BRepBuilderAPI import (BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire,
                                BRepBuilderAPI_NurbsConvert)
from OCP.BRepPrimAPI import (BRepPrimAPI_MakeCone, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakePrism, BRepPrimAPI_MakeRevol,
                             BRepPrimAPI_MakeSphere, BRepPrimAPI_MakeTorus)
from OCP.GC import GC_MakeArcOfCircle
from OCP.Geom import Geom_Ellipse, Geom_OffsetSurface, Geom_SurfaceOfRevolution, Geom_TrimmedCurve
from OCP.Interface import Interface_Static
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFDoc import XCAFDoc_DocumentTool
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Elips, gp_Pnt, gp_Trsf, gp_Vec

HERE = os.path.dirname(os.path.abspath(__file__))


def write(name, shape, unit="MM", schema="AP214IS"):
    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.schema", schema)
    Interface_Static.SetCVal_s("write.step.unit", unit)
    writer.Transfer(shape, STEPControl_AsIs)
    writer.Write(os.path.join(HERE, name))


AXES = gp_Ax2(gp_Pnt(5, -3, 2), gp_Dir(0.3, 0.4, 1.2), gp_Dir(1, 0, 0))
write("ball.step", BRepPrimAPI_MakeSphere(AXES, 20).Shape())
write("ball-inch.step", BRepPrimAPI_MakeSphere(AXES, 20).Shape(), "INCH", "AP203")
write("ball-m.step", BRepPrimAPI_MakeSphere(AXES, 20).Shape(), "M", "AP242DIS")
write("ring.step", BRepPrimAPI_MakeTorus(AXES, 30, 10).Shape())
write("ring-spline.step", BRepBuilderAPI_NurbsConvert(BRepPrimAPI_MakeTorus(AXES, 30, 10).Shape()).Shape())
write("cone.step", BRepPrimAPI_MakeCone(AXES, 20, 0, 40).Shape())
write("roll-inch.step", BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0, 50, 7), gp_Dir(0, -1, 0)), 25, 100).Shape(), "INCH")

ellipse = gp_Elips(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 1, 0), gp_Dir(1, 0, 0)), 30, 12)
wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(ellipse).Edge()).Wire()
write("oval.step", BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(wire).Face(), gp_Vec(0, 60, 0)).Shape())

# An egg: half an ellipse turned about its long axis.
half = gp_Elips(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1), gp_Dir(1, 0, 0)), 30, 20)
arc = BRepBuilderAPI_MakeEdge(half, 0, pi).Edge()
chord = BRepBuilderAPI_MakeEdge(gp_Pnt(-30, 0, 0), gp_Pnt(30, 0, 0)).Edge()
face = BRepBuilderAPI_MakeFace(BRepBuilderAPI_MakeWire(arc, chord).Wire()).Face()
write("egg.step", BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0))).Shape())

# A barrel and an apple: both sides of a circle that crosses the axis about which it is turned.
RADIUS, OFF = 50, 20
for name, off in (("barrel.step", -OFF), ("apple.step", OFF)):
    height = 20
    side = off + (RADIUS**2 - height**2) ** 0.5
    at = [gp_Pnt(side, 0, -height), gp_Pnt(off + RADIUS, 0, 0), gp_Pnt(side, 0, height), gp_Pnt(0, 0, height), gp_Pnt(0, 0, -height)]
    edges = [BRepBuilderAPI_MakeEdge(GC_MakeArcOfCircle(*at[:3]).Value()).Edge()]
    edges += [BRepBuilderAPI_MakeEdge(*pair).Edge() for pair in ((at[2], at[3]), (at[3], at[4]), (at[4], at[0]))]
    face = BRepBuilderAPI_MakeFace(BRepBuilderAPI_MakeWire(*edges).Wire()).Face()
    write(name, BRepPrimAPI_MakeRevol(face, gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1))).Shape())

# A roll on a sled on a table: two products in products, each with its own placement.
doc = TDocStd_Document(TCollection_ExtendedString("step"))
tool = XCAFDoc_DocumentTool.ShapeTool_s(doc.Main())
roll = tool.AddShape(BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), 10, 40).Shape(), False)
TDataStd_Name.Set_s(roll, TCollection_ExtendedString("Roll"))
sled = tool.NewShape()
TDataStd_Name.Set_s(sled, TCollection_ExtendedString("Sled"))
table = tool.NewShape()
TDataStd_Name.Set_s(table, TCollection_ExtendedString("Table"))
turn = gp_Trsf()
turn.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)), pi / 2)
tool.AddComponent(sled, roll, TopLoc_Location(turn))
for x in (0.0, 50.0):
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(x, 20, 3))
    tool.AddComponent(table, sled, TopLoc_Location(move))
tool.UpdateAssemblies()
writer = STEPCAFControl_Writer()
Interface_Static.SetCVal_s("write.step.schema", "AP214IS")
Interface_Static.SetCVal_s("write.step.unit", "MM")
writer.Transfer(doc, STEPControl_AsIs)
writer.Write(os.path.join(HERE, "table.step"))

# A cap that is an offset of the egg, a kind of surface that is not read.
egg = Geom_SurfaceOfRevolution(Geom_TrimmedCurve(Geom_Ellipse(half), 1.2, 1.9), gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)))
write("offset.step", BRepBuilderAPI_MakeFace(Geom_OffsetSurface(egg, 5.0), 0.0, 3.0, 1.2, 1.9, 1e-6).Face())
