"""What is wrong is stated with what to do about it, and nothing is left behind."""

import json
import os
import subprocess
import sys
import unittest
from pathlib import Path
from unittest import mock

import bpy
import numpy as np

import bench
from bench import Can, Mouse, SceneTest, addon


def script(folder, text, name="isomark"):
    """A program for tests: a shell script."""
    path = Path(folder) / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


class Programs(SceneTest):
    def test_a_wrong_path_is_named_with_a_remedy(self):
        wrong = str(self.folder / "not-there")
        trouble = self.trouble(addon("program").find, wrong)
        self.assertIn(wrong, trouble.what)
        self.assertIn("preferences", trouble.remedy)
        self.preferences.program = wrong
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        with self.assertRaisesRegex(RuntimeError, "not-there"):
            bpy.ops.isomark.show()
        self.assertIn("not-there", json.loads(self.settings.outcome)["what"])
        with self.assertRaisesRegex(RuntimeError, "not-there"):
            bpy.ops.isomark.test()

    @unittest.skipIf(os.name == "nt", "a script is no program there")
    def test_the_program_is_found_in_the_stated_order(self):
        find = addon("program").find
        places = [script(self.folder / name, "") for name in self.folders("preference", "variable", "path", "usual")]
        with mock.patch.dict(os.environ, {"ISOMARK": places[1], "PATH": os.path.dirname(places[2])}), \
                mock.patch.object(addon("program"), "_usual_folders", lambda: [os.path.dirname(places[3])]):
            self.assertEqual(find(places[0]), places[0])
            self.assertEqual(find(os.path.dirname(places[0])), places[0])
            self.assertEqual(find(), places[1])
            del os.environ["ISOMARK"]
            self.assertEqual(find(), places[2])
            os.environ["PATH"] = str(self.folder)
            self.assertEqual(find(), places[3])
            os.remove(places[3])
            self.trouble(find)
            os.environ["ISOMARK"] = "nowhere"
            self.assertIn("ISOMARK", self.trouble(find).what)

    def folders(self, *names):
        for name in names:
            (self.folder / name).mkdir()
        return names

    def test_the_test_button_shows_the_version(self):
        self.assertEqual(bpy.ops.isomark.test(), {"FINISHED"})
        stated = subprocess.run([bench.ISOMARK, "--version"], capture_output=True, text=True, check=True).stdout.strip()
        self.assertEqual(addon("session").version, f"{stated} ({bench.ISOMARK})")

    @unittest.skipIf(os.name == "nt", "a script is no program there")
    def test_another_program_and_an_old_isomark_are_recognised(self):
        self.preferences.program = script(self.folder, "echo frobnicator 2.0")
        with self.assertRaisesRegex(RuntimeError, "does not answer like isomark"):
            bpy.ops.isomark.test()
        # What isomark 0.1.0 answered before it had this option.
        old = {"schema": "isomark.reason/1", "code": "usage", "what": "Unexpected argument '--on-part' found.",
               "remedy": "To pass '--on-part' as a value, use '-- --on-part'."}
        self.preferences.program = script(self.folder, f"cat <<'E'\n{json.dumps(old)}\nE\nexit 2")
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        with self.assertRaisesRegex(RuntimeError, "too old.*Install the newest isomark"):
            bpy.ops.isomark.show()

    @unittest.skipIf(os.name == "nt", "a script is no program there")
    def test_a_program_that_hangs_is_ended_and_leaves_no_process(self):
        program = addon("program")
        marker = self.folder / "pid"
        child = program.Child(script(self.folder, f"echo $$ > {marker}\nexec sleep 600"), [], 0.5)
        bench.until(lambda: marker.is_file() and marker.read_text().strip())
        self.trouble(child.wait)
        self.assertRaises(ProcessLookupError, os.kill, int(marker.read_text()), 0)
        marker.unlink()
        child = program.Child(str(self.folder / "isomark"), [], 600)
        bench.until(lambda: marker.is_file() and marker.read_text().strip())
        program.end_all()
        self.assertRaises(ProcessLookupError, os.kill, int(marker.read_text()), 0)

    @unittest.skipIf(os.name == "nt", "a script is no program there")
    def test_libraries_of_the_host_are_hidden_from_the_program(self):
        with mock.patch.dict(os.environ, {"LD_LIBRARY_PATH": "/host", "PYTHONHOME": "/host", "KEPT": "yes"}):
            child = addon("program").Child(script(self.folder, "echo $LD_LIBRARY_PATH-$PYTHONHOME-$KEPT"), [], 30)
            self.assertEqual(child.wait().out.strip(), "--yes")


