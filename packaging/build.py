#!/usr/bin/env python3
"""Builds the packages of isomark, and SHA256SUMS beside them.

    python3 packaging/build.py tarball     isomark-VERSION-ARCH-linux.tar.gz
    python3 packaging/build.py deb         isomark_VERSION_ARCH.deb
    python3 packaging/build.py windows     isomark-VERSION-ARCH-windows.zip
    python3 packaging/build.py freecad     isomark-freecad-VERSION.zip
    python3 packaging/build.py blender     isomark-blender-VERSION.zip

Several targets may be named. The packages are written to `target/packages`, or to the folder after `--out`. The first three
contain the program: that after `--program`, or else the one that `cargo build --release` makes. The same sources and the same
program give the same bytes. Needs Python 3.11 and cargo, and dpkg-deb for the .deb.
"""

import argparse
import gzip
import hashlib
import importlib.util
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import xml.etree.ElementTree as xml
import zipfile
from pathlib import Path

import licenses
from licenses import Failure

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("watch-config", "examples/parts", "examples/patterns", "examples/skus", "plugins/schemas", "plugins/service",
           "plugins/beamconstruct")
FILES = ("CHANGELOG.md", "CONTRIBUTING.md", "LICENSE-MIT", "LICENSE-APACHE", "examples/mouse.svg",
         "examples/distortion_trade.svg", "examples/mark-on-part.png",
         "packaging/README.md", "plugins/README.md", "plugins/codes.md", "plugins/blender/README.md",
         "plugins/blender/panel.png", "plugins/blender/isomark/LICENSE", "plugins/freecad/README.md",
         "plugins/freecad/panel.png", "plugins/fleet/README.md")
# Files whose line ends depend on the settings of git.
TEXTS = {"", ".md", ".toml", ".json", ".py", ".svg", ".xml", ".service"}
# The time of every file in a package: the earliest that a zip can state.
TIME = 315532800
ZIP_TIME = (1980, 1, 1, 0, 0, 0)
MAINTAINER = "The isomark developers <isomark@example.org>"


class Program:
    """A compiled program with its system and processor, as its header states them."""

    LINUX = {62: "x86_64", 183: "aarch64"}
    WINDOWS = {0x8664: "x86_64", 0xAA64: "aarch64"}

    def __init__(self, path):
        try:
            self.content = Path(path).read_bytes()
        except OSError as error:
            raise Failure(f"{path}: {error.strerror}. Give the path of a built isomark with --program") from error
        self.path, self.system, self.processor = path, None, None
        if self.content[:6] == b"\x7fELF\x02\x01":
            machine = int.from_bytes(self.content[18:20], "little")
            self.system, self.processor = "linux", self.LINUX.get(machine)
        elif self.content[:2] == b"MZ":
            start = int.from_bytes(self.content[60:64], "little")
            if self.content[start:start + 4] == b"PE\0\0":
                machine = int.from_bytes(self.content[start + 4:start + 6], "little")
                self.system, self.processor = "windows", self.WINDOWS.get(machine)

    def require(self, system):
        """Rejects a program of another system."""
        if self.system != system or self.processor is None:
            raise Failure(f"{self.path}: not a 64-bit program for {system.capitalize()} (x86-64 or ARM64). "
                          f"Give such a program with --program")
        return self

    def triples(self):
        """The targets of Rust that the program may have been built for."""
        systems = {"linux": ("unknown-linux-gnu", "unknown-linux-musl"), "windows": ("pc-windows-gnu", "pc-windows-msvc")}
        return [f"{self.processor}-{system}" for system in systems[self.system]]

    def libraries(self):
        """The packages of Debian that the program needs."""
        versions = re.findall(rb"\0GLIBC_(\d+)\.(\d+)(?:\.\d+)?(?=\0)", self.content)
        needed = []
        if versions:
            major, minor = max((int(major), int(minor)) for major, minor in versions)
            needed.append(f"libc6 (>= {major}.{minor})")
        if b"\0libgcc_s.so.1\0" in self.content:
            needed.append("libgcc-s1")
        return ", ".join(needed)


def built(system, meta):
    """The path of the program after a release build."""
    arguments, folder, name = [], Path(meta["target_directory"]), "isomark"
    if system == "windows":
        name = "isomark.exe"
        if os.name != "nt":
            arguments = ["--target", "x86_64-pc-windows-gnu"]
            folder /= "x86_64-pc-windows-gnu"
    command = [licenses.CARGO, "build", "--release", "--locked", "--bin", "isomark", *arguments]
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        raise Failure(f"`{' '.join(command)}` failed. Resolve its errors, or give a built program with --program")
    return folder / "release" / name


