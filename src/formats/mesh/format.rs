//! The formats of parts, recognised by file name and first bytes.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A format that parts can be read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum MeshFormat {
    /// glTF 2 as text, with its buffers in files beside it or embedded.
    Gltf,
    /// glTF 2 in one binary file.
    Glb,
    /// Wavefront OBJ.
    Obj,
    /// STL, text or binary.
    Stl,
    /// Polygon file format: a mesh if it has faces, otherwise a scan.
    Ply,
    /// Points as text, one per line: a scan.
    Xyz,
    /// 3D Manufacturing Format.
    #[serde(rename = "3mf")]
    ThreeMf,
    /// STEP: exact faces.
    Step,
}

/// File name endings of part formats that isomark does not read, in lower case.
const UNREAD: [&str; 27] = [
    "iges", "igs", "amf", "fcstd", "brep", "brp", "blend", "sldprt", "sldasm", "ipt", "iam", "prt",
    "catpart", "x_t", "x_b", "sat", "jt", "3dm", "f3d", "fbx", "dae", "3ds", "skp", "wrl", "usd", "usdz",
    "off",
];

/// The same of scans, with the names of their formats.
const UNREAD_SCANS: [(&str, &str); 9] = [
    ("e57", "ASTM E57"),
    ("fls", "FARO scan"),
    ("las", "LAS"),
    ("laz", "LAS (compressed)"),
    ("pcd", "Point Cloud Library"),
    ("ptx", "Leica PTX"),
    ("rcp", "Autodesk ReCap"),
    ("rcs", "Autodesk ReCap"),
    ("zfs", "Zoller + Fröhlich"),
];

/// Whether the file name's ending, in upper or lower case, is that of a part format that isomark does not read.
///
/// ```
/// use isomark::formats::mesh::is_unread_part;
/// assert!(is_unread_part("can.IGES") && !is_unread_part("can.glb") && !is_unread_part("can.dxf"));
/// ```
#[must_use]
pub fn is_unread_part(file_name: &str) -> bool {
    let is_unread = |(_, ending): (&str, &str)| UNREAD.contains(&&*ending.to_ascii_lowercase());
    file_name.rsplit_once('.').is_some_and(is_unread) || unread_scan(file_name).is_some()
}

/// The format of scans that isomark does not read, if the file name's ending, in upper or lower case, is that of one.
///
/// ```
/// use isomark::formats::mesh::unread_scan;
/// assert_eq!((unread_scan("can.E57"), unread_scan("can.xyz")), (Some("ASTM E57"), None));
/// ```
#[must_use]
pub fn unread_scan(file_name: &str) -> Option<&'static str> {
    let ending = file_name.rsplit_once('.')?.1.to_ascii_lowercase();
    UNREAD_SCANS.iter().find(|(known, _)| *known == ending).map(|(_, format)| *format)
}

impl MeshFormat {
    /// File name endings of parts, for people.
    pub const ENDINGS: &str = ".step, .glb, .gltf, .obj, .stl, .ply, .3mf, .xyz, .txt or .csv";

    /// Whether an incomplete file can be recognised; a file of mere lines looks complete after any line.
    #[must_use]
    pub fn has_end_mark(self) -> bool {
        !matches!(self, Self::Obj | Self::Xyz)
    }

    /// The format for a file name's ending, in upper or lower case.
    ///
    /// ```
    /// use isomark::formats::mesh::MeshFormat;
    /// assert_eq!(MeshFormat::from_name("can.GLB"), Some(MeshFormat::Glb));
    /// assert_eq!(MeshFormat::from_name("can.dxf"), None);
    /// ```
    #[must_use]
    pub fn from_name(file_name: &str) -> Option<Self> {
        let (_, ending) = file_name.rsplit_once('.')?;
        match ending.to_ascii_lowercase().as_str() {
            "gltf" => Some(Self::Gltf),
            "glb" => Some(Self::Glb),
            "obj" => Some(Self::Obj),
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            "3mf" => Some(Self::ThreeMf),
            "step" | "stp" | "p21" => Some(Self::Step),
            "xyz" | "csv" | "txt" | "asc" | "pts" => Some(Self::Xyz),
            _ => None,
        }
    }

    /// The actual format of the bytes: glTF is recognised by its first bytes, for the others the name decides.
    pub(super) fn of_content(self, bytes: &[u8]) -> Self {
        let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
        if bytes.starts_with(b"glTF") {
            Self::Glb
        } else if text.starts_with(b"{") {
            Self::Gltf
        } else {
            self
        }
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Xyz => "XYZ",
            Self::ThreeMf => "3MF",
            Self::Step => "STEP",
        })
    }
}
