//! The meaning of a drop's name.
//!
//! | in the hot folder | is |
//! |---|---|
//! | `<sku>.glb`, `.gltf`, `.obj`, `.stl`, `.ply`, `.3mf`, `.xyz`, `.csv`, `.txt`, `.asc`, `.pts` | a part or a scan of it; an `@…` before the extension is allowed and has no meaning, except in a `.csv` |
//! | `<sku>.dxf`, `<sku>@<anything>.dxf`, or `.svg`, `.png`, `.bmp` | a pattern, delivered under this name, as `.dxf` |
//! | `<sku>/<anything>.glb` and so on | a part or a scan |
//! | `<sku>/<anything>.dxf`, `.svg`, `.png`, `.bmp` | a pattern, delivered as `<sku>@<anything>.dxf`, because other SKUs may have one with the same name |
//! | `.bin`, `.mtl`, other pictures, and any picture that a part names | companions: they are filed with that part |
//! | `<sku>@<anything>.csv` | the list of products for the drawing `<sku>@<anything>.dxf`, `.svg`, …, filed with it |
//! | `<name>.toml` | settings for the pattern `<name>.dxf`, `.svg`, `.png` or `.bmp`, filed with it |
//! | `<name>.toml.txt`, `<name>.tml`, `<sku>@<anything>.csv.txt` | misnamed settings or a misnamed list: the pattern waits until they have their name |
//!
//! `<sku>/<anything>` and `<sku>@<anything>` are the same name: settings and lists belong to a pattern of either form.
//!
//! Extensions may be written in any case. Files with temporary and system names are never touched ([`is_ignored`]).

use std::path::{Component, Path, PathBuf};

use crate::config::{Sku, misnamed_settings, without_ending};
use crate::formats::mesh::{MeshFormat, is_unread_part, unread_scan};
use crate::formats::pattern::is_drawing;
use crate::reason::Reason;

/// Extensions of files that belong to a part, in lower case.
const COMPANION_EXTENSIONS: &[&str] = &["bin", "mtl", "jpg", "jpeg", "webp", "ktx2"];

/// Extensions of drawings that isomark does not read, in lower case.
const UNREAD_DRAWINGS: &[&str] = &["ai", "cdr", "dwf", "dwg", "dxb", "emf", "eps", "pdf", "plt", "ps", "wmf"];

/// Extensions of pictures that isomark does not read, in lower case.
const UNREAD_PICTURES: &[&str] = &["gif", "heic", "jpeg", "jpg", "psd", "tif", "tiff", "webp", "xcf"];

/// Extensions of tables that isomark does not read, in lower case.
const UNREAD_TABLES: &[&str] = &["numbers", "ods", "xls", "xlsb", "xlsm", "xlsx"];

/// Extensions of archives, in lower case.
const ARCHIVES: &[&str] = &["7z", "gz", "rar", "tar", "tgz", "zip"];

/// The file in a SKU's archive folder that contains the path of its part, relative to that folder, with `/`.
pub const CURRENT_PART: &str = "current-part.txt";

/// Extension of the settings beside a pattern.
pub(crate) const SIDECAR: &str = "toml";

/// Extension of the list of products beside a pattern.
const LIST: &str = "csv";

/// The longest file name that is accepted, in bytes: file systems allow 255, and results need a suffix.
const LONGEST_NAME: usize = 230;

/// Suffixes that other programs use while they write a file, lock it or keep a copy, in lower case.
const IGNORED_ENDINGS: &[&str] = &[
    "~",
    ".tmp",
    ".temp",
    ".part",
    ".partial",
    ".crdownload",
    ".download",
    ".opdownload",
    ".filepart",
    ".!sync",
    ".swp",
    ".bak",
    ".lock",
    ".lck",
    ".dwl",
    ".dwl2",
];

/// Names of system files and folders, in lower case.
const IGNORED_NAMES: &[&str] = &[
    "thumbs.db",
    "ehthumbs.db",
    "desktop.ini",
    "icon\r",
    "$recycle.bin",
    "#recycle",
    "@eadir",
    "lost+found",
    "system volume information",
];