class Inputs(SceneTest):
    def test_nothing_selected_is_stated(self):
        with self.assertRaisesRegex(RuntimeError, "Nothing is selected.*Select the part"):
            bpy.ops.isomark.use_selected()
        self.assertIn("Use Selected", self.trouble(addon("session").Export, bpy.context).remedy)
        self.use(Can().part(), [])
        self.assertIn("no drawing", self.trouble(addon("session").Export, bpy.context).what)

    def test_selected_objects_are_used_by_their_kind(self):
        part = Can().part()
        items = bench.drawings(Can.frame_matrix)
        frame = bench.frame_at(Can.frame_matrix)
        for item in (part, frame, *items):
            item.select_set(True)
        self.assertEqual(bpy.ops.isomark.use_selected(), {"FINISHED"})
        self.assertEqual((self.settings.part, self.settings.frame), (part, frame))
        self.assertEqual({entry.item for entry in self.settings.drawings}, set(items))
        Mouse().part().select_set(True)
        with self.assertRaisesRegex(RuntimeError, "Several meshes.*Can, Mouse"):
            bpy.ops.isomark.use_selected()

    def test_an_instance_of_a_collection_is_neither_part_nor_frame(self):
        part = Can().part()
        library = bpy.data.collections.new("library")
        library.objects.link(part)
        bpy.context.scene.collection.objects.unlink(part)
        instance = bpy.data.objects.new("Instance", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", library
        bpy.context.scene.collection.objects.link(instance)
        bpy.context.view_layer.update()
        instance.select_set(True)
        with self.assertRaisesRegex(RuntimeError, "Instance shows a collection.*Make Instances Real"):
            bpy.ops.isomark.use_selected()
        self.assertIsNone(self.settings.frame)

    def test_a_drawing_beside_the_part_is_refused_and_no_mark_is_shown(self):
        can = Can()
        items = bench.drawings(can.frame_matrix)
        part, frame = can.part(), bench.frame_at(can.frame_matrix)
        self.use(part, items, frame)
        bpy.ops.isomark.show()
        self.assertIn("isomark", bpy.data.objects)
        for item in items:
            item.matrix_world = can.frame_matrix @ bench.Matrix.Translation((90, 0, 0))
        bpy.context.view_layer.update()
        with self.assertRaises(RuntimeError):
            bpy.ops.isomark.show()
        outcome = json.loads(self.settings.outcome)
        self.assertTrue(outcome["what"])
        # What a person can do in Blender, not an option of the command line.
        self.assertIn("Move the drawing or the frame", outcome["remedy"])
        self.assertNotIn("--", outcome["remedy"])
        self.assertNotIn("isomark", bpy.data.objects)

    def test_a_hidden_object_is_pointed_out(self):
        mouse = Mouse()
        part, items, frame = mouse.part(), bench.drawings(mouse.frame_matrix), bench.frame_at(mouse.frame_matrix)
        self.use(part, items, frame)
        for item in (part, items[1], frame):
            item.hide_set(True)
            trouble = self.trouble(addon("session").Export, bpy.context)
            self.assertEqual((trouble.what.split(",")[0], trouble.remedy),
                             (f"The object {item.name} is hidden", "Show it with its eye in the Outliner."))
            item.hide_set(False)
        bpy.data.scenes["Scene"].collection.objects.unlink(part)
        self.assertIn("not in this scene", self.trouble(addon("session").Export, bpy.context).what)

    def test_an_unsaved_file_works(self):
        self.assertFalse(bpy.data.is_saved)
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        self.assertEqual(bpy.ops.isomark.show(), {"FINISHED"})

    def test_a_mirrored_or_flat_frame_is_refused(self):
        drawing = addon("drawing")
        frame = bench.frame_at(bench.Matrix.Diagonal((1, 1, -1, 1)))
        bpy.context.view_layer.update()
        self.assertIn("negative", self.trouble(drawing.frame_of, frame, bpy.context).what)
        frame.matrix_world = bench.Matrix.Diagonal((1, 0, 1, 1))
        bpy.context.view_layer.update()
        self.assertIn("scale 0", self.trouble(drawing.frame_of, frame, bpy.context).what)

    def test_a_part_must_have_faces_and_a_size(self):
        bpy.ops.object.empty_add()
        read = addon("part").read
        self.assertIn("no faces", self.trouble(read, bpy.context.object, None, bpy.context).what)
        mesh = bpy.data.objects.new("Points", bpy.data.meshes.new("Points"))
        bpy.context.scene.collection.objects.link(mesh)
        bpy.context.view_layer.update()
        self.assertIn("no faces", self.trouble(read, mesh, None, bpy.context).what)
        can = Can().part()
        bpy.context.scene.unit_settings.scale_length = 1.0
        self.assertIn("Unit Scale", self.trouble(read, can, None, bpy.context).remedy)

    def test_modifiers_are_applied_to_the_part_and_lower_levels_are_pointed_out(self):
        bpy.ops.mesh.primitive_cube_add(size=40)
        cube = bench.named("Cube")
        modifier = cube.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels, modifier.render_levels = 3, 3
        read = addon("part").read(cube, None, bpy.context)
        self.assertEqual((read.triangles, read.notices), (6 * 4 ** 3 * 2, []))
        modifier.render_levels = 5
        bpy.context.view_layer.update()
        notice, = addon("part").read(cube, None, bpy.context).notices
        self.assertIn("3 levels in the view and 5 in renders", notice)

    def test_a_mirrored_part_keeps_its_faces_outside(self):
        can = Can().part()
        can.scale, can.location = (-1.5, 1, 2), (5, 0, 0)
        bpy.context.view_layer.update()
        path = self.folder / "can.glb"
        path.write_bytes(addon("part").read(can, None, bpy.context).glb)
        facts = self.inspect(path)
        for size, expected in zip(facts["size_mm"], (99, 66, 220)):
            self.assertAlmostEqual(size, expected, delta=0.05)
        self.assertNotIn("triangles-reversed", [notice["code"] for notice in facts["notices"]])

    def inspect(self, path):
        """What isomark reads in a file."""
        ended = subprocess.run([bench.ISOMARK, "inspect", str(path), "--json"], capture_output=True, check=True)
        return json.loads(ended.stdout)

    def test_materials_keep_their_names_in_the_part(self):
        can = Can().part()
        for name in ("body", "mark"):
            can.data.materials.append(bpy.data.materials.new(name))
        for polygon in can.data.polygons:
            polygon.material_index = int(abs(polygon.normal.z) < 0.5)
        path = self.folder / "can.glb"
        path.write_bytes(addon("part").read(can, None, bpy.context).glb)
        self.assertEqual(sorted(self.inspect(path)["materials"]), ["body", "mark"])

    def test_materials_of_geometry_nodes_and_of_the_object_are_those_of_the_part(self):
        can, path = Can().part(), self.folder / "can.glb"
        group, begin, end = bench.node_group(can)
        paint = group.nodes.new("GeometryNodeSetMaterial")
        paint.inputs["Material"].default_value = bpy.data.materials.new("mark")
        group.links.new(begin.outputs[0], paint.inputs[0])
        group.links.new(paint.outputs[0], end.inputs[0])
        bpy.context.view_layer.update()
        path.write_bytes(addon("part").read(can, None, bpy.context).glb)
        self.assertEqual(self.inspect(path)["materials"], ["mark"])
        can.modifiers.clear()
        can.data.materials.append(bpy.data.materials.new("body"))
        can.material_slots[0].link = "OBJECT"
        can.material_slots[0].material = bpy.data.materials.new("shell")
        bpy.context.view_layer.update()
        path.write_bytes(addon("part").read(can, None, bpy.context).glb)
        self.assertEqual(self.inspect(path)["materials"], ["shell"])

    def test_what_a_drawing_shows_beyond_its_lines_is_pointed_out(self):
        bpy.ops.curve.primitive_bezier_circle_add(radius=5)
        circle = bench.named("Circle")
        circle.data.bevel_depth = 1
        circle.modifiers.new("Array", "ARRAY")
        bpy.ops.object.text_add(location=(0, 0, 3))
        text = bench.named("Text")
        bpy.context.view_layer.update()
        read = addon("drawing").read([circle, text], addon("drawing").frame_of(None, bpy.context), bpy.context)
        self.assertEqual(len([notice for notice in read.notices if "Circle" in notice]), 2)
        self.assertIn("3.00 mm off the plane", " ".join(read.notices))
        mouse = Mouse().part()
        read_mesh = addon("drawing").read
        self.assertIn("Convert", self.trouble(read_mesh, [mouse], addon("drawing").frame_of(None, bpy.context), bpy.context).remedy)


class Folders(SceneTest):
    def test_a_missing_or_read_only_hot_folder_is_stated(self):
        station = addon("station")
        self.assertIn("preferences", self.trouble(station.at).remedy)
        self.assertIn("no hot folder", self.trouble(station.at, "", str(self.folder / "gone")).what)
        self.assertIn("Cannot read", self.trouble(station.at, str(self.folder / "gone.toml")).what)
        # The superuser may write everywhere but into the system's own file systems.
        hot = Path("/sys") if os.name != "nt" and os.geteuid() == 0 else self.folder
        if hot == self.folder:
            hot.chmod(0o555)
            self.addCleanup(hot.chmod, 0o755)
        if os.name != "nt":
            trouble = self.trouble(station.put, hot, [("can.dxf", b"")])
            self.assertIn(f"Cannot write to the hot folder {hot}", trouble.what)
            self.assertIn("permission", trouble.remedy)

    def test_the_folders_of_a_station_are_read_with_and_without_a_reader_of_toml(self):
        station = addon("station")
        text = ("[station]\nname = 'hot = wrong'\n# comment\n[folders]\nhot = \"in\\\\box\" # here\nreports='C:\\r'\n"
                "keep = 3\n[field]\nhot = \"no\"\n")
        expected = {"hot": "in\\box", "reports": "C:\\r"}
        self.assertEqual(station._plain_folders(text), expected)
        if sys.version_info >= (3, 11):
            self.assertEqual(station._folders(text), expected)

    def test_names_are_accepted_by_every_file_system(self):
        plain = addon("station").plain_name
        for text, expected in (("Can 1", "Can 1"), ("a/b:c", "a_b_c"), ("..", "x"), ("", "x"), ("-a", "_-a"),
                               ("con", "_con"), ("COM1.x", "_COM1.x"), ("Gro\u0308ße", "Größe"), ("a@b. ", "a_b"),
                               ("x" * 300, "x" * 80), ("日" * 300, "日" * 32), ("(" + "x" * 300, "_(" + "x" * 78)):
            self.assertEqual(plain(text, "x"), expected)
        # Names that are as long as possible can be sent.
        name = plain("語" * 200, "x")
        addon("station").put(self.folder, [(f"{name}@{name}.dxf", b"whole")])
        self.assertEqual((self.folder / f"{name}@{name}.dxf").read_bytes(), b"whole")


class Files(SceneTest):
    def test_a_damaged_mark_is_stated_and_never_more(self):
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        bpy.ops.isomark.show()
        whole = (Path(addon("session")._folder) / "on-part.glb").read_bytes()
        read, random = addon("glb").read_on_part, np.random.default_rng(3)
        self.assertGreater(len(read(whole).mark), 0)
        for length in range(0, 3000, 149):
            self.trouble(read, whole[:length])
        text = int.from_bytes(whole[12:16], "little")
        for _ in range(60):
            broken = bytearray(whole)
            broken[random.integers(20, 20 + text)] = random.integers(256)
            try:
                read(bytes(broken))
            except addon("trouble").Trouble:
                pass

    def test_another_reader_accepts_the_drawing(self):
        try:
            import ezdxf
            from ezdxf.lldxf.encoding import decode_dxf_unicode
        except ImportError:
            self.skipTest("ezdxf is not installed")
        items = bench.drawings(bench.Matrix.Identity(4))
        items[0].name = "Größe/1|日本"
        read = addon("drawing").read(items, addon("drawing").frame_of(None, bpy.context), bpy.context)
        path = self.folder / "drawing.dxf"
        path.write_bytes(addon("dxf").write(read.paths))
        document = ezdxf.readfile(path)
        audit = document.audit()
        self.assertEqual((audit.errors, audit.fixes, document.units), ([], [], 4))
        found = [(decode_dxf_unicode(entity.dxf.layer), entity.closed, np.array(entity.get_points("xy"))) for entity in document.modelspace()]
        self.assertEqual(len(found), len(read.paths))
        for (layer, closed, points), path in zip(found, read.paths):
            self.assertEqual((layer, closed), (path.layer, path.closed))
            self.assertLess(np.abs(points - np.array(path.points)).max(), 1e-6)
        self.assertIn("Größe_1_日本", {layer for layer, _, _ in found})

    def test_a_file_with_a_mark_opens_without_the_add_on(self):
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        self.settings.show_ink = self.settings.show_uncorrected = True
        bpy.ops.isomark.show()
        on_part = addon("glb").read_on_part((Path(addon("session")._folder) / "on-part.glb").read_bytes())
        names = [name for name, field in addon("mark").PARTS[:3] if getattr(on_part, field)]
        self.assertEqual(len(names), 2 + on_part.facts["ink_shown"])
        path = str(self.folder / "scene.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.preferences.addon_disable(module=bench.MODULE)
        self.assertFalse(hasattr(bpy.types.Scene, "isomark"))
        bpy.ops.wm.open_mainfile(filepath=path)
        for name in names:
            data = bpy.data.objects[name].data
            self.assertTrue(len(getattr(data, "splines", ())) or len(getattr(data, "polygons", ())), name)
        bpy.ops.preferences.addon_enable(module=bench.MODULE)
        bpy.context.preferences.addons[bench.MODULE].preferences.program = bench.ISOMARK
        self.assertIn("after_mm", json.loads(self.settings.outcome))
        bpy.ops.isomark.show()
        self.assertEqual(len([item for item in bpy.data.objects if item.name.startswith("isomark")]), len(names))
        bpy.ops.isomark.clear()
        self.assertFalse([item for item in bpy.data.objects if item.name.startswith("isomark")])

    def test_the_mark_is_shown_in_colours_or_plain(self):
        mouse = Mouse()
        self.use(mouse.part(), bench.drawings(mouse.frame_matrix))
        self.settings.show_uncorrected = True
        bpy.ops.isomark.show()
        uncorrected = bpy.data.objects["isomark uncorrected"].data
        self.assertGreater(len(uncorrected.materials), 1)
        self.settings.coloured = False
        self.assertEqual([material.name for material in uncorrected.materials], ["isomark drawn"])
        self.settings.show_uncorrected = False
        self.assertEqual(len(uncorrected.splines), 0)

    def test_live_follows_the_drawing_and_ends_with_the_switch(self):
        live, mouse = addon("live"), Mouse()
        items = bench.drawings(mouse.frame_matrix)
        self.use(mouse.part(), items)
        manager = bpy.context.window_manager
        manager.isomark_live = True
        self.assertTrue(bpy.app.timers.is_registered(live._tick))

        def outcome():
            live._tick()
            return self.settings.outcome
        first = bench.until(outcome)
        items[0].data.body = "Größer"
        bpy.context.view_layer.update()
        second = bench.until(lambda: outcome() != first and self.settings.outcome)
        self.assertGreater(json.loads(second)["length_mm"], json.loads(first)["length_mm"])
        # The new mark is no reason to correct again.
        for _ in range(4):
            live._tick()
        self.assertIsNone(live._current)
        manager.isomark_live = False
        self.assertFalse(bpy.app.timers.is_registered(live._tick))
