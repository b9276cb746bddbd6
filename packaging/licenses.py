#!/usr/bin/env python3
"""Collects the licences of all that is compiled into isomark.

    python3 packaging/licenses.py TRIPLE ...     prints them, for targets of Rust such as x86_64-unknown-linux-gnu

The texts are the files in the sources of the crates, as cargo downloaded them. Needs Python 3.11 and cargo, no other package.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

CARGO = os.environ.get("CARGO", "cargo")
NAMES = re.compile(r"(licen[cs]e|copying|copyright|notice|unlicense|authors)", re.IGNORECASE)
SOURCES = {".rs", ".toml", ".json", ".sh", ".py"}
RULE = "=" * 100


class Failure(Exception):
    """What failed, and what to do."""


def metadata(root, *arguments):
    """What cargo states about the package and its dependencies."""
    command = [CARGO, "metadata", "--format-version", "1", "--locked", *arguments]
    try:
        done = subprocess.run(command, cwd=root, capture_output=True, check=False)
    except OSError as error:
        raise Failure(f"{CARGO}: {error.strerror}. Install Rust") from error
    if done.returncode:
        raise Failure(f"`{' '.join(command)}` failed: {done.stderr.decode(errors='replace').strip()}")
    return json.loads(done.stdout)


def crates(root, triples):
    """The crates that the program for one of the targets contains, by name and version."""
    found = metadata(root, *(f"--filter-platform={triple}" for triple in triples))
    nodes = {node["id"]: node for node in found["resolve"]["nodes"]}
    own = found["resolve"]["root"]
    reached, waiting = {own}, [own]
    while waiting:
        for dependency in nodes[waiting.pop()]["deps"]:
            # Tools of the build and the tests are not in the program.
            linked = any(kind["kind"] is None for kind in dependency["dep_kinds"])
            if linked and dependency["pkg"] not in reached:
                reached.add(dependency["pkg"])
                waiting.append(dependency["pkg"])
    packages = [each for each in found["packages"] if each["id"] in reached - {own}]
    return sorted(packages, key=lambda each: (each["name"], each["version"]))


def files(folder):
    """The files with licences in the sources of a crate."""
    return sorted(path for path in folder.iterdir()
                  if path.is_file() and NAMES.match(path.name) and path.suffix not in SOURCES)


def texts(root, crate):
    """The texts of the licences of a crate."""
    folder = Path(crate["manifest_path"]).parent
    paths = files(folder)
    if crate["license_file"] and (folder / crate["license_file"]) not in paths:
        paths.append(folder / crate["license_file"])
    if paths:
        return [path.read_text(encoding="utf-8", errors="replace") for path in paths]
    # The sources contain no text of their licence, only its name.
    if (crate["license"] or "").strip() == "Apache-2.0":
        return [(root / "LICENSE-APACHE").read_text(encoding="utf-8")]
    if "MIT" not in re.split(r" OR |/", crate["license"] or ""):
        raise Failure(f"{crate['name']} {crate['version']} ({crate['license']}): its sources contain no licence file. "
                      f"Add the text of that licence to packaging/licenses.py")
    holders = ", ".join(re.sub(r" *<.*>", "", each) for each in crate["authors"]) or f"the authors of {crate['name']}"
    own = (root / "LICENSE-MIT").read_text(encoding="utf-8")
    return [re.sub(r"(?m)^Copyright .*$", f"Copyright (c) {holders}", own, count=1)]


def text(root, triples):
    """The list of all crates, libraries and fonts in the program for one of the targets, then each licence once."""
    users = {}

    def add(user, found):
        lines = [line.rstrip() for line in found.replace("\r\n", "\n").lstrip("\ufeff").split("\n")]
        key = "\n".join(lines).strip("\n")
        if key and user not in users.setdefault(key, []):
            users[key].append(user)

    rows = []
    for crate in crates(root, triples):
        user = f"{crate['name']} {crate['version']}"
        rows.append(f"{user:<40} {crate['license'] or 'see below':<50} {crate['repository'] or ''}".rstrip())
        for found in texts(root, crate):
            add(user, found)
    standard = (root / "LICENSE-MIT").read_text(encoding="utf-8")
    library = "The standard library of Rust"
    rows.append(f"{library:<40} {'MIT OR Apache-2.0':<50} https://github.com/rust-lang/rust")
    add(library, re.sub(r"(?m)^Copyright .*$", "Copyright (c) The Rust Project Contributors", standard, count=1))
    add(library, (root / "LICENSE-APACHE").read_text(encoding="utf-8"))
    for path in sorted((root / "fonts").glob("LICENSE-*")):
        font = f"The font {path.name.removeprefix('LICENSE-')}"
        rows.append(f"{font:<40} see below")
        add(font, path.read_text(encoding="utf-8"))
    blocks = [f"{RULE}\n{', '.join(names)}\n{RULE}\n\n{found}\n" for found, names in users.items()]
    head = "isomark contains the following crates, libraries and fonts. Their licences are below.\n\n"
    return head + "\n".join(rows) + "\n\n" + "\n\n".join(blocks)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    try:
        sys.stdout.reconfigure(encoding="utf-8", newline="\n")
        sys.stdout.write(text(Path(__file__).resolve().parent.parent, sys.argv[1:]))
    except Failure as failure:
        sys.exit(f"error: {failure}")