/// What a file in the hot folder is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Meaning {
    /// A part of a SKU.
    Part(Sku),
    /// A drawing for a SKU.
    Pattern {
        /// The SKU it is for.
        sku: Sku,
        /// The name of the pattern; the result has this name, as a DXF file ([`delivered_as`]).
        name: String,
    },
    /// A file that belongs to a part.
    Companion,
}

/// The name of a pattern's result in the import folder.
pub fn delivered_as(pattern: &str) -> String {
    match pattern.rsplit_once('.') {
        Some((stem, _)) if is_drawing(pattern) => format!("{stem}.dxf"),
        _ => pattern.to_owned(),
    }
}

/// Whether the name is a temporary, lock or system name of a file or folder, which is ignored.
pub fn is_ignored(name: &str) -> bool {
    let name = name.to_lowercase();
    name.starts_with(['.', '~'])
        || IGNORED_ENDINGS.iter().any(|ending| name.ends_with(ending))
        || IGNORED_NAMES.contains(&name.as_str())
        || name.contains(".sync-conflict-")
}

/// Whether the file holds settings for the pattern beside it.
pub(crate) fn is_sidecar(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(SIDECAR))
}

/// The name that misnamed settings or a misnamed list should have; `None` for all other files. An editor may add `.txt`, and
/// Windows hides that.
pub(crate) fn well_named(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_str()?;
    let right = match misnamed_settings(name) {
        Some(stem) => format!("{stem}.{SIDECAR}"),
        None => {
            let stem = without_ending(name, ".csv.txt").filter(|stem| stem.contains('@'))?;
            format!("{stem}.{LIST}")
        }
    };
    Some(path.with_file_name(right))
}

/// Whether the file has the ending of a list of products; without an `@` in its name, it is a scan.
pub(crate) fn is_list_ending(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(LIST))
}

/// Whether the file is a list of products for the drawing beside it: its name has an `@`, as that of a drawing.
pub(crate) fn is_list(path: &Path) -> bool {
    is_list_ending(path) && path.file_stem().is_some_and(|stem| stem.to_string_lossy().contains('@'))
}

/// The path of the list of a pattern: `<sku>@<name>.csv` beside `<sku>@<name>.dxf`.
pub fn list_of(pattern: &Path) -> Option<PathBuf> {
    Some(pattern.with_extension(LIST)).filter(|path| is_list(path))
}

/// The path of a pattern's own settings: `<name>.toml` beside `<name>.dxf`.
pub fn sidecar_of(pattern: &Path) -> Option<PathBuf> {
    pattern.file_stem().map(|_| pattern.with_extension(SIDECAR))
}

/// The full name of a drawing, its settings or its list at `relative`, without its extension: `<sku>@<name>` in either form.
pub(crate) fn full_stem(relative: &Path) -> String {
    let stem = relative.file_stem().unwrap_or_default().to_string_lossy();
    let folder = relative.parent().and_then(Path::file_name).map(|folder| folder.to_string_lossy());
    match folder {
        Some(folder) if !folder.parse::<Sku>().is_ok_and(|sku| names_sku(&stem, &sku)) => {
            format!("{folder}@{stem}")
        }
        _ => stem.into_owned(),
    }
}

/// The same name in the other form: `<sku>/<name>` for `<sku>@<name>`, and the reverse.
pub(crate) fn other_form(relative: &Path) -> Option<PathBuf> {
    let name = relative.file_name()?.to_str()?;
    match relative.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(_) => {
            let ending = relative.extension()?.to_str()?;
            Some(format!("{}.{ending}", full_stem(relative)).into())
        }
        None => {
            let (sku, rest) = name.split_once('@')?;
            (!rest.starts_with('.')).then(|| Path::new(sku).join(rest))
        }
    }
}

