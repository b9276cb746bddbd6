"""What is marked is what the view shows, judged on the geometry that Blender itself evaluates."""

import json
from unittest import mock

import bpy
import numpy as np
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree

import bench
from bench import Can, Mouse, SceneTest, addon

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

    def test_live_does_not_take_its_own_reading_for_an_edit(self):
        live, mouse = addon("live"), Mouse()
        part, items = mouse.part(), bench.drawings(mouse.frame_matrix)
        self.use(part, items)
        bpy.context.view_layer.objects.active = items[1]
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.context.window_manager.isomark_live = True
        self.addCleanup(live.stop)
        bench.until(lambda: live._tick() and self.settings.outcome)
        for _ in range(3):
            live._tick()
        self.assertFalse(live._changed)

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

    def test_a_curve_has_a_body_only_if_the_view_shows_one(self):
        item, bevel = self.drawing(), self.drawing()
        self.modify(item, "CAST")
        data = item.data
        for mode in ("ROUND", "OBJECT", "PROFILE"):
            for data.extrude, data.bevel_depth in ((0, 0), (0, 1), (1, 0)):
                for data.bevel_object in (None, bevel):
                    data.bevel_mode = mode
                    bpy.context.view_layer.update()
                    shown, mesh = evaluated(item)
                    has_faces = len(mesh.polygons) > 0
                    shown.to_mesh_clear()
                    notices = " ".join(read(item).notices)
                    for sentence in ("bevel and extrusion are ignored", "Remove its bevel and extrusion"):
                        self.assertEqual(sentence in notices, has_faces, (mode, data.extrude, data.bevel_depth, data.bevel_object))

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


class Laid(SceneTest):
    def lay(self, *items):
        """Lays the drawing on the frame of the can."""
        self.use(None, items, bench.frame_at(Can.frame_matrix))
        self.assertEqual(bpy.ops.isomark.lay_on_frame(), {"FINISHED"})
        bpy.context.view_layer.update()

    def check(self, item, expected):
        """The object's matrix is `expected` in the axes of the frame."""
        difference = np.array(item.matrix_world) - np.array(Can.frame_matrix @ expected)
        self.assertLess(np.abs(difference).max(), 1e-4, item.name)

    def test_a_mirror_stays_a_mirror_and_is_not_turned(self):
        for scale in ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-2, 3, 1), (-1, -1, 1), (-1, -1, -1)):
            item = link("Text", bpy.data.curves.new("Text", "FONT"))
            item.rotation_euler, item.location, item.scale = (0.3, 0.4, 0.5), (7, 8, 9), scale
            for _ in range(2):
                self.lay(item)
                self.check(item, Matrix.Diagonal((*scale, 1)))
        # A matrix states no axis: what is mirrored as seen from above, or from the laser, stays so.
        item.matrix_world = Matrix.Diagonal((-1, 1, 1, 1))
        for _ in range(2):
            self.lay(item)
            self.check(item, Matrix.Diagonal((-1, 1, 1, 1)))

    def test_objects_keep_their_places_beside_the_first(self):
        first, child, above, tilted = (link(name, bpy.data.curves.new(name, "FONT")) for name in ("A", "B", "C", "D"))
        first.parent, child.parent = above, first
        above.location, above.rotation_euler = (50, 60, 70), (0, 0, 0.5)
        first.location, child.location, child.rotation_euler = (0, -15, -3), (4, 5, 3), (0, 0, 0.2)
        tilted.location, tilted.rotation_euler = (10, 20, 30), (1, 0, 0)
        for _ in range(2):
            self.lay(first, child, above, tilted)
            self.check(first, Matrix.Identity(4))
            self.check(child, Matrix.Translation((4, 5, 0)) @ Matrix.Rotation(0.2, 4, "Z"))
            self.check(above, Matrix.Translation((0, 15, 0)))
            self.check(tilted, Matrix.Identity(4))

    def test_an_object_that_is_held_or_has_no_axes_is_named(self):
        item = link("Held", bpy.data.curves.new("Held", "FONT"))
        item.constraints.new("LIMIT_LOCATION").use_max_z = True
        self.use(None, [item], bench.frame_at(Can.frame_matrix))
        # Blender gives the warnings of an operator to nobody but its window.
        operator = mock.Mock()
        addon("operators").IsomarkLayOnFrame.execute(operator, bpy.context)
        self.assertIn("Held. Remove what holds it", operator.report.call_args[0][1])
        item.constraints.clear()
        item.scale = (1, 1, 0)
        with self.assertRaisesRegex(RuntimeError, "Held has the scale 0"):
            bpy.ops.isomark.lay_on_frame()


