"""What is marked is what the view shows, judged on the geometry that Blender itself evaluates."""

import bpy
import numpy as np
from mathutils import Matrix

import bench
from bench import SceneTest, addon

# Modifiers that move points, with settings under which they do.
MODIFIERS = {"CAST": {"cast_type": "CUBOID", "factor": 0.6}, "SIMPLE_DEFORM": {"deform_method": "BEND", "deform_axis": "Z", "angle": 0.8}, "WARP": {},
             "LATTICE": {}, "CURVE": {"deform_axis": "POS_X"}, "SHRINKWRAP": {}, "WAVE": {"height": 3, "width": 3, "time_offset": -20},
             "SMOOTH": {"iterations": 200}}


def evaluated(item):
    """What the view shows of an object, and the mesh of that."""
    shown = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return shown, shown.to_mesh()


def seen(item):
    """The points that the view shows of an object, in the world."""
    shown, mesh = evaluated(item)
    points = np.array([shown.matrix_world @ vertex.co for vertex in mesh.vertices])
    shown.to_mesh_clear()
    return points


def read(*items):
    """What the add-on reads of objects in the plane of the world."""
    drawing = addon("drawing")
    return drawing.read(list(items), drawing.frame_of(None, bpy.context), bpy.context)


def lines(drawing):
    """The polylines of what was read."""
    points = [np.array(path.points) for path in drawing.paths]
    return [np.vstack([one, one[:1]]) if path.closed else one for path, one in zip(drawing.paths, points)]


def link(name, data=None):
    """A new object in the scene."""
    item = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(item)
    return item


class Edited(SceneTest):
    def test_a_curve_in_edit_mode_is_read_as_the_view_shows_it(self):
        for add in (bpy.ops.curve.primitive_bezier_circle_add, bpy.ops.curve.primitive_nurbs_path_add):
            add(radius=5)
            item = bench.named("Curve")
            item.data.resolution_u = 64
            twin = link("Twin", item.data)
            bpy.ops.object.mode_set(mode="EDIT")
            bpy.ops.curve.select_all(action="SELECT")
            for step in ((3, 0, 0), (0, 4, 0), (0, 0.5, 0)):
                bpy.ops.transform.translate(value=step)
                for one in (item, twin):
                    # As a window does, long before somebody presses Show.
                    points = seen(one)
                    line, = lines(read(one))
                    self.assertLess(bench.off(line, points[:, :2]).max(), 0.01, (one.name, step))
            bpy.ops.object.mode_set(mode="OBJECT")

    def test_a_frame_that_was_just_moved_is_read_where_it_is(self):
        frame = bench.frame_at(Matrix.Identity(4))
        bpy.context.view_layer.update()
        frame.location.x = 7
        self.assertEqual(addon("drawing").frame_of(frame, bpy.context).origin.tolist(), [7, 0, 0])


class Modified(SceneTest):
    def drawing(self):
        """A Bezier circle of 10 mm, off the origin."""
        bpy.ops.curve.primitive_bezier_circle_add(radius=5, location=(2, 3, 0))
        return bench.named("Circle")

    def modify(self, item, kind):
        """Adds a modifier; returns it."""
        modifier = item.modifiers.new(f"the {kind}", kind)
        for name, value in MODIFIERS[kind].items():
            setattr(modifier, name, value)
        if kind == "WARP":
            modifier.object_from, modifier.object_to, modifier.falloff_radius = link("From"), link("To"), 20
            modifier.object_to.location = (4, 1, 0)
        elif kind == "LATTICE":
            modifier.object = link("Lattice", bpy.data.lattices.new("Lattice"))
            modifier.object.scale = (40, 40, 40)
            for point in modifier.object.data.points:
                point.co_deform.x += 0.1 * (point.co_deform.y > 0)
        elif kind == "CURVE":
            modifier.object = self.drawing()
        elif kind == "SHRINKWRAP":
            bpy.ops.mesh.primitive_cylinder_add(radius=3, depth=9)
            modifier.target = bpy.context.object
        bpy.context.view_layer.update()
        return modifier

    def check(self, item, tolerance, factor=1.0):
        """Every point that the view shows is on a line that is read, and the length is that of the view."""
        points, drawing = seen(item)[:, :2], read(item)
        distances = np.min([bench.off(line, points) for line in lines(drawing)], axis=0)
        self.assertLess(distances.max(), tolerance, [modifier.name for modifier in item.modifiers])
        return drawing

    def test_modifiers_that_move_points_are_applied_as_the_view_shows_them(self):
        for kind in MODIFIERS:
            item = self.drawing()
            before = seen(item)
            modifier = self.modify(item, kind)
            self.assertGreater(np.abs(seen(item) - before).max(), 0.5, f"{kind} moves nothing")
            drawing = self.check(item, 1e-5)
            self.assertIn(f"after the {kind},", " ".join(drawing.notices))
            modifier.use_apply_on_spline = True
            bpy.context.view_layer.update()
            drawing = self.check(item, 0.002)
            if kind != "SMOOTH":
                # The exact spline, and nothing to point out.
                self.assertGreater(len(drawing.paths[0].points), 100, kind)
                self.assertFalse([notice for notice in drawing.notices if kind in notice])

    def test_outlines_of_a_text_follow_its_modifiers(self):
        bpy.ops.object.text_add()
        text = bench.named("Text")
        text.data.body, text.data.size = "Größe 8", 9
        whole = sum(map(bench.length, lines(read(text))))
        text.modifiers.new("Array", "ARRAY")
        bpy.context.view_layer.update()
        twice = self.check(text, 1e-5)
        # The steps of the view are a little shorter than the curves.
        self.assertAlmostEqual(sum(map(bench.length, lines(twice))) / whole, 2, delta=0.01)
        text.modifiers.clear()
        modifier = self.modify(text, "SIMPLE_DEFORM")
        self.check(text, 1e-5)
        modifier.show_in_editmode = False
        bpy.ops.object.mode_set(mode="EDIT")
        self.assertEqual(self.check(text, 0.002).notices, [])

    def test_a_modifier_that_cannot_be_applied_is_named(self):
        item = self.drawing()
        self.modify(item, "CAST")
        item.data.bevel_depth = 1
        self.assertIn("the CAST is not applied, so the mark differs from the view", " ".join(read(item).notices))
        item.data.bevel_depth = 0
        group, begin, end = bench.node_group(item)
        point, instance = map(group.nodes.new, ("GeometryNodePoints", "GeometryNodeInstanceOnPoints"))
        group.links.new(point.outputs[0], instance.inputs["Points"])
        group.links.new(begin.outputs[0], instance.inputs["Instance"])
        group.links.new(instance.outputs[0], end.inputs[0])
        bpy.context.view_layer.update()
        notices = " ".join(read(item).notices)
        self.assertIn("the CAST, Nodes is not applied", notices)
        self.assertIn("instances are not marked", notices)