/// The meaning of the file at `relative`, its path in the hot folder: a name, or a SKU's folder and a name.
///
/// # Errors
/// With the reason why the name is invalid: an unknown kind, an invalid SKU, or a name that cannot be delivered.
pub fn meaning(relative: &Path) -> Result<Meaning, Reason> {
    let mut parts = Vec::new();
    for component in relative.components() {
        match component {
            Component::Normal(part) => parts.push(part.to_str().ok_or_else(unreadable_name)?),
            _ => return Err(unreadable_name()),
        }
    }
    let (folder, name) = match parts[..] {
        [name] => (None, name),
        [folder, name] => (Some(folder), name),
        _ => return Err(unreadable_name()),
    };
    let length = name.len() + folder.map_or(0, |folder| folder.len() + 1);
    if length > LONGEST_NAME {
        let what = match folder {
            Some(_) => "The file's name is too long, together with that of its folder.",
            None => "The file's name is too long.",
        };
        let reason = Reason::new("name-too-long", what, "Give it a shorter name.");
        return Err(reason.with_number("length", length as f64, "bytes", Some(LONGEST_NAME as f64)));
    }
    if let Some(character) = name.chars().find(|c| c.is_control() || r#"\:*?"<>|"#.contains(*c)) {
        let what = format!("The file's name contains {character:?}, which some file systems cannot store.");
        return Err(Reason::new(
            "name-character",
            what,
            "Rename it without \\ : * ? \" < > | and control characters.",
        ));
    }
    if name.eq_ignore_ascii_case(CURRENT_PART) {
        let what = format!("isomark uses the name {CURRENT_PART} for its own file in the archive.");
        return Err(Reason::new("name-reserved", what, "Give the scan another name."));
    }
    let (stem, extension) = name.rsplit_once('.').unwrap_or((name, ""));
    let extension = extension.to_lowercase();
    // A name with `@` is meant as a drawing for a SKU, not as a texture.
    let is_companion = COMPANION_EXTENSIONS.contains(&extension.as_str()) && !stem.contains('@');
    if is_companion
        || well_named(Path::new(name)).is_some()
        || extension == SIDECAR
        || is_list(Path::new(name))
    {
        return Ok(Meaning::Companion);
    }
    let is_part = MeshFormat::from_name(name).is_some();
    if !is_part && !is_drawing(name) {
        return Err(unknown_kind(name, &extension));
    }
    let sku_name = folder.unwrap_or_else(|| stem.split('@').next().unwrap_or(stem));
    let sku: Sku = sku_name.parse().map_err(|error: crate::config::BadSku| error.reason())?;
    if is_part {
        return Ok(Meaning::Part(sku));
    }
    let name = match folder {
        Some(folder) if !names_sku(stem, &sku) => format!("{folder}@{name}"),
        _ => name.to_owned(),
    };
    Ok(Meaning::Pattern { sku, name })
}

/// Whether a stem already names the SKU.
fn names_sku(stem: &str, sku: &Sku) -> bool {
    stem.split('@').next().unwrap_or(stem).parse::<Sku>().as_ref() == Ok(sku)
}

