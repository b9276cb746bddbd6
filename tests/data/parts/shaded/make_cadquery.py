"""Makes the samples of Open CASCADE in this folder; its GLB files have the normals of the model: python3 make_cadquery.py (CadQuery 2.8)."""

import cadquery
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.Message import Message_ProgressRange
from OCP.RWGltf import RWGltf_CafWriter
from OCP.RWMesh import RWMesh_CoordinateSystem
from OCP.StlAPI import StlAPI_Writer
from OCP.TCollection import TCollection_AsciiString, TCollection_ExtendedString
from OCP.TColStd import TColStd_IndexedDataMapOfStringString
from OCP.TDocStd import TDocStd_Document
from OCP.XCAFDoc import XCAFDoc_DocumentTool


def export(part, name, deflection, angle=0.5):
    """Cuts a part in mm into facets of at most these deviations, mm and rad."""
    shape = part.val().wrapped
    BRepMesh_IncrementalMesh(shape, deflection, False, angle, False)
    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).AddShape(shape, True, True)
    writer = RWGltf_CafWriter(TCollection_AsciiString(name), True)
    system = writer.ChangeCoordinateSystemConverter()
    system.SetInputLengthUnit(0.001)
    system.SetInputCoordinateSystem(RWMesh_CoordinateSystem.RWMesh_CoordinateSystem_Zup)
    writer.Perform(document, TColStd_IndexedDataMapOfStringString(), Message_ProgressRange())


can = cadquery.Workplane("YZ", origin=(-30, 0, 0)).circle(12.5).extrude(60).edges().fillet(0.5)
export(can, "occ-can-fillet-0.5.glb", 0.1)
disc = cadquery.Workplane().circle(33.8).extrude(10.9).faces(">Z").edges().fillet(0.3)
export(disc, "occ-disc-fillet-0.3.glb", 0.5)
box = cadquery.Workplane().box(70, 50, 40).faces(">Z").edges().fillet(6)
BRepMesh_IncrementalMesh(box.val().wrapped, 0.1, False, 0.5, False)
writer = StlAPI_Writer()
writer.ASCIIMode = False
writer.Write(box.val().wrapped, "occ-top-fillets-6.stl")

# Both halves of a mould draw such a part: it has a draft of 1 degree on both sides of its parting line.


def drafted(outline):
    return outline().extrude(30, taper=1).union(outline().extrude(-30, taper=1))


box = drafted(lambda: cadquery.Workplane("YZ").sketch().rect(40, 30).vertices().fillet(4).finalize())
export(box, "occ-drafted-box.glb", 0.1)
export(drafted(lambda: cadquery.Workplane("YZ").circle(20)), "occ-drafted-can.glb", 0.1)
