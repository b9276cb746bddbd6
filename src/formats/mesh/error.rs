//! Why a part file cannot be read, as data and as a reason with a remedy.

use std::fmt;
use std::io;

use crate::geometry::mesh::TriMesh;
use crate::reason::{Place, Reason};

use super::MeshFormat;

/// Why a part file cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshReadError {
    /// A GLB file is shorter than its header says.
    #[error("the {format} file is cut: {actual} of {declared} bytes are there")]
    Truncated {
        /// The format read.
        format: MeshFormat,
        /// Length the file says it has, bytes.
        declared: u64,
        /// Length it has, bytes.
        actual: u64,
    },
    /// The last line of a text file ends in the middle of a statement.
    #[error("the file is cut: its last line is \"{text}\"")]
    CutLine {
        /// Line, from 1.
        line: u64,
        /// Beginning of the line.
        text: String,
    },
    /// A text file has fewer entries than its header says.
    #[error("the {format} file is cut: {actual} of {declared} {what} are there")]
    CutShort {
        /// The format read.
        format: MeshFormat,
        /// What there is too little of, such as `vertices`.
        what: String,
        /// How many the header says there are.
        declared: u64,
        /// How many there are.
        actual: u64,
    },
    /// The header of a PLY file, or the head of a list of points, cannot be used.
    #[error("the head of the {format} file cannot be used: {problem}")]
    BadHeader {
        /// The format read.
        format: MeshFormat,
        /// Line, from 1.
        line: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The bytes are no file of this format.
    #[error("this is no {format} file: it begins with {found}")]
    NotThisFormat {
        /// The format that was to be read.
        format: MeshFormat,
        /// What was found instead.
        found: String,
    },
    /// A glTF version other than 2.
    #[error("the file says it is glTF {version}; only glTF 2 can be read")]
    Version {
        /// The version as written.
        version: String,
    },
    /// The JSON of a glTF file cannot be read.
    #[error("the glTF JSON cannot be read: {message}")]
    BadJson {
        /// Line in the JSON, from 1.
        line: u64,
        /// Column in that line, from 1.
        column: u64,
        /// What the JSON reader says.
        message: String,
    },
    /// An entry of the glTF JSON names another one that does not exist.
    #[error("{item} names {kind} {index}, but there are only {count}")]
    BrokenReference {
        /// The entry that names it.
        item: String,
        /// What is named, such as `accessor`.
        kind: &'static str,
        /// The number named, from 0.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// The file cannot be understood without an extension that is not known here.
    #[error("the file needs the glTF extension {name}")]
    UnsupportedExtension {
        /// The extension's name.
        name: String,
    },
    /// The data of an accessor are not of the kind that its use demands.
    #[error("{item} is stored as {found}, not as {expected}")]
    WrongData {
        /// What the data are for.
        item: String,
        /// What they must be.
        expected: &'static str,
        /// What they are.
        found: String,
    },
    /// An accessor has no data at all.
    #[error("{item} has no data")]
    NoData {
        /// What the data are for.
        item: String,
    },
    /// The data of an accessor reach beyond their buffer.
    #[error("{item} needs {needed} bytes, but its buffer has only {available}")]
    DataBeyondBuffer {
        /// What the data are for.
        item: String,
        /// Bytes needed from the start of the buffer or view.
        needed: u64,
        /// Bytes there are.
        available: u64,
    },
    /// A buffer's name leads out of the part's folder, or is no file name.
    #[error("the buffer \"{name}\" is no plain file name beside the part")]
    BufferName {
        /// The name as written.
        name: String,
    },
    /// A buffer beside the part cannot be read.
    #[error("the buffer \"{name}\" cannot be read: {kind}")]
    BufferMissing {
        /// The file's name.
        name: String,
        /// What kept it from being read.
        kind: io::ErrorKind,
    },
    /// A buffer is shorter than the JSON says.
    #[error("the buffer {name} has {actual} bytes, {declared} are needed")]
    BufferShort {
        /// The file's name, or what else the buffer is.
        name: String,
        /// Length the JSON says it has, bytes.
        declared: u64,
        /// Length it has, bytes.
        actual: u64,
    },
    /// A data URI cannot be decoded.
    #[error("the data of buffer {buffer} inside the JSON are no base64")]
    BadDataUri {
        /// Number of the buffer, from 0.
        buffer: usize,
    },
    /// A node's position, turn or scale is not finite.
    #[error("{node} has a transform that is not finite")]
    BadTransform {
        /// The node.
        node: String,
    },
    /// A node is its own descendant, or the child of two nodes.
    #[error("{node} is reached twice in the tree of nodes")]
    NodeTwice {
        /// The node.
        node: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("a vertex has the coordinates ({}, {}, {})", coordinate[0], coordinate[1], coordinate[2])]
    NotFinite {
        /// Where the vertex stands.
        vertex: VertexPlace,
        /// The coordinates as read.
        coordinate: [f64; 3],
    },
    /// A coordinate is further from the origin than [`TriMesh::LARGEST_COORDINATE`].
    #[error("a vertex lies at ({:.0}, {:.0}, {:.0}) mm", coordinate[0], coordinate[1], coordinate[2])]
    TooFar {
        /// The coordinates, mm.
        coordinate: [f64; 3],
    },
    /// A triangle names a vertex or normal that does not exist.
    #[error("a face names {kind} {index}, but there are only {count}")]
    IndexOutOfRange {
        /// Where the face stands.
        face: VertexPlace,
        /// What is named: `vertex` or `normal`.
        kind: &'static str,
        /// The number as written.
        index: i64,
        /// How many there are.
        count: usize,
    },
    /// A line of an OBJ file cannot be understood.
    #[error("the line \"{text}\" cannot be read: {problem}")]
    BadLine {
        /// Line, from 1.
        line: u64,
        /// Beginning of the line.
        text: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// The parser refuses what our own checks let through.
    #[error("the {format} file cannot be read: {message}")]
    Refused {
        /// The format read.
        format: MeshFormat,
        /// What the parser says.
        message: String,
    },
    /// There is no triangle with an area.
    #[error("the file holds no triangle with an area{}", likely_cause(cause))]
    NoTriangles {
        /// The likely cause.
        cause: EmptyCause,
    },
    /// There is no point.
    #[error("the file holds no point{}", match missing { 0 => String::new(), missing => format!(", only {missing} that are marked as missing") })]
    NoPoints {
        /// Number of points that are marked as missing.
        missing: usize,
    },
    /// There is more than can be kept.
    #[error("the file has {count} {what}, more than {limit}")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// How many there are, at least.
        count: u64,
        /// How many can be read.
        limit: u64,
    },
    /// It is more than a moment's work, and only a moment was given to it.
    #[error("the part takes longer than a moment")]
    TakesLong,
}

/// Where a vertex or face stands in its file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VertexPlace {
    /// In a primitive of a glTF file.
    Gltf {
        /// The mesh's name or number.
        mesh: String,
        /// Number of the primitive in its mesh, from 0.
        primitive: usize,
        /// Number of the vertex, or of the corner that names it, from 0.
        vertex: usize,
    },
    /// In a line of a text file.
    Obj {
        /// Line, from 1.
        line: u64,
    },
    /// One of many in a binary file.
    Numbered {
        /// What it is, such as `facet`.
        what: &'static str,
        /// Its number, from 0.
        number: usize,
    },
}