class Parts(SceneTest):
    def test_instances_of_a_part_are_read_with_it(self):
        can = Can().part()
        group, begin, end = bench.node_group(can)
        kinds = ("Points", "InstanceOnPoints", "MeshCube", "JoinGeometry", "SetMaterial")
        point, instance, cube, join, paint = (group.nodes.new(f"GeometryNode{kind}") for kind in kinds)
        point.inputs["Position"].default_value = (4, -33, 16)
        cube.inputs["Size"].default_value = (20, 20, 20)
        paint.inputs["Material"].default_value = bpy.data.materials.new("mark")
        for source, target in ((point, instance.inputs["Points"]), (cube, paint.inputs[0]), (paint, instance.inputs["Instance"]),
                               (instance, join.inputs[0]), (begin, join.inputs[0]), (join, end.inputs[0])):
            group.links.new(source.outputs[0], target)
        can.location = (1, 2, 3)
        bpy.context.view_layer.update()
        part = addon("part")
        found = part.read(can, None, bpy.context)
        self.assertEqual(found.triangles, 256 * 2 + 254 * 2 + 12)
        self.assertIn(b'"name":"mark"', found.glb)
        place, normal = part.nearest(can, Vector((6, -90, 20)), bpy.context)
        self.assertLess(max((place - Vector((6, -41, 20))).length, (normal - Vector((0, -1, 0))).length), 1e-4)

    def test_a_surface_is_read_once(self):
        bpy.ops.surface.primitive_nurbs_surface_cylinder_add(radius=33)
        item = bench.named("Surface")
        shown, mesh = evaluated(item)
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        shown.to_mesh_clear()
        self.assertEqual(addon("part").read(item, None, bpy.context).triangles, count)

    def test_a_frame_is_put_at_the_nearest_point_of_a_stretched_or_mirrored_part(self):
        can = Can().part()
        self.settings.part = can
        for scale in ((4, 1, 1), (-4, 1, 1), (-1, -1, -1)):
            can.scale, can.rotation_euler = scale, (0, 0, 0.4)
            bpy.context.scene.cursor.location = (60 * abs(scale[0]), -60, 20)
            bpy.context.view_layer.update()
            points = seen(can)
            tree = BVHTree.FromPolygons(points.tolist(), [tuple(polygon.vertices) for polygon in can.data.polygons])
            place, _, _, distance = tree.find_nearest(bpy.context.scene.cursor.location)
            bpy.ops.isomark.add_frame()
            bpy.context.view_layer.update()
            found = self.settings.frame.matrix_world
            self.assertLess((found.translation - place).length, 1e-3, scale)
            towards = (bpy.context.scene.cursor.location - place) / distance
            self.assertGreater(found.col[2].to_3d().dot(towards), 0.99, scale)


