"""The sent files reach a running station, and its answer is shown where they were sent from."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest import mock

import bpy
import numpy as np

import bench
from bench import Can, SceneTest, addon

HERE = Path(__file__).resolve().parent


class Station:
    """The folders of a station, and the program while it runs."""

    def __init__(self, folder):
        self.folder = Path(folder)
        for name in ("hot", "import", "reports", "rejected"):
            (self.folder / name).mkdir()
        self.file = self.folder / "station.toml"
        self.file.write_text(bench.SETTINGS)
        self.running = None

    def start(self):
        """Starts it and waits until it runs."""
        with open(self.folder / "log.txt", "ab") as log:
            self.running = subprocess.Popen([bench.ISOMARK, "watch", str(self.file)], stdin=subprocess.DEVNULL,
                                            stdout=log, stderr=log)
        bench.until(lambda: self.state() == "running")

    def state(self):
        """The state in its status."""
        ended = subprocess.run([bench.ISOMARK, "status", str(self.file), "--json"], capture_output=True, check=False)
        return json.loads(ended.stdout).get("state")

    def stop(self):
        """Ends it."""
        if self.running:
            self.running.kill()
            self.running.wait()
            self.running = None


class Answers(SceneTest):
    def setUp(self):
        super().setUp()
        self.station = Station(self.folder)
        self.addCleanup(self.station.stop)
        self.can = Can()
        items = bench.drawings(self.can.frame_matrix)
        self.use(self.can.part(), items, bench.frame_at(self.can.frame_matrix))
        self.settings.sku, self.settings.name = "Can 1", "front"

    def send(self):
        """Sends, and returns the courier."""
        self.assertEqual(bpy.ops.isomark.send(), {"FINISHED"})
        return addon("session").courier

    def final(self, courier):
        """The final answer."""
        final = addon("station").FINAL
        return bench.until(lambda: courier.answer if courier.answer.kind in final else None)

    def test_a_delivered_drawing_has_the_drawn_lengths(self):
        self.station.start()
        answer = self.final(self.send())
        self.assertEqual((answer.kind, answer.what), ("delivered", "Delivered as Can 1@front.dxf."))
        self.assertLess(answer.report["quality"]["after"]["length_error_mm"], 0.1)
        # The report comes before the drop is filed.
        bench.until(lambda: not os.listdir(self.station.folder / "hot"))
        corrected = bench.polylines(self.station.folder / "import" / "Can 1@front.dxf")
        archived = bench.polylines(self.station.folder / "archive" / "can 1" / "Can 1@front.dxf")
        errors = [bench.length(points, closed)
                  - bench.length_on_surface(self.can, marked, closed, self.can.frame_matrix)
                  for (_, closed, points), (_, _, marked) in zip(archived, corrected)]
        self.assertEqual(len(corrected), len(archived))
        self.assertLess(sum(map(abs, errors)), 0.1)

    def test_a_side_in_the_settings_that_overrides_the_frame_is_pointed_out(self):
        (self.station.folder / "skus").mkdir()
        (self.station.folder / "skus" / "Can 1.toml").write_text('[part]\nfacing = "+y"\n')
        self.station.start()
        answer = self.final(self.send())
        self.assertEqual(answer.kind, "delivered", answer)
        self.assertIn("The frame was not used", answer.remedy)
        self.assertEqual(bpy.ops.isomark.show(), {"FINISHED"})
        self.assertIn("The frame was not used", json.loads(self.settings.outcome)["warnings"][0])

    def test_a_drawing_that_is_sent_again_is_reported_as_unchanged(self):
        self.station.start()
        self.final(self.send())
        answer = self.final(self.send())
        self.assertEqual(answer.kind, "delivered")
        self.assertIn("Can 1@front.dxf", answer.what)

    def test_a_drawing_that_left_without_a_report_is_not_called_delivered(self):
        courier = self.send()
        bench.until(lambda: courier.answer.kind == "waiting")
        courier.stop()

        def left(result, drop="Can 1@front.dxf"):
            return courier._left({"finished": [{"drop": "x.dxf", "result": "delivered"}, {"drop": drop, "result": result}]})
        self.assertEqual(left("repeated").kind, "delivered")
        for result, word in (("uncertain", "not known"), ("handed-over", "line"), ("new", "no report")):
            answer = left(result)
            self.assertEqual(answer.kind, "left")
            self.assertIn(word, answer.what)
            self.assertTrue(answer.remedy)
        for unknown in (left("repeated", "other.dxf"), courier._left(None), courier._left(self.trouble(addon("program").find, "x"))):
            self.assertEqual(unknown.kind, "left")
        # A station that hangs is not one that is stopped.
        silent = courier._waiting({"state": "silent", "station": "Laser 1"})
        self.assertIn("runs, but", silent.what)
        self.assertNotIn("isomark watch", silent.remedy)

    def test_a_rejected_drawing_shows_the_reason_and_the_remedy(self):
        self.station.start()
        bpy.ops.curve.primitive_bezier_circle_add(radius=2)
        beside = bench.named("Beside")
        beside.matrix_world = self.can.frame_matrix @ bench.Matrix.Translation((80, 0, 0))
        self.settings.drawings.add().item = beside
        bpy.context.view_layer.update()
        answer = self.final(self.send())
        self.assertEqual(answer.kind, "rejected")
        reason = json.loads((self.station.folder / "rejected" / "Can 1@front.dxf.reason.json").read_text())
        self.assertEqual(answer.what, f"Can 1@front.dxf was rejected: {reason['what']}")
        self.assertEqual(answer.remedy, reason["remedy"])
        # The same name is rejected again: its reason is in the folder (2).
        again = self.final(self.send())
        self.assertEqual(again.kind, "rejected")

    def test_a_drawing_waits_for_a_stopped_station_and_is_delivered_when_it_starts(self):
        self.station.start()
        self.station.stop()
        courier = self.send()
        waiting = bench.until(lambda: courier.answer if "not running" in courier.answer.what else None)
        self.assertEqual(waiting.kind, "waiting")
        self.assertIn(str(self.station.file), waiting.remedy)
        self.station.start()
        self.assertEqual(self.final(courier).kind, "delivered")

    def heights(self, name):
        """The lowest and the highest y of a delivered drawing: the height on the can in the field."""
        ys = np.concatenate([np.array(points)[:, 1] for _, _, points in bench.polylines(self.station.folder / "import" / name)])
        return ys.min(), ys.max()

    def move_up(self, distance):
        """Moves the frame and the drawing, mm."""
        for item in [self.settings.frame, *(entry.item for entry in self.settings.drawings)]:
            item.matrix_world = bench.Matrix.Translation((0, 0, distance)) @ item.matrix_world
        bpy.context.view_layer.update()

    def test_a_second_drawing_does_not_move_one_that_waits(self):
        first = self.send()
        bench.until(lambda: first.answer.kind == "waiting")
        first.stop()
        # The same frame again is no problem, and no frame or another one is.
        self.settings.name = "again"
        again = self.send()
        bench.until(lambda: again.answer.kind == "waiting")
        self.settings.name = "lower"
        self.move_up(-25)
        for frame in (self.settings.frame, None):
            self.settings.frame = frame
            answer = self.final(self.send())
            self.assertEqual(answer.kind, "failed", answer)
            self.assertIn("Can 1@", answer.what)
            self.assertIn("another SKU", answer.remedy)
        self.assertFalse((self.station.folder / "hot" / "Can 1@lower.dxf").exists())
        self.station.start()
        for name in ("front", "again"):
            bench.until(lambda: (self.station.folder / "reports" / "can 1" / f"Can 1@{name}.dxf.report.json").exists())
        self.assertEqual(self.heights("Can 1@front.dxf"), self.heights("Can 1@again.dxf"))

    def test_a_drawing_that_makes_others_outdated_asks_first(self):
        self.station.start()
        self.assertEqual(self.final(self.send()).kind, "delivered")
        before = self.heights("Can 1@front.dxf")
        self.settings.name = "lower"
        self.move_up(-25)
        answer = self.final(self.send())
        self.assertEqual(answer.kind, "asking", answer)
        self.assertIn("Can 1@front.dxf", answer.what)
        self.assertIn("again", answer.remedy)
        self.assertFalse((self.station.folder / "import" / "Can 1@lower.dxf").exists())
        answer = self.final(self.send())
        self.assertEqual((answer.kind, answer.remedy), ("delivered", ""), answer)
        after = self.heights("Can 1@lower.dxf")
        for one, other in zip(before, after):
            self.assertAlmostEqual(one - other, 25, delta=0.05)
        # The older drawing moved in the scene is the same drawing.
        self.settings.sku = "Can 2"
        self.assertEqual(self.final(self.send()).kind, "delivered")
        self.move_up(5)
        self.assertEqual(self.final(self.send()).kind, "delivered")

    def test_a_drawing_that_was_placed_with_another_frame_is_pointed_out(self):
        courier = self.send()
        bench.until(lambda: courier.answer.kind == "waiting")
        # Another program sends the part with another frame before the station looks.
        self.move_up(-25)
        addon("station").put(self.station.folder / "hot", addon("session").Export(bpy.context).files()[:1])
        self.station.start()
        answer = self.final(courier)
        self.assertEqual(answer.kind, "delivered", answer)
        self.assertIn("Do not mark it", answer.remedy)

    def test_a_station_that_never_answers_is_left_with_a_sentence(self):
        with mock.patch.object(addon("station"), "_GIVE_UP_S", 1.0):
            answer = self.final(self.send())
        self.assertEqual(answer.kind, "left")
        self.assertIn("no longer looks", answer.what)
        self.assertTrue(answer.remedy)

    def test_a_hot_folder_without_its_other_folders_is_enough_to_send(self):
        with tempfile.TemporaryDirectory() as folder:
            self.preferences.station, self.preferences.hot_folder = "", folder
            courier = self.send()
            answer = bench.until(lambda: courier.answer if courier.answer.kind == "sent" else None)
            self.assertIn("station's settings", answer.remedy)
            names = ["Can 1.glb", "Can 1@front.dxf", "Can 1@front.toml"]
            self.assertEqual(sorted(os.listdir(folder)), names)

    def test_a_hot_folder_that_is_missing_or_read_only_is_stated_in_the_panel(self):
        (self.station.folder / "hot").rmdir()
        answer = self.final(self.send())
        self.assertEqual(answer.kind, "failed")
        self.assertIn(str(self.station.folder / "hot"), answer.what)
        self.assertIn("preferences", answer.remedy)
        # The superuser may write everywhere but into the system's own file systems.
        if os.name != "nt":
            read_only = Path("/sys") if os.geteuid() == 0 else self.station.folder / "reports"
            if read_only != Path("/sys"):
                read_only.chmod(0o555)
            self.preferences.hot_folder = str(read_only)
            answer = self.final(self.send())
            self.assertEqual(answer.kind, "failed")
            self.assertIn("permission", answer.remedy)
            if read_only != Path("/sys"):
                read_only.chmod(0o755)

    def test_the_panel_shows_every_answer(self):
        answer, kinds = addon("station").Answer, addon("panel")._ANSWERS
        for kind in ("sending", "sent", "waiting", "delivered", "rejected", "failed", "asking", "left"):
            self.assertIn(answer(kind, "").kind, kinds)


class Kills(SceneTest):
    def test_a_host_that_is_killed_while_it_sends_leaves_only_whole_files(self):
        files = [("can.glb", b"part" * 50000), ("can@a.toml", b"[placement]\n"), ("can@a.dxf", b"  0\nEOF\n" * 4000)]
        kills = [(action, number) for action in ("write", "sync", "rename", "renamed") for number in (1, 2, 3)]
        seen = set()
        for action, number in kills:
            with tempfile.TemporaryDirectory() as folder:
                hot = Path(folder)
                for name, data in files:
                    (hot / f".{name}.source").write_bytes(data)
                ended = subprocess.run([python(), str(HERE / "killed.py"), addon("station").__file__, folder, action,
                                        str(number), *(name for name, _ in files)], check=False)
                self.assertNotEqual(ended.returncode, 0, "the host was not killed")
                there = [name for name, _ in files if (hot / name).exists()]
                # In the order of their arrival, so that no drawing is without its part or its settings.
                self.assertEqual(there, [name for name, _ in files[:len(there)]], (action, number))
                for name, data in files[:len(there)]:
                    self.assertEqual((hot / name).read_bytes(), data, (action, number, name))
                others = [name for name in os.listdir(hot) if name not in there]
                self.assertTrue(all(name.startswith(".") for name in others), others)
                seen.add(len(there))
        self.assertEqual(seen, {0, 1, 2, 3}, "the kills did not reach every state")

    def test_a_blender_that_is_killed_while_it_sends_leaves_nothing_half(self):
        with tempfile.TemporaryDirectory() as folder:
            can = Can()
            self.use(can.part(), bench.drawings(can.frame_matrix), bench.frame_at(can.frame_matrix))
            self.settings.sku = "can"
            self.preferences.hot_folder = folder
            scene = Path(folder) / ".scene.blend"
            bpy.ops.wm.save_as_mainfile(filepath=str(scene))
            whole = addon("session").Export(bpy.context).files()
            environment = dict(os.environ, ISOMARK_HOT=folder, ISOMARK_MODULE=bench.MODULE)
            script = [str(HERE / "killed_blender.py"), "--", str(scene)]
            blender = bpy.app.binary_path
            host = [blender, "-b", "-P", *script] if blender else [sys.executable, *script]
            ended = subprocess.run(host, env=environment, check=False, capture_output=True)
            self.assertIn(b"killing", ended.stdout, ended.stderr)
            self.assertNotIn(b"survived", ended.stdout)
            there = {name for name in os.listdir(folder) if not name.startswith(".")}
            # It was killed before the last rename: the drawing is missing, the rest is whole.
            self.assertEqual(there, {name for name, _ in whole[:-1]})
            for name, data in whole[:-1]:
                self.assertEqual((Path(folder) / name).read_bytes(), data)

    def test_leftovers_of_a_killed_host_are_removed_later_and_others_stay(self):
        station = addon("station")
        with tempfile.TemporaryDirectory() as folder:
            hot = Path(folder)
            names = [".isomark-1-2-old.dxf.part", ".isomark-1-2-new.dxf.part", ".other.part"]
            for name in names:
                (hot / name).write_bytes(b"half")
            for name in (names[0], names[2]):
                os.utime(hot / name, (1, 1))
            station.put(hot, [("can.dxf", b"whole")])
            self.assertEqual(sorted(os.listdir(hot)), sorted([*names[1:], "can.dxf"]))


def python():
    """A Python that runs scripts: inside Blender, sys.executable may be Blender's own or that of the system."""
    return sys.executable