/// Why a part file came out empty, as far as the file shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum EmptyCause {
    /// An OpenCASCADE program such as FreeCAD exported a shape that had no triangles yet.
    NeverMeshed,
    /// FreeCAD's Arch exporter was given a container instead of the bodies in it.
    ArchContainer,
    /// There are only lines or points.
    OnlyOthers(Vec<String>),
    /// All triangles have corners in one line.
    Flat,
    /// Nothing of use is there.
    Nothing,
}

fn likely_cause(cause: &EmptyCause) -> String {
    match cause {
        EmptyCause::NeverMeshed => ": the exporting program had not meshed the shape".into(),
        EmptyCause::ArchContainer => ": a FreeCAD container was exported without its bodies".into(),
        EmptyCause::OnlyOthers(others) => format!(", only {}", others.join(", ")),
        EmptyCause::Flat | EmptyCause::Nothing => String::new(),
    }
}

impl MeshReadError {
    /// The same as a reason: code, sentence, place, number and remedy. The file's name is added by who knows it.
    pub fn reason(&self) -> Reason {
        let reason = Reason::new(self.code(), self.to_string(), self.remedy()).at(self.place());
        match self {
            Self::Truncated { declared, actual, .. } | Self::BufferShort { declared, actual, .. } => {
                reason.with_number("length", *actual as f64, "bytes", Some(*declared as f64))
            }
            Self::CutShort { what, declared, actual, .. } => {
                reason.with_number("count", *actual as f64, what, Some(*declared as f64))
            }
            Self::DataBeyondBuffer { needed, available, .. } => {
                reason.with_number("bytes needed", *needed as f64, "bytes", Some(*available as f64))
            }
            Self::TooLarge { what, count, limit } => {
                reason.with_number("count", *count as f64, what, Some(*limit as f64))
            }
            Self::IndexOutOfRange { index, count, .. } => {
                reason.with_number("index", *index as f64, "", Some(*count as f64))
            }
            Self::BrokenReference { index, count, .. } => {
                reason.with_number("index", *index as f64, "", Some(*count as f64))
            }
            Self::TooFar { coordinate } => {
                let farthest = coordinate.iter().fold(0.0f64, |most, value| most.max(value.abs()));
                reason.with_number("coordinate", farthest, "mm", Some(TriMesh::LARGEST_COORDINATE))
            }
            _ => reason,
        }
    }

