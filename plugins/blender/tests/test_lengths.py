"""Curves, texts and strokes come out with the lengths that were drawn, judged on the formula of the part."""

import json
from pathlib import Path

import bpy
import numpy as np

import bench
from bench import Can, Mouse, SceneTest, addon

# The sum of the length errors that is accepted, mm.
LIMIT_MM = 0.1


class Lengths(SceneTest):
    def check(self, shape):
        part, frame = shape.part(), bench.frame_at(shape.frame_matrix)
        items = bench.drawings(shape.frame_matrix)
        self.use(part, items, frame)
        self.assertEqual(bpy.ops.isomark.show(), {"FINISHED"})

        outcome = json.loads(self.settings.outcome)
        self.assertLess(outcome["after_mm"], LIMIT_MM)
        self.assertGreater(outcome["before_mm"], 1.0)
        steep = [text for text in outcome["warnings"] if text.startswith("the beam hits the part")]
        self.assertEqual(outcome["warnings"], steep)

        folder = Path(addon("session")._folder)
        drawn = bench.polylines(next(folder.glob("*.dxf")))
        corrected = bench.polylines(folder / "out" / "corrected.dxf")
        self.assertEqual([path[:2] for path in drawn], [path[:2] for path in corrected])
        for item in items:
            own = sum(bench.length(points, closed) for layer, closed, points in drawn if layer == item.name)
            self.assertAlmostEqual(own, bench.drawn_length(item), delta=0.01, msg=item.name)
        marked = [bench.length_on_surface(shape, points, closed, shape.frame_matrix) for _, closed, points in corrected]
        errors = [abs(bench.length(points, closed) - on_part) for (_, closed, points), on_part in zip(drawn, marked)]
        self.assertLess(sum(errors), LIMIT_MM)
        flat = sum(bench.length(points, closed) for _, closed, points in corrected)
        self.assertGreater(sum(marked) - flat, 1.0, "the part is not curved enough to prove anything")
        self.check_shown(shape, sum(marked))

    def check_shown(self, shape, marked):
        """The curves in the scene are on the surface and have the marked length."""
        item = bpy.data.objects["isomark"]
        self.assertTrue(item.show_in_front and item.hide_select)
        self.assertEqual(item.matrix_world, bench.Matrix.Identity(4))
        total = 0.0
        for spline in item.data.splines:
            points = np.array([point.co[:3] for point in spline.points])
            self.assertLess(np.abs(shape.distance(points)).max(), 0.06)
            total += bench.length(points)
        self.assertAlmostEqual(total, marked, delta=0.005 * marked)

    def test_a_can_gets_the_drawn_lengths(self):
        self.check(Can())

    def test_a_mouse_gets_the_drawn_lengths(self):
        self.check(Mouse())

    def test_a_part_in_metres_with_scale_and_modifier_gets_the_drawn_lengths(self):
        bpy.context.scene.unit_settings.scale_length = 1.0
        bpy.ops.mesh.primitive_cylinder_add(vertices=256, radius=0.0165, depth=0.110)
        part = bench.named("Can")
        part.scale = (-2, 2, 1)
        part.modifiers.new("Triangulate", "TRIANGULATE")
        matrix = Can.frame_matrix.copy()
        matrix.translation /= 1000
        frame = bench.frame_at(matrix @ bench.Matrix.Diagonal((3, 3, 3, 1)))
        bpy.ops.curve.primitive_bezier_circle_add(radius=0.012)
        circle = bench.named("Circle")
        circle.matrix_world = matrix
        self.use(part, [circle], frame)
        self.assertEqual(bpy.ops.isomark.show(), {"FINISHED"})
        corrected = bench.polylines(Path(addon("session")._folder) / "out" / "corrected.dxf")
        (_, closed, points), = corrected
        marked = bench.length_on_surface(Can(), points, closed, Can.frame_matrix)
        self.assertAlmostEqual(marked, bench.drawn_length(circle) * 1000, delta=LIMIT_MM)

    def test_a_frame_from_the_cursor_points_out_of_the_part(self):
        self.settings.part = Can().part()
        bpy.context.scene.cursor.location = (0.5, -60, 12)
        self.assertEqual(bpy.ops.isomark.add_frame(), {"FINISHED"})
        bpy.context.view_layer.update()
        found = np.array(self.settings.frame.matrix_world)
        # Half of a facet is 0.7 degrees, and its middle 0.003 mm inside.
        self.assertLess(np.abs(found[:3, :3] - np.array(Can.frame_matrix)[:3, :3]).max(), 0.03)
        self.assertLess(abs(Can().distance(found[None, :3, 3])[0]), 0.01)
        self.assertAlmostEqual(found[2, 3], 12, places=3)

    def test_drawings_are_laid_on_the_frame(self):
        frame = bench.frame_at(Can.frame_matrix)
        bpy.ops.object.text_add(location=(7, 8, 9))
        text = bench.named("Text")
        text.scale = (2, 2, 2)
        self.use(Can().part(), [text], frame)
        self.assertEqual(bpy.ops.isomark.lay_on_frame(), {"FINISHED"})
        bpy.context.view_layer.update()
        expected = np.array(Can.frame_matrix) @ np.diag([2, 2, 2, 1])
        self.assertLess(np.abs(np.array(text.matrix_world) - expected).max(), 1e-5)