def content(path):
    """The bytes of a file, texts with the line ends of the repository."""
    found = path.read_bytes()
    return found.replace(b"\r\n", b"\n") if path.suffix in TEXTS else found


def tree(folder):
    """The files of a folder and their contents by path below it, without what editors and Python leave there."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    names = [(path.relative_to(folder), path) for path in paths]
    return {name.as_posix(): content(path) for name, path in names
            if not any(part.startswith(".") or part == "__pycache__" for part in name.parts)}


def plugins(folder):
    """Writes the zips of both plugins."""
    return [freecad(folder), blender(folder)]


def readme():
    """README.md, in which the section about the package replaces the one about building the program."""
    sections = re.split(r"(?m)^(?=## )", content(ROOT / "README.md").decode())
    found = [number for number, section in enumerate(sections) if section.startswith("## Try it\n")]
    if len(found) != 1:
        raise Failure("README.md: expected one section `## Try it`. Correct it, or this script")
    sections[found[0]] = content(ROOT / "packaging" / "try-it.md").decode()
    return "".join(sections).encode()


def shared(work):
    """What every package with the program contains beside it: path to bytes."""
    files = {name: content(ROOT / name) for name in FILES} | {"README.md": readme()}
    for folder in FOLDERS:
        files |= {f"{folder}/{name}": found for name, found in tree(ROOT / folder).items()}
    for path in plugins(work):
        host = "blender" if "blender" in path.name else "freecad"
        files[f"plugins/{host}/{path.name}"] = path.read_bytes()
    return files


def write_zip(path, files, programs=()):
    """Writes a zip whose bytes depend only on the files."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, found in sorted(files.items()):
            entry = zipfile.ZipInfo(name, ZIP_TIME)
            # The number of Unix, also on Windows: without it, the permissions are not read.
            entry.create_system, entry.compress_type = 3, zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if name in programs else 0o100644) << 16
            archive.writestr(entry, found)
    return path


def tarball(folder, program, meta):
    """Writes the archive for Linux: unpack it and run."""
    program.require("linux")
    name = f"isomark-{meta['version']}-{program.processor}-linux"
    files = shared(folder / ".work") | {"isomark": program.content, "THIRD-PARTY-LICENSES.txt": notices(program)}
    path = folder / f"{name}.tar.gz"
    with path.open("wb") as file, gzip.GzipFile("", "wb", 6, file, mtime=0) as packed, \
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive:
        for each, found in sorted(files.items()):
            entry = tarfile.TarInfo(f"{name}/{each}")
            entry.size, entry.mtime, entry.mode = len(found), TIME, 0o755 if each == "isomark" else 0o644
            archive.addfile(entry, io.BytesIO(found))
    return path


def windows(folder, program, meta):
    """Writes the zip for Windows: unpack it and run."""
    program.require("windows")
    name = f"isomark-{meta['version']}-{program.processor}-windows"
    files = shared(folder / ".work") | {"isomark.exe": program.content, "THIRD-PARTY-LICENSES.txt": notices(program)}
    return write_zip(folder / f"{name}.zip", {f"{name}/{each}": found for each, found in files.items()}, {f"{name}/isomark.exe"})


