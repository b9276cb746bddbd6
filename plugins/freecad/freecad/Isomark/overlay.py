# SPDX-License-Identifier: MIT OR Apache-2.0
"""Draws the mark over the part in a 3-D view, without an object in the document."""

import FreeCADGui
from pivy import coin

#: The nodes of isomark's file that are lines, with the width of their lines in pixels.
LINES = {"mark": 3.0, "drawn": 2.0, "view": 1.0}
INK = "mark-ink"


class Overlay:
    """The mark in all 3-D views of a document; `close` removes it."""

    def __init__(self, document):
        self._document = document
        self._scenes = []
        self._root = coin.SoSeparator()
        self._root.setName("isomark")
        pick = coin.SoPickStyle()
        pick.style = coin.SoPickStyle.UNPICKABLE
        light = coin.SoLightModel()
        light.model = coin.SoLightModel.BASE_COLOR
        # The triangles that FreeCAD shows are not exactly on the surface: lines win within a small depth.
        depth = coin.SoDepthBuffer()
        depth.range = (0.0, 0.998)
        self._switches = {name: coin.SoSwitch() for name in (INK, "view", "drawn", "mark")}
        for node in [pick, light, depth] + list(self._switches.values()):
            self._root.addChild(node)
        self.attach()

    def attach(self):
        """Draws in views that were opened since, too."""
        for view in FreeCADGui.getDocument(self._document).mdiViewsOfType("Gui::View3DInventor"):
            scene = view.getSceneGraph()
            if scene.findChild(self._root) < 0:
                scene.addChild(self._root)
                self._scenes.append(scene)

    def show(self, mark):
        """Replaces what is drawn by the `glb.MarkOnPart`."""
        for name, switch in self._switches.items():
            switch.removeAllChildren()
            if name == INK:
                switch.addChild(_triangles(mark.meshes.get(name, [])))
            else:
                # Wide lines would close the gaps of a code.
                width = 1.0 if mark.meshes.get(INK) else LINES[name]
                switch.addChild(_lines(mark.strips.get(name, []), width))

    def set_visible(self, name, visible):
        """Shows or hides one of the nodes of isomark's file."""
        self._switches[name].whichChild = coin.SO_SWITCH_ALL if visible else coin.SO_SWITCH_NONE

    def clear(self):
        for switch in self._switches.values():
            switch.removeAllChildren()

    def close(self):
        for scene in self._scenes:
            scene.removeChild(self._root)
        self._scenes = []


def _lines(strips, width):
    node = coin.SoSeparator()
    if not strips:
        return node
    style = coin.SoDrawStyle()
    style.lineWidth = width
    node.addChild(style)
    points = [point for strip in strips for point in strip.points]
    colours = [colour for strip in strips for colour in strip.colours]
    property_of = coin.SoVertexProperty()
    property_of.vertex.setValues(0, len(points), points)
    packed = [coin.SbColor(*colour).getPackedValue() for colour in colours]
    property_of.orderedRGBA.setValues(0, len(packed), packed)
    property_of.materialBinding = coin.SoVertexProperty.PER_VERTEX
    lines = coin.SoLineSet()
    lines.vertexProperty = property_of
    lines.numVertices.setValues(0, len(strips), [len(strip.points) for strip in strips])
    node.addChild(lines)
    return node


def _triangles(meshes):
    node = coin.SoSeparator()
    colour = coin.SoBaseColor()
    colour.rgb = (0.1, 0.1, 0.1)
    node.addChild(colour)
    for mesh in meshes:
        points = coin.SoCoordinate3()
        points.point.setValues(0, len(mesh.points), mesh.points)
        indices = [index for triangle in mesh.triangles for index in triangle + (-1,)]
        faces = coin.SoIndexedFaceSet()
        faces.coordIndex.setValues(0, len(indices), indices)
        node.addChild(points)
        node.addChild(faces)
    return node