fn unknown_kind(name: &str, extension: &str) -> Reason {
    let export = format!("Export the part as {}", MeshFormat::ENDINGS);
    let (what, remedy) = if let Some(format) = unread_scan(name) {
        (
            format!("A .{extension} file is a scan in a format that isomark does not read ({format})."),
            "Export the points as .ply, .xyz, .csv, .txt, .asc or .pts in the scanner's program, or in CloudCompare.".to_owned(),
        )
    } else if is_unread_part(name) {
        (
            format!("A .{extension} file is in a format that isomark does not read."),
            format!("{export}, in a program that opens the file, such as FreeCAD."),
        )
    } else if UNREAD_DRAWINGS.contains(&extension) {
        (
            format!("isomark does not read .{extension} files."),
            "Export the drawing as .dxf or .svg.".to_owned(),
        )
    } else if UNREAD_PICTURES.contains(&extension) {
        (format!("isomark does not read .{extension} files."), "Save the picture as .png or .bmp.".to_owned())
    } else if UNREAD_TABLES.contains(&extension) {
        (
            format!("isomark does not read .{extension} files."),
            "Save the table as CSV in UTF-8. A list of products needs the name of its drawing: can@label.csv, dropped before can@label.dxf."
                .to_owned(),
        )
    } else if ARCHIVES.contains(&extension) {
        (
            format!("isomark does not read .{extension} files."),
            "Unpack the file, and drop the parts and drawings in it.".to_owned(),
        )
    } else if extension == "svgz" {
        (
            "A .svgz file is a compressed drawing, which isomark does not read.".to_owned(),
            "Save it as plain SVG (.svg) in the drawing program.".to_owned(),
        )
    } else {
        let kind = match extension {
            "" => "file without an extension".to_owned(),
            other => format!(".{other} file"),
        };
        (
            format!("A {kind} is neither a part nor a drawing."),
            format!("{export}, and the drawing as .dxf, .svg, .png or .bmp."),
        )
    };
    Reason::new("unknown-kind", what, remedy)
}