    /// Whether the file ends too early, so that more of it may still come.
    pub fn is_cut_short(&self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::CutLine { .. } | Self::CutShort { .. })
    }

    fn code(&self) -> &'static str {
        match self {
            Self::Truncated { .. } | Self::CutLine { .. } | Self::CutShort { .. } => "mesh-truncated",
            Self::BadHeader { .. } => "mesh-header-invalid",
            Self::NoPoints { .. } => "scan-empty",
            Self::NotThisFormat { .. } => "mesh-wrong-format",
            Self::Version { .. } => "mesh-version-unsupported",
            Self::BadJson { .. } => "mesh-json-invalid",
            Self::BrokenReference { .. } => "mesh-reference-broken",
            Self::UnsupportedExtension { .. } => "mesh-extension-unsupported",
            Self::WrongData { .. } => "mesh-data-type",
            Self::NoData { .. } => "mesh-data-missing",
            Self::DataBeyondBuffer { .. } => "mesh-data-beyond-buffer",
            Self::BufferName { .. } => "mesh-buffer-name",
            Self::BufferMissing { .. } => "mesh-buffer-missing",
            Self::BufferShort { .. } => "mesh-buffer-short",
            Self::BadDataUri { .. } => "mesh-data-uri",
            Self::BadTransform { .. } => "mesh-transform-invalid",
            Self::NodeTwice { .. } => "mesh-node-cycle",
            Self::NotFinite { .. } => "mesh-coordinate-not-finite",
            Self::TooFar { .. } => "mesh-coordinate-too-far",
            Self::IndexOutOfRange { .. } => "mesh-index-out-of-range",
            Self::BadLine { .. } => "mesh-line-invalid",
            Self::Refused { .. } => "mesh-refused",
            Self::NoTriangles { .. } => "mesh-empty",
            Self::TooLarge { .. } => "mesh-too-large",
            Self::TakesLong => "takes-long",
        }
    }

    fn place(&self) -> Place {
        let item = |item: &str| Place { item: Some(item.into()), ..Place::default() };
        let line = |line: u64| Place { line: Some(line), ..Place::default() };
        match self {
            Self::Truncated { actual, .. } => Place { byte: Some(*actual), ..Place::default() },
            Self::CutLine { line: at, .. }
            | Self::BadLine { line: at, .. }
            | Self::BadHeader { line: at, .. } => line(*at),
            Self::BadJson { line, column, .. } => {
                Place { line: Some(*line), column: Some(*column), ..Place::default() }
            }
            Self::BrokenReference { item: at, .. }
            | Self::WrongData { item: at, .. }
            | Self::NoData { item: at }
            | Self::DataBeyondBuffer { item: at, .. }
            | Self::BadTransform { node: at }
            | Self::NodeTwice { node: at } => item(at),
            Self::BufferName { name } | Self::BufferMissing { name, .. } | Self::BufferShort { name, .. } => {
                item(&format!("buffer {name}"))
            }
            Self::BadDataUri { buffer } => item(&format!("buffer {buffer}")),
            Self::NotFinite { vertex: VertexPlace::Obj { line: at }, .. }
            | Self::IndexOutOfRange { face: VertexPlace::Obj { line: at }, .. } => line(*at),
            Self::NotFinite { vertex, .. } => item(&vertex.to_string()),
            Self::IndexOutOfRange { face, .. } => item(&face.to_string()),
            Self::TooFar { coordinate } => {
                Place { coordinate: Some(coordinate.to_vec()), ..Place::default() }
            }
            Self::NotThisFormat { .. }
            | Self::Version { .. }
            | Self::UnsupportedExtension { .. }
            | Self::Refused { .. }
            | Self::NoTriangles { .. }
            | Self::NoPoints { .. }
            | Self::CutShort { .. }
            | Self::TooLarge { .. }
            | Self::TakesLong => Place::default(),
        }
    }

    fn remedy(&self) -> String {
        let fixed = match self {
            Self::Truncated { .. }
            | Self::CutLine { .. }
            | Self::CutShort { .. }
            | Self::BufferShort { .. } => "copy the file again, and wait until the export has ended",
            Self::NotThisFormat { .. } => {
                "export the part as GLB, as glTF with its .bin, as OBJ, STL or PLY, or a scan as PLY or list of points, and keep \
                 the ending the program gave it"
            }
            Self::Version { .. } => "export the part as glTF 2 (.glb) or OBJ",
            Self::BadJson { .. } | Self::BrokenReference { .. } | Self::DataBeyondBuffer { .. } => {
                "export the part again; if it happens again, the exporting program writes damaged files: use OBJ instead"
            }
            Self::UnsupportedExtension { name } => {
                return format!(
                    "export without compression or other extensions ({name} off), or run the file through a tool that \
                     removes them"
                );
            }
            Self::WrongData { .. } => "export without mesh quantization or compression",
            Self::NoData { .. } => "export without mesh compression (Draco, meshopt)",
            Self::BufferName { .. } => {
                "put the .bin into the part's own folder and name it there without a path, or export as GLB"
            }
            Self::BufferMissing { name, .. } => {
                return format!("drop \"{name}\" beside the .gltf, or export as GLB, which is one file");
            }
            Self::BadDataUri { .. } | Self::NodeTwice { .. } => "export the part as GLB again",
            Self::BadTransform { .. } => {
                "apply the object's transform in the modelling program and export again"
            }
            Self::NotFinite { .. } => {
                "repair the mesh in the modelling program (remove broken vertices) and export again"
            }
            Self::TooFar { .. } => {
                "delete stray vertices far from the part; if the size is wrong as a whole, set the unit with `--part-unit`"
            }
            Self::IndexOutOfRange { .. } => {
                "export the part again; the file is damaged or was edited by hand"
            }
            Self::BadHeader { .. } => {
                "write the points as lines x, y, z, or the part or scan as PLY with the vertex properties x, y and z"
            }
            Self::NoPoints { .. } => "check that the scanner saw the part, and export the scan again",
            Self::BadLine { .. } => {
                "correct this line, or export the part again with a point as decimal sign"
            }
            Self::Refused { .. } => "export the part as GLB instead",
            Self::NoTriangles { cause } => empty_remedy(cause),
            Self::TooLarge { .. } => {
                "reduce the mesh (decimate it, or export with a larger chord tolerance) or the scan (thin it out)"
            }
            Self::TakesLong => "give it more time",
        };
        fixed.into()
    }
}