def deb(folder, program, meta):
    """Writes the package for Debian and Ubuntu: the program, the unit for systemd, samples and plugins."""
    program.require("linux")
    if shutil.which("dpkg-deb") is None:
        raise Failure("dpkg-deb is not installed. Install the package dpkg, or build the tarball")
    # A `-` would begin Debian's own revision, and `~` sorts before the release.
    version = meta["version"].replace("-", "~")
    architecture = {"x86_64": "amd64", "aarch64": "arm64"}[program.processor]
    files = {f"usr/share/isomark/{name}": found for name, found in shared(folder / ".work").items()}
    unit = files.pop("usr/share/isomark/plugins/service/isomark@.service")
    start = b"ExecStart=/usr/local/bin/isomark "
    if unit.count(start) != 1:
        raise Failure(f"plugins/service/isomark@.service: expected one line with `{start.decode()}`. Correct it, or this script")
    files["usr/lib/systemd/system/isomark@.service"] = unit.replace(start, b"ExecStart=/usr/bin/isomark ")
    own = content(ROOT / "LICENSE-MIT") + b"\nOr, at your option, the Apache License 2.0:\n\n" + content(ROOT / "LICENSE-APACHE")
    files["usr/share/doc/isomark/copyright"] = own + b"\n" + notices(program)
    files["usr/share/doc/isomark/changelog.gz"] = gzip.compress(content(ROOT / "CHANGELOG.md"), mtime=0)
    files["usr/bin/isomark"] = program.content
    fields = {
        "Package": "isomark", "Version": version, "Architecture": architecture, "Maintainer": MAINTAINER,
        "Installed-Size": str(-(-sum(map(len, files.values())) // 1024)), "Depends": program.libraries(),
        "Section": "science", "Priority": "optional",
        "Description": f"{meta['description']}\n It reads the part and the drawing, and writes a corrected DXF for the marking"
                       f" software:\n one file at a time, or from a hot folder that it watches all day.",
    }
    files["DEBIAN/md5sums"] = "".join(
        f"{hashlib.md5(found, usedforsecurity=False).hexdigest()}  {name}\n" for name, found in sorted(files.items())).encode()
    files["DEBIAN/control"] = "".join(f"{key}: {value}\n" for key, value in fields.items() if value).encode()
    root = folder / ".work" / "deb"
    for name, found in files.items():
        place = root / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(found)
        place.chmod(0o755 if name == "usr/bin/isomark" else 0o644)
    for place in (root, *root.rglob("*")):
        if place.is_dir():
            place.chmod(0o755)
        os.utime(place, (TIME, TIME))
    path = folder / f"isomark_{version}_{architecture}.deb"
    command = ["dpkg-deb", "--root-owner-group", "-Zgzip", "-z6", "--build", str(root), str(path)]
    done = subprocess.run(command, env=os.environ | {"SOURCE_DATE_EPOCH": str(TIME)}, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Failure(f"dpkg-deb failed: {done.stderr.strip()}")
    return path


def freecad(folder):
    """Writes the workbench's zip: unpack it in FreeCAD's folder `Mod`."""
    source = ROOT / "plugins" / "freecad"
    version = xml.parse(source / "package.xml").findtext("{*}version")
    files = {f"isomark/{name}": found for name, found in tree(source).items()}
    return write_zip(folder / f"isomark-freecad-{version}.zip", files)


def blender(folder):
    """Writes the add-on's zip, with the add-on's own script."""
    spec = importlib.util.spec_from_file_location("package", ROOT / "plugins" / "blender" / "package.py")
    package = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(package)
    return package.build(folder)


def notices(program):
    """The licences of all that is compiled into the program."""
    return licenses.text(ROOT, program.triples()).encode()


def write_sums(folder):
    """Writes the checksums of all packages in the folder, as `sha256sum --check` reads them."""
    paths = sorted(path for path in folder.iterdir() if path.name.startswith("isomark") and path.is_file())
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in paths]
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="ascii", newline="\n")


WITH_PROGRAM = {"tarball": ("linux", tarball), "deb": ("linux", deb), "windows": ("windows", windows)}
PLUGINS = {"freecad": freecad, "blender": blender}


def main():
    """Reads the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="+", choices=[*WITH_PROGRAM, *PLUGINS], metavar="TARGET")
    parser.add_argument("--program", type=Path, metavar="FILE", help="a built isomark to pack, instead of a new release build")
    parser.add_argument("--out", type=Path, metavar="DIR", help="the folder for the packages (default: target/packages)")
    options = parser.parse_args()
    meta = licenses.metadata(ROOT, "--no-deps")
    # The workspace contains other crates, too.
    own = next(package for package in meta["packages"] if package["name"] == "isomark")
    meta |= {key: own[key] for key in ("version", "description")}
    folder = options.out or Path(meta["target_directory"]) / "packages"
    folder.mkdir(parents=True, exist_ok=True)
    # Beside the results, so that an incomplete package never has its final name.
    with tempfile.TemporaryDirectory(prefix=".new-", dir=folder) as new:
        for target in dict.fromkeys(options.targets):
            place = Path(new) / target
            (place / ".work").mkdir(parents=True)
            if target in PLUGINS:
                made = PLUGINS[target](place)
            else:
                system, make = WITH_PROGRAM[target]
                made = make(place, Program(options.program or built(system, meta)), meta)
            made.replace(folder / made.name)
            print(folder / made.name)
    write_sums(folder)


if __name__ == "__main__":
    if sys.version_info < (3, 11):
        sys.exit("error: this Python is older than 3.11. Run the script with a newer one")
    try:
        main()
    except (Failure, OSError) as failure:
        sys.exit(f"error: {failure}")