fn unreadable_name() -> Reason {
    Reason::new(
        "name-unreadable",
        "The file's name is not valid text.",
        "Rename it with plain letters and digits.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temporary_names_are_ignored() {
        for name in [
            ".x.dxf",
            "~x.dxf",
            "~$x.dxf",
            "x.dxf~",
            "x.dxf.tmp",
            "x.part",
            "x.DXF.crdownload",
            "x.download",
            ".syncthing.x.dxf.tmp",
            "~syncthing~x.dxf.tmp",
            "x.sync-conflict-20240101-120000-ABCDEFG.dxf",
            "Thumbs.db",
            ".DS_Store",
            "desktop.ini",
            ".~lock.x.dxf#",
            "x.dwl2",
        ] {
            assert!(is_ignored(name), "{name}");
        }
        for name in ["x.dxf", "part.obj", "tmp.glb", "a~b.dxf", "readme.txt"] {
            assert!(!is_ignored(name), "{name}");
        }
    }

    #[test]
    fn a_name_determines_what_a_file_is() {
        let sku = |name: &str| name.parse::<Sku>().unwrap();
        let pattern = |name: &str, called: &str| Meaning::Pattern { sku: sku(name), name: called.into() };
        for (relative, expected) in [
            ("can-500.glb", Meaning::Part(sku("can-500"))),
            ("can-500@v2.OBJ", Meaning::Part(sku("can-500"))),
            ("can.stl", Meaning::Part(sku("can"))),
            ("can@scan-17.PLY", Meaning::Part(sku("can"))),
            ("can/scan.csv", Meaning::Part(sku("can"))),
            ("can-500.dxf", pattern("can-500", "can-500.dxf")),
            ("can-500@date@2.DXF", pattern("can-500", "can-500@date@2.DXF")),
            ("can/whatever.gltf", Meaning::Part(sku("can"))),
            ("can/date.dxf", pattern("can", "can@date.dxf")),
            ("can/CAN@date.dxf", pattern("can", "CAN@date.dxf")),
            ("can/can.dxf", pattern("can", "can.dxf")),
            ("can/canister.dxf", pattern("can", "can@canister.dxf")),
            ("can.v2.dxf", pattern("can.v2", "can.v2.dxf")),
            ("can.png", pattern("can", "can.png")),
            ("can@logo.BMP", pattern("can", "can@logo.BMP")),
            ("can@logo.svg", pattern("can", "can@logo.svg")),
            ("can/logo.SVG", pattern("can", "can@logo.SVG")),
            ("can/logo.png", pattern("can", "can@logo.png")),
            ("can.bin", Meaning::Companion),
            ("can.jpg", Meaning::Companion),
            ("can/can.mtl", Meaning::Companion),
            ("can@l.toml.txt", Meaning::Companion),
            ("can/l.TML", Meaning::Companion),
            ("can@l.csv.txt", Meaning::Companion),
            ("can.csv.txt", Meaning::Part(sku("can.csv"))),
        ] {
            assert_eq!(meaning(Path::new(relative)).unwrap(), expected, "{relative}");
        }
    }

    #[test]
    fn both_forms_of_a_name_are_the_same() {
        for (relative, full, other) in [
            ("can@d.svg", "can@d", Some("can/d.svg")),
            ("can/d.svg", "can@d", Some("can@d.svg")),
            ("can/CAN@d.toml", "CAN@d", Some("CAN@d.toml")),
            ("can/can.dxf", "can", Some("can.dxf")),
            ("can.dxf", "can", None),
            ("can@a@b.csv", "can@a@b", Some("can/a@b.csv")),
        ] {
            let relative = Path::new(relative);
            assert_eq!(full_stem(relative), full);
            assert_eq!(other_form(relative).as_deref(), other.map(Path::new), "{}", relative.display());
        }
    }

    #[test]
    fn results_are_dxf_files() {
        for (pattern, delivered) in [
            ("can.dxf", "can.dxf"),
            ("can@a.DXF", "can@a.dxf"),
            ("can@a.b.Png", "can@a.b.dxf"),
            ("can.bmp", "can.dxf"),
            ("can@logo.svg", "can@logo.dxf"),
        ] {
            assert_eq!(delivered_as(pattern), delivered);
        }
    }

    #[test]
    fn invalid_names_get_a_reason() {
        let long = format!("{}.dxf", "x".repeat(240));
        for (relative, code) in [
            ("can.iges", "unknown-kind"),
            ("can@logo.jpg", "unknown-kind"),
            ("can@logo.svgz", "unknown-kind"),
            ("can", "unknown-kind"),
            ("@date.dxf", "sku-name"),
            ("con.dxf", "sku-name"),
            ("a@b/date.dxf", "sku-name"),
            ("can@12:30.dxf", "name-character"),
            ("../can.dxf", "name-unreadable"),
            ("a/b/can.dxf", "name-unreadable"),
            (&long, "name-too-long"),
        ] {
            assert_eq!(meaning(Path::new(relative)).unwrap_err().code, code, "{relative}");
        }
        // The result is named after both.
        let in_folder = meaning(&Path::new("can").join("x".repeat(226) + ".dxf")).unwrap_err();
        let number = in_folder.number.unwrap();
        assert_eq!(
            (number.value, number.limit),
            (234.0, Some(230.0)),
            "3 letters, a slash, 226 letters and the ending"
        );
        let unread = meaning(Path::new("can.IGES")).unwrap_err();
        assert_eq!(unread.what, "A .iges file is in a format that isomark does not read.");
        assert!(unread.remedy.contains(".step, .glb, .gltf, .obj, .stl"));
        for (name, remedy) in [
            ("can.PDF", "Export the drawing as .dxf or .svg."),
            ("can@logo.dwg", "Export the drawing as .dxf or .svg."),
            ("can@logo.jpg", "Save the picture as .png or .bmp."),
            ("can.zip", "Unpack the file, and drop the parts and drawings in it."),
            (
                "can@label.XLSX",
                "Save the table as CSV in UTF-8. A list of products needs the name of its drawing: can@label.csv, dropped before \
                 can@label.dxf.",
            ),
        ] {
            let reason = meaning(Path::new(name)).unwrap_err();
            let extension = name.rsplit_once('.').unwrap().1.to_lowercase();
            assert_eq!(reason.what, format!("isomark does not read .{extension} files."));
            assert_eq!(reason.remedy, remedy);
        }
        let unknown = meaning(Path::new("can.doc")).unwrap_err();
        assert_eq!(unknown.what, "A .doc file is neither a part nor a drawing.");
        assert!(unknown.remedy.contains(".glb, .gltf, .obj, .stl") && unknown.remedy.contains(".dxf"));
    }
}