class Followed(SceneTest):
    def shown(self):
        """A drawing on the mouse, with its mark shown."""
        mouse = Mouse()
        item, = bench.drawings(mouse.frame_matrix)[3:4]
        self.use(mouse.part(), [item], bench.frame_at(mouse.frame_matrix))
        bpy.ops.isomark.show()
        self.assertTrue(self.mark())
        return item

    def mark(self, scene=None):
        """The object that shows the mark."""
        return addon("mark").find(scene or bpy.context.scene, "mark")

    def test_a_missing_program_or_folder_and_the_time_limit_keep_the_mark(self):
        self.shown()
        live, session, right = addon("live"), addon("session"), self.preferences.program
        self.preferences.program = str(self.folder / "not-there")
        self.assertRaisesRegex(RuntimeError, "not-there", bpy.ops.isomark.show)
        self.assertTrue(self.mark())
        self.preferences.program = right
        session.end()
        with mock.patch.object(session.tempfile, "mkdtemp", side_effect=PermissionError(13, "Permission denied")):
            self.assertRaisesRegex(RuntimeError, "Cannot create a temporary folder: Permission denied", bpy.ops.isomark.show)
        with mock.patch.object(session, "_RUN_LIMIT_S", -1):
            self.assertRaisesRegex(RuntimeError, "did not finish", bpy.ops.isomark.show)
            self.assertTrue(self.mark())
            self.settings.outcome = ""
            bpy.context.window_manager.isomark_live = True
            self.addCleanup(live.stop)
            bench.until(lambda: live._tick() and self.settings.outcome)
            # The ended child is not asked again, and the button works.
            self.assertIsNone(session.run)
            self.assertTrue(live._tick())
        self.assertTrue(self.mark())

    def test_a_removed_mark_can_be_undone(self):
        self.shown()
        bpy.ops.ed.undo_push(message="shown")
        self.settings.drawings[0].item.hide_set(True)
        bpy.ops.ed.undo_push(message="hidden")
        with self.assertRaisesRegex(RuntimeError, "is hidden"):
            bpy.ops.isomark.show("EXEC_DEFAULT", True)
        self.assertIsNone(self.mark())
        bpy.ops.ed.undo()
        self.assertTrue(self.mark())
        # The step before this one is still there.
        self.assertFalse(self.settings.drawings[0].item.visible_get())

    def test_live_and_a_run_keep_to_the_scene_that_they_were_started_for(self):
        self.shown()
        live, session, first = addon("live"), addon("session"), bpy.context.scene
        second = bpy.data.scenes.new("Second")
        kept = bpy.data.objects.new("isomark", bpy.data.curves.new("isomark", "CURVE"))
        kept[addon("mark")._TAG] = "mark"
        second.collection.objects.link(kept)
        manager = bpy.context.window_manager
        first.isomark.outcome = ""
        manager.isomark_live = True
        self.addCleanup(live.stop)
        bench.until(lambda: live._tick() and live._current)
        bpy.context.window.scene = second
        self.assertFalse(manager.isomark_live)
        bench.until(lambda: live._tick() and first.isomark.outcome)
        self.assertIn("length_mm", json.loads(first.isomark.outcome))
        for _ in range(4):
            live._tick()
        self.assertEqual((self.mark(second), second.isomark.outcome), (kept, ""))
        bpy.context.window.scene = first
        self.assertTrue(manager.isomark_live)
        # A run by the button, too.
        addon("mark").clear(first)
        run = session.Run(bpy.context)
        bpy.context.window.scene = second
        bench.until(run.poll)
        run.finish()
        self.assertTrue(self.mark(first))
        self.assertEqual((len(kept.data.splines), second.isomark.outcome), (0, ""))
        # Live does not go on in another scene.
        run = session.Run(bpy.context, run.export)
        run._scene = "gone"
        self.assertIn("removed or renamed", self.trouble(run.finish).what)
        bpy.data.scenes.remove(first)
        self.assertIsNone(live._tick())
        self.assertEqual((live._scene, self.mark(second)), (None, kept))

    def test_live_notices_what_is_hidden(self):
        item, live = self.shown(), addon("live")
        box = bpy.data.collections.new("box")
        bpy.context.scene.collection.children.link(box)
        box.objects.link(item)
        bpy.context.scene.collection.objects.unlink(item)
        bpy.context.view_layer.update()
        shelf = bpy.context.view_layer.layer_collection.children["box"]
        hiders = [one.hide_set for one in (item, self.settings.frame, self.settings.part)]
        hiders.append(lambda is_hidden: setattr(shelf, "hide_viewport", is_hidden))
        bpy.context.window_manager.isomark_live = True
        self.addCleanup(live.stop)
        for hide in hiders:
            bench.until(lambda: live._tick() and live._current is None and self.mark())
            hide(True)
            bench.until(lambda: live._tick() and not self.mark())
            self.assertIn("is hidden", json.loads(self.settings.outcome)["what"])
            hide(False)

    def test_a_mark_goes_with_its_drawing_and_follows_the_unit_of_the_scene(self):
        live, mouse = addon("live"), Mouse()
        item, = bench.drawings(mouse.frame_matrix)[3:4]
        self.use(mouse.part(), [item])
        bpy.context.window_manager.isomark_live = True
        self.addCleanup(live.stop)

        def outcome():
            live._tick()
            return live._current is None and json.loads(self.settings.outcome or "{}")
        first = bench.until(outcome)
        bpy.context.scene.unit_settings.scale_length = 0.0015
        scaled = bench.until(lambda: (now := outcome()) and now != first and now)
        self.assertAlmostEqual(scaled["length_mm"], 1.5 * first["length_mm"], places=3)
        self.assertTrue(addon("mark").find(bpy.context.scene, "mark"))
        bpy.context.scene.collection.objects.unlink(item)
        bpy.context.view_layer.update()
        gone = bench.until(lambda: (now := outcome()) and "what" in now and now)
        self.assertIn("not in this scene", gone["what"])
        self.assertIsNone(addon("mark").find(bpy.context.scene, "mark"))
        bpy.context.scene.collection.objects.link(item)
        bpy.context.view_layer.update()
        again = bench.until(lambda: (now := outcome()) and "what" not in now and now)
        self.assertAlmostEqual(again["length_mm"], scaled["length_mm"], places=3)
        self.assertTrue(addon("mark").find(bpy.context.scene, "mark"))
        # The button leaves no old mark, either.
        self.settings.drawings.clear()
        with self.assertRaisesRegex(RuntimeError, "no drawing"):
            bpy.ops.isomark.show()
        self.assertIsNone(addon("mark").find(bpy.context.scene, "mark"))