fn empty_remedy(cause: &EmptyCause) -> &'static str {
    match cause {
        EmptyCause::NeverMeshed => {
            "FreeCAD without its window exports shapes that were never meshed as empty nodes: mesh the shape first \
             (MeshPart.meshFromShape), or export from the window"
        }
        EmptyCause::ArchContainer => {
            "FreeCAD's Arch exporter leaves out what is inside a container: select the bodies themselves and export again"
        }
        EmptyCause::OnlyOthers(_) => {
            "select the solid or the mesh, not its sketch or point cloud, and export again"
        }
        EmptyCause::Flat | EmptyCause::Nothing => {
            "select the part before exporting, and check that it is visible"
        }
    }
}

impl fmt::Display for VertexPlace {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gltf { mesh, primitive, vertex } => {
                write!(out, "mesh \"{mesh}\", primitive {primitive}, vertex {vertex}")
            }
            Self::Obj { line } => write!(out, "line {line}"),
            Self::Numbered { what, number } => write!(out, "{what} {number}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_says_what_where_how_much_and_what_to_do() {
        let cut = MeshReadError::Truncated { format: MeshFormat::Glb, declared: 900, actual: 512 }.reason();
        assert_eq!(cut.code, "mesh-truncated");
        assert_eq!(cut.place.byte, Some(512));
        let number = cut.number.unwrap();
        assert_eq!((number.value, number.limit, number.unit.as_str()), (512.0, Some(900.0), "bytes"));

        let vertex = VertexPlace::Gltf { mesh: "Can".into(), primitive: 3, vertex: 7 };
        let nan = MeshReadError::NotFinite { vertex, coordinate: [0.0, f64::NAN, 1.0] }.reason();
        assert_eq!(nan.place.item.as_deref(), Some("mesh \"Can\", primitive 3, vertex 7"));
        assert!(nan.what.contains("NaN"), "{}", nan.what);

        let empty = MeshReadError::NoTriangles { cause: EmptyCause::ArchContainer }.reason();
        assert!(empty.remedy.contains("select the bodies"), "{}", empty.remedy);
    }
}
