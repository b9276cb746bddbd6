"""The zip is what Blender 4.2 and later accept as an extension, and the list is that of a static repository."""

import ast
import importlib.util
import json
import subprocess
import sys
import unittest
from pathlib import Path

import bpy

import bench
from bench import SceneTest

FOLDER = Path(__file__).resolve().parent.parent
SOURCE = FOLDER / "isomark"


@unittest.skipIf(bpy.app.version < (4, 2, 0), "Blender has extensions from 4.2 on")
class Extension(SceneTest):
    def blender(self, *arguments):
        """Runs what `blender --command extension` runs."""
        tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
        ended = subprocess.run([sys.executable, str(tool), *map(str, arguments)], capture_output=True, text=True, check=False)
        self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)
        return ended.stdout

    def test_blender_validates_and_builds_it_and_lists_it_in_a_repository(self):
        spec = importlib.util.spec_from_file_location("package", FOLDER / "package.py")
        package = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(package)
        archive = package.build(self.folder / "ours")
        self.assertEqual(archive.read_bytes(), package.build(self.folder / "again").read_bytes())
        self.blender("validate", SOURCE)
        self.blender("validate", archive)
        (self.folder / "theirs").mkdir()
        self.blender("build", "--source-dir", SOURCE, "--output-filepath", self.folder / "theirs" / "isomark.zip")
        self.blender("validate", self.folder / "theirs" / "isomark.zip")
        self.blender("server-generate", "--repo-dir", archive.parent)
        listed = json.loads((archive.parent / "index.json").read_text())
        self.assertEqual(json.loads(package.index(archive, ".")), listed)


class Names(SceneTest):
    def test_both_manifests_state_the_same_and_the_licence_is_enclosed(self):
        module = ast.parse((SOURCE / "__init__.py").read_text())
        old = next(ast.literal_eval(node.value) for node in module.body
                   if isinstance(node, ast.Assign) and node.targets[0].id == "bl_info")
        new = (SOURCE / "blender_manifest.toml").read_text()
        self.assertIn(f'version = "{".".join(map(str, old["version"]))}"', new)
        self.assertIn('license = ["SPDX:GPL-3.0-or-later"]', new)
        self.assertIn("GNU GENERAL PUBLIC LICENSE", (SOURCE / "LICENSE").read_text())
        for file in SOURCE.glob("*.py"):
            self.assertTrue(file.read_text().startswith("# SPDX-License-Identifier: GPL-3.0-or-later\n"), file.name)

    def test_the_add_on_leaves_nothing_behind(self):
        before = [list(getattr(bpy.app.handlers, name)) for name in ("load_pre", "depsgraph_update_post")]
        bpy.ops.preferences.addon_disable(module=bench.MODULE)
        self.assertFalse(hasattr(bpy.types.Scene, "isomark") or hasattr(bpy.types.WindowManager, "isomark_live"))
        self.assertFalse(any(module.__module__.startswith(bench.MODULE) for name in ("load_pre", "depsgraph_update_post")
                             for module in getattr(bpy.app.handlers, name)))
        bpy.ops.preferences.addon_enable(module=bench.MODULE)
        after = [list(getattr(bpy.app.handlers, name)) for name in ("load_pre", "depsgraph_update_post")]
        self.assertEqual(list(map(len, before)), list(map(len, after)))
