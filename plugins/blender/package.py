#!/usr/bin/env python3
"""Builds the add-on's zip, and on request a static repository for Blender 4.2 and later.

    python3 package.py OUT_DIR                   writes OUT_DIR/isomark-blender-VERSION.zip
    python3 package.py OUT_DIR --index [URL]     also writes OUT_DIR/index.json, which names the zip below URL

One zip serves all versions: its folder contains the manifest of an extension (4.2 and later) and `bl_info` (3.4 to 4.1).
The same sources always give the same bytes. Needs Python 3.11, no Blender.
"""

import argparse
import hashlib
import json
import tomllib
import zipfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "isomark"
# The fields of the manifest that a repository repeats for each extension.
LISTED = ("schema_version", "id", "name", "tagline", "version", "type", "maintainer", "license", "blender_version_min",
          "website", "tags", "permissions")


def manifest():
    """The add-on's manifest."""
    return tomllib.loads((SOURCE / "blender_manifest.toml").read_text(encoding="utf-8"))


def build(folder):
    """Writes the zip into the folder and returns its path."""
    about = manifest()
    path = folder / f"{about['id']}-blender-{about['version']}.zip"
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(SOURCE.iterdir()):
            if file.is_file() and not file.name.startswith("."):
                entry = zipfile.ZipInfo(f"{SOURCE.name}/{file.name}", (1980, 1, 1, 0, 0, 0))
                entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                archive.writestr(entry, file.read_bytes().replace(b"\r\n", b"\n"))
    return path


def index(archive, url):
    """The text of the repository's list, with the zip at `url`."""
    about = manifest()
    entry = {name: about[name] for name in LISTED if name in about}
    entry["archive_url"] = f"{url.rstrip('/')}/{archive.name}"
    entry["archive_size"] = archive.stat().st_size
    entry["archive_hash"] = "sha256:" + hashlib.sha256(archive.read_bytes()).hexdigest()
    return json.dumps({"version": "v1", "blocklist": [], "data": [entry]}, indent=2) + "\n"


def main():
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--index", nargs="?", const=".", metavar="URL")
    options = parser.parse_args()
    archive = build(options.folder)
    print(archive)
    if options.index is not None:
        place = options.folder / "index.json"
        place.write_text(index(archive, options.index), encoding="utf-8")
        print(place)


if __name__ == "__main__":
    main()