class Splines(SceneTest):
    def test_every_kind_of_nurbs_is_drawn_as_blender_draws_it(self):
        curves, random = addon("curves"), np.random.default_rng(7)
        kinds = [(order, count, closed, clamped, piecewise)
                 for order in (2, 3, 4, 6) for count in (4, 6, 7, 10) if count >= order
                 for closed in (False, True) for clamped in (False, True) for piecewise in (False, True)]
        for kind in kinds:
            order, count, closed, clamped, piecewise = kind
            control = random.uniform(-10, 10, (count, 2))
            weights = random.uniform(0.5, 2, count)
            data = bpy.data.curves.new("Nurbs", "CURVE")
            data.dimensions = "3D"
            spline = data.splines.new("NURBS")
            spline.points.add(count - 1)
            values = np.column_stack([control, np.zeros(count), weights])
            spline.points.foreach_set("co", values.ravel().astype(np.float32))
            spline.order_u, spline.resolution_u = order, 64
            spline.use_cyclic_u, spline.use_endpoint_u, spline.use_bezier_u = closed, clamped, piecewise
            item = bpy.data.objects.new("Nurbs", data)
            bpy.context.scene.collection.objects.link(item)
            evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
            mesh = evaluated.to_mesh()
            blenders = np.array([vertex.co[:2] for vertex in mesh.vertices])
            evaluated.to_mesh_clear()
            bpy.data.objects.remove(item)

            ours = curves.nurbs(control, weights, order, closed, clamped, piecewise)
            ring = np.vstack([ours, ours[:1]]) if closed else ours
            self.assertLess(bench.off(ring, blenders).max(), 0.002, kind)
            # Blender's steps of equal parameters cut corners, so its length is up to 1 % less.
            theirs = bench.length(blenders, closed)
            self.assertLess(theirs, bench.length(ours, closed) * 1.001, kind)
            self.assertGreater(theirs, bench.length(ours, closed) * 0.98, kind)

    def test_a_bezier_curve_is_as_long_as_its_formula(self):
        # A parabola y = x² / 4 from 0 to 8 as a cubic; its length in closed form.
        control = np.array([[0.0, 0.0], [8 / 3, 0.0], [16 / 3, 16 / 3], [8.0, 16.0]])
        knots, lefts, rights = control[[0, 3]], control[[0, 2]], control[[1, 3]]
        points = addon("curves").bezier(knots, lefts, rights, False)
        slope = 4.0
        exact = slope * np.sqrt(1 + slope ** 2) + np.arcsinh(slope)
        self.assertAlmostEqual(bench.length(points), exact, delta=0.001)
        self.assertEqual(len(addon("curves").bezier(knots, knots, knots, False)), 2, "a straight line has two points")
