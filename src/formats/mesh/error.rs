//! Why a part file cannot be read, as data and as a reason with a remedy.

use std::borrow::Cow;
use std::fmt;
use std::io;

use crate::geometry::mesh::TriMesh;
use crate::reason::{Place, Reason};

use super::{Content, MeshFormat, StepError, StepProblem};

/// Why a part file cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshReadError {
    /// A STEP file cannot be read.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A binary file is shorter than its header states.
    #[error("the {format} file is cut off: it has {actual} of {declared} bytes")]
    Truncated {
        /// The format read.
        format: MeshFormat,
        /// Length that the header states, bytes.
        declared: u64,
        /// Actual length, bytes.
        actual: u64,
    },
    /// The last line of a text file ends in the middle of a statement.
    #[error("the file is cut off: its last line is \"{text}\"")]
    CutLine {
        /// Line, from 1.
        line: u64,
        /// Beginning of the line.
        text: String,
    },
    /// A text file has fewer entries than its header states.
    #[error("the {format} file is cut off: it has {actual} of {declared} {what}")]
    CutShort {
        /// The format read.
        format: MeshFormat,
        /// What is missing, such as `vertices`.
        what: String,
        /// The number that the header states.
        declared: u64,
        /// The actual number.
        actual: u64,
    },
    /// The header of a PLY file, or the lines above a list of points, cannot be used.
    #[error("the header of the {format} file is not valid: {problem}")]
    BadHeader {
        /// The format read.
        format: MeshFormat,
        /// Line, from 1.
        line: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The bytes are not in this format.
    #[error("this is not a file in {format} format: it begins with {found}")]
    NotThisFormat {
        /// The format that was to be read.
        format: MeshFormat,
        /// What was found instead.
        found: String,
    },
    /// The file has no bytes.
    #[error("the file is empty")]
    EmptyFile,
    /// The lines of a list of points have too few numbers.
    #[error("the list of points has {columns} {}; it needs x, y and z", if *columns == 1 { "column" } else { "columns" })]
    TooFewColumns {
        /// First line of numbers, from 1.
        line: u64,
        /// Numbers in that line.
        columns: usize,
    },
    /// A list of points has no line of numbers.
    #[error("the list of points has {found} but no points")]
    NoRows {
        /// What it has instead, such as `a header`.
        found: &'static str,
    },
    /// The columns of a list of points are separated by commas, and so are the decimals.
    #[error("the numbers seem to have decimal commas")]
    DecimalCommas {
        /// First line of numbers, from 1.
        line: u64,
    },
    /// The bytes are in another known format.
    #[error("this is not a file in {format} format: it is {found}")]
    OtherFormat {
        /// The format that the name states.
        format: MeshFormat,
        /// The format of the bytes.
        found: Content,
    },
    /// A glTF version other than 2.
    #[error("the file is glTF {version}; only glTF 2 can be read")]
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
        /// The message of the JSON reader.
        message: String,
    },
    /// An entry of the glTF JSON refers to another one that does not exist.
    #[error("{item} refers to {kind} {index}, but the file has only {count}")]
    BrokenReference {
        /// The entry with the reference.
        item: String,
        /// The kind of the missing entry, such as `accessor`.
        kind: &'static str,
        /// The number of the missing entry, from 0.
        index: usize,
        /// How many entries of this kind there are.
        count: usize,
    },
    /// The file requires an extension that is not supported.
    #[error("the file requires the extension {name}, which is not supported")]
    UnsupportedExtension {
        /// The extension's name.
        name: String,
    },
    /// An entry of a 3MF package cannot be read.
    #[error("{item} of the 3MF file cannot be read: {problem}")]
    Package {
        /// The entry, such as `3d/3dmodel.model`.
        item: String,
        /// Where in the decompressed entry, bytes.
        byte: Option<u64>,
        /// What is wrong with it.
        problem: String,
    },
    /// Compressed geometry of a glTF file cannot be decoded.
    #[error("the compressed data of {item} cannot be decoded: {problem}")]
    Compressed {
        /// What the data are for.
        item: String,
        /// What is wrong with them.
        problem: String,
    },
    /// The data of an accessor do not have the type that their use requires.
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
    /// The data of an accessor extend beyond their buffer.
    #[error("{item} needs {needed} bytes, but its buffer has only {available}")]
    DataBeyondBuffer {
        /// What the data are for.
        item: String,
        /// Bytes needed from the start of the buffer or view.
        needed: u64,
        /// Bytes available.
        available: u64,
    },
    /// A buffer's name leads out of the part's folder, or is not a file name.
    #[error("the buffer name \"{name}\" is not a plain file name in the part's folder")]
    BufferName {
        /// The name as written.
        name: String,
    },
    /// A buffer file beside the part cannot be read.
    #[error("the buffer \"{name}\" cannot be read: {kind}")]
    BufferMissing {
        /// The file's name.
        name: String,
        /// The error from the file system.
        kind: io::ErrorKind,
    },
    /// A buffer is shorter than the JSON states.
    #[error("the buffer {name} has {actual} bytes, but {declared} are needed")]
    BufferShort {
        /// The file's name, or the number of a buffer that is not a file.
        name: String,
        /// Length that the JSON states, bytes.
        declared: u64,
        /// Actual length, bytes.
        actual: u64,
    },
    /// A data URI cannot be decoded.
    #[error("the data of buffer {buffer} in the JSON are not valid base64")]
    BadDataUri {
        /// Number of the buffer, from 0.
        buffer: usize,
    },
    /// A node's translation, rotation or scale is not finite.
    #[error("the transform of {node} is not finite")]
    BadTransform {
        /// The node.
        node: String,
    },
    /// The node of the marking frame has a transform without directions.
    #[error("the marking frame, node `isomark`, has a scale of zero or axes that coincide")]
    FrameWithoutAxes,
    /// The node of the marking frame has a transform that mirrors.
    #[error(
        "the marking frame, node `isomark`, is mirrored by a negative scale, so the direction of the drawing is unknown"
    )]
    FrameMirrored,
    /// A node is its own descendant, or the child of two nodes.
    #[error("{node} appears twice in the node tree")]
    NodeTwice {
        /// The node.
        node: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("a vertex has the invalid coordinates ({}, {}, {})", coordinate[0], coordinate[1], coordinate[2])]
    NotFinite {
        /// Where the vertex is.
        vertex: VertexPlace,
        /// The coordinates as read.
        coordinate: [f64; 3],
    },
    /// A coordinate is larger than [`TriMesh::LARGEST_COORDINATE`].
    #[error("a vertex is too far away, at ({:.0}, {:.0}, {:.0}) mm", coordinate[0], coordinate[1], coordinate[2])]
    TooFar {
        /// The coordinates, mm.
        coordinate: [f64; 3],
    },
    /// A face refers to a vertex or normal that does not exist.
    #[error("a face refers to {kind} {index}, but there are only {count}")]
    IndexOutOfRange {
        /// Where the face is.
        face: VertexPlace,
        /// What is missing: `vertex` or `normal`.
        kind: &'static str,
        /// The index as written.
        index: i64,
        /// How many vertices or normals there are.
        count: usize,
    },
    /// A line of a text file is not valid.
    #[error("the line \"{text}\" cannot be read: {problem}")]
    BadLine {
        /// Line, from 1.
        line: u64,
        /// Beginning of the line.
        text: String,
        /// What is wrong with it.
        problem: Cow<'static, str>,
    },
    /// The parser refuses a file that passed the checks here.
    #[error("the {format} file cannot be read: {message}")]
    Refused {
        /// The format read.
        format: MeshFormat,
        /// The message of the parser.
        message: String,
    },
    /// There is no triangle with an area.
    #[error("the file contains no triangle with an area{}", likely_cause(cause))]
    NoTriangles {
        /// The likely cause.
        cause: EmptyCause,
    },
    /// There is no measured point.
    #[error("the file contains no measured points{}", all_missing(*missing))]
    NoPoints {
        /// Number of points that are marked as missing, at infinity or too far away.
        missing: usize,
    },
    /// All points of a scan are beyond [`TriMesh::LARGEST_COORDINATE`], as in the coordinates of a map.
    #[error(
        "all {points} points of the scan are too far from the origin, the first at ({:.0}, {:.0}, {:.0}) mm",
        coordinate[0], coordinate[1], coordinate[2]
    )]
    ScanTooFar {
        /// Number of points.
        points: usize,
        /// The coordinates of the first, mm.
        coordinate: [f64; 3],
    },
    /// The file exceeds a size limit.
    #[error("the file has {count} {what}; the limit is {limit}")]
    TooLarge {
        /// What exceeds its limit, such as `triangles`.
        what: &'static str,
        /// How many there are, at least.
        count: u64,
        /// How many can be read.
        limit: u64,
    },
    /// The part needs more time than [`Pace::Quick`](crate::formats::Pace::Quick) allows.
    #[error("reading the part takes longer than allowed here")]
    TakesLong,
}

/// Where a vertex or face is in its file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum VertexPlace {
    /// In a primitive of a glTF file.
    Gltf {
        /// The mesh's name or number.
        mesh: String,
        /// Number of the primitive in its mesh, from 0.
        primitive: usize,
        /// Number of the vertex, or of the corner that refers to it, from 0.
        vertex: usize,
    },
    /// In a line of a text file.
    Obj {
        /// Line, from 1.
        line: u64,
    },
    /// A numbered entry of a binary file.
    Numbered {
        /// The kind of entry, such as `facet`.
        what: &'static str,
        /// Its number, from 0.
        number: usize,
    },
}

/// The likely cause of a part file without triangles.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum EmptyCause {
    /// An OpenCASCADE program such as FreeCAD exported a shape without meshing it first.
    NeverMeshed,
    /// FreeCAD's Arch exporter exported a container without the bodies in it.
    ArchContainer,
    /// There are only other things, such as lines or points.
    OnlyOthers(Vec<String>),
    /// The corners of every triangle are in one line.
    Flat,
    /// There is nothing usable.
    Nothing,
}

fn likely_cause(cause: &EmptyCause) -> String {
    match cause {
        EmptyCause::NeverMeshed => ": the exporting program did not mesh the shape".into(),
        EmptyCause::ArchContainer => ": a FreeCAD container was exported without its bodies".into(),
        EmptyCause::OnlyOthers(others) => format!(", only {}", others.join(", ")),
        EmptyCause::Flat | EmptyCause::Nothing => String::new(),
    }
}

fn all_missing(missing: usize) -> String {
    if missing == 0 {
        String::new()
    } else {
        format!(": all {missing} points are missing, at infinity or too far away")
    }
}

impl MeshReadError {
    /// The error as a reason: code, sentence, place, number and remedy. The caller adds the file's name.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let reason = Reason::new(self.code(), self.to_string(), self.remedy()).at(self.place());
        match self {
            Self::Truncated { actual, .. } | Self::BufferShort { actual, .. } => {
                reason.with_number("bytes present", *actual as f64, "", None)
            }
            Self::CutShort { what, actual, .. } => {
                reason.with_number(&format!("{what} present"), *actual as f64, "", None)
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
            Self::TooFar { coordinate } | Self::ScanTooFar { coordinate, .. } => {
                let farthest = coordinate.iter().fold(0.0f64, |farthest, value| farthest.max(value.abs()));
                reason.with_number("coordinate", farthest, "mm", Some(TriMesh::LARGEST_COORDINATE))
            }
            _ => reason,
        }
    }

    /// Whether the file ends too early, so that it may still be being written.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        let is_cut_step = matches!(self, Self::Step(StepError { problem: StepProblem::CutOff, .. }));
        let is_cut = matches!(self, Self::Truncated { .. } | Self::CutLine { .. } | Self::CutShort { .. });
        is_cut_step || is_cut || *self == Self::EmptyFile
    }

    fn code(&self) -> &'static str {
        match self {
            Self::Step(error) => step_code(&error.problem),
            Self::Truncated { .. } | Self::CutLine { .. } | Self::CutShort { .. } => "mesh-truncated",
            Self::BadHeader { .. } | Self::TooFewColumns { .. } => "mesh-header-invalid",
            Self::NoPoints { .. } | Self::NoRows { .. } => "scan-empty",
            Self::NotThisFormat { .. } | Self::OtherFormat { .. } | Self::EmptyFile => "mesh-wrong-format",
            Self::Package { .. } => "mesh-package-invalid",
            Self::Compressed { .. } => "mesh-compression-invalid",
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
            Self::FrameWithoutAxes => "frame-without-axes",
            Self::FrameMirrored => "frame-mirrored",
            Self::NodeTwice { .. } => "mesh-node-cycle",
            Self::NotFinite { .. } => "mesh-coordinate-not-finite",
            Self::TooFar { .. } | Self::ScanTooFar { .. } => "mesh-coordinate-too-far",
            Self::IndexOutOfRange { .. } => "mesh-index-out-of-range",
            Self::BadLine { .. } | Self::DecimalCommas { .. } => "mesh-line-invalid",
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
            Self::Step(StepError { line, record, problem }) => Place {
                line: (!problem.is_of_the_whole_file()).then_some(*line),
                item: record.map(|record| format!("#{record}")),
                ..Place::default()
            },
            Self::Truncated { actual, .. } => Place { byte: Some(*actual), ..Place::default() },
            Self::CutLine { line: at, .. }
            | Self::BadLine { line: at, .. }
            | Self::TooFewColumns { line: at, .. }
            | Self::DecimalCommas { line: at }
            | Self::BadHeader { line: at, .. } => line(*at),
            Self::BadJson { line, column, .. } => {
                Place { line: Some(*line), column: Some(*column), ..Place::default() }
            }
            Self::BrokenReference { item: at, .. }
            | Self::WrongData { item: at, .. }
            | Self::NoData { item: at }
            | Self::DataBeyondBuffer { item: at, .. }
            | Self::Compressed { item: at, .. }
            | Self::BadTransform { node: at }
            | Self::NodeTwice { node: at } => item(at),
            Self::FrameWithoutAxes | Self::FrameMirrored => item("node \"isomark\""),
            Self::BufferName { name } | Self::BufferMissing { name, .. } | Self::BufferShort { name, .. } => {
                item(&format!("buffer {name}"))
            }
            Self::BadDataUri { buffer } => item(&format!("buffer {buffer}")),
            Self::NotFinite { vertex: VertexPlace::Obj { line: at }, .. }
            | Self::IndexOutOfRange { face: VertexPlace::Obj { line: at }, .. } => line(*at),
            Self::NotFinite { vertex, .. } => item(&vertex.to_string()),
            Self::IndexOutOfRange { face, .. } => item(&face.to_string()),
            Self::TooFar { coordinate } | Self::ScanTooFar { coordinate, .. } => {
                Place { coordinate: Some(coordinate.to_vec()), ..Place::default() }
            }
            Self::Package { item: at, byte, .. } => Place { byte: *byte, ..item(at) },
            Self::NotThisFormat { .. }
            | Self::OtherFormat { .. }
            | Self::EmptyFile
            | Self::NoRows { .. }
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
            Self::Step(error) => error.problem.remedy(),
            Self::Truncated { .. }
            | Self::CutLine { .. }
            | Self::CutShort { .. }
            | Self::BufferShort { .. } => "wait until the export has finished, then copy the file again",
            Self::NotThisFormat { .. } => {
                "export the part as STEP, GLB, glTF with its .bin, OBJ, STL, PLY or 3MF, or a scan as PLY or a list of points, \
                 and keep the extension that the program gave it"
            }
            Self::EmptyFile => "export or copy it again",
            Self::TooFewColumns { .. } | Self::NoRows { .. } => {
                "export the scan again with one point per line: x, y, z"
            }
            Self::DecimalCommas { .. } => "export the scan with decimal points",
            Self::OtherFormat { found, .. } => return found.remedy(),
            Self::Version { .. } => {
                "export the part as glTF 2 (.glb) or OBJ, or convert it (`gltf-pipeline -i old.gltf -o new.glb`)"
            }
            Self::Package { .. } => "export the part as 3MF again, or as GLB",
            Self::Compressed { .. } => {
                "export the part again; if that does not help, export it without compression"
            }
            Self::BadJson { .. } | Self::BrokenReference { .. } | Self::DataBeyondBuffer { .. } => {
                "export the part again; if that does not help, the program writes damaged files: export OBJ instead"
            }
            Self::UnsupportedExtension { name } => {
                return format!(
                    "export the part without {name} (compression or another extension), or remove it with a glTF tool"
                );
            }
            Self::WrongData { .. } => {
                "export the part again with positions as 32-bit floats, without compression"
            }
            Self::NoData { .. } => {
                "export the part again; if it happens again, export it as OBJ or without compression"
            }
            Self::BufferName { .. } => {
                "put the .bin into the part's folder and refer to it without a path, or export the part as GLB"
            }
            Self::BufferMissing { name, .. } => {
                return format!(
                    "put \"{name}\" beside the .gltf, or export the part as GLB, which is a single file"
                );
            }
            Self::BadDataUri { .. } | Self::NodeTwice { .. } => "export the part as GLB again",
            Self::BadTransform { .. } => {
                "apply the object's transform in the modelling program and export again"
            }
            Self::FrameWithoutAxes => "give the empty `isomark` a scale of 1 and export again",
            Self::FrameMirrored => {
                "give the empty `isomark` and the objects that it belongs to (its parents) a positive scale and export again"
            }
            Self::NotFinite { .. } => {
                "repair the mesh in the modelling program (remove broken vertices) and export again"
            }
            Self::TooFar { .. } => {
                "delete stray vertices far from the part; if the whole part is too large, set `unit` under [part] (`--part-unit`)"
            }
            Self::IndexOutOfRange { .. } => {
                "export the part again; the file is damaged or was edited by hand"
            }
            Self::BadHeader { .. } => {
                "write the points as lines of x, y and z, or export a PLY file whose vertices have the properties x, y \
                 and z"
            }
            Self::ScanTooFar { .. } => {
                "subtract the offset of the coordinate system from all points in the scanner's program, so that the part is near the \
                 origin; if the numbers are not millimetres, set `unit` under [part] (`--part-unit`)"
            }
            Self::NoPoints { .. } => "check that the scanner captured the part, and export the scan again",
            Self::BadLine { .. } => "correct this line, or export the part again",
            Self::Refused { .. } => "export the part as GLB instead",
            Self::NoTriangles { cause } => empty_remedy(cause),
            Self::TooLarge { .. } => {
                "reduce the mesh (decimate it, or export it with a larger chord tolerance), or thin out the scan"
            }
            Self::TakesLong => "read the part without a time limit",
        };
        fixed.into()
    }
}

fn step_code(problem: &StepProblem) -> &'static str {
    match problem {
        StepProblem::NotStep { .. } => "mesh-wrong-format",
        StepProblem::CutOff => "mesh-truncated",
        StepProblem::NoFaces { .. } | StepProblem::Elsewhere { .. } => "mesh-empty",
        StepProblem::TooLarge { .. } => "mesh-too-large",
        StepProblem::Syntax { .. }
        | StepProblem::Duplicate
        | StepProblem::Missing { .. }
        | StepProblem::WrongKind { .. }
        | StepProblem::WrongValue { .. }
        | StepProblem::WrongNumber { .. }
        | StepProblem::NoAxes
        | StepProblem::Cyclic
        | StepProblem::Nested { .. }
        | StepProblem::Unit { .. }
        | StepProblem::Spline(_)
        | StepProblem::Scaled => "step-invalid",
        StepProblem::Unread { .. } => "step-face-unread",
    }
}

fn empty_remedy(cause: &EmptyCause) -> &'static str {
    match cause {
        EmptyCause::NeverMeshed => {
            "mesh the shape first (MeshPart.meshFromShape), or export it from FreeCAD's window: without its window, \
             FreeCAD exports shapes that have no mesh as empty nodes"
        }
        EmptyCause::ArchContainer => {
            "select the bodies themselves and export again: FreeCAD's Arch exporter leaves out what is in a container"
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
    fn a_reason_has_sentence_place_number_and_remedy() {
        let cut = MeshReadError::Truncated { format: MeshFormat::Glb, declared: 900, actual: 512 }.reason();
        assert_eq!(cut.code, "mesh-truncated");
        assert_eq!(cut.place.byte, Some(512));
        let number = cut.number.unwrap();
        assert_eq!((number.name.as_str(), number.value, number.limit), ("bytes present", 512.0, None));
        assert!(cut.what.contains("512 of 900 bytes"), "{}", cut.what);

        let vertex = VertexPlace::Gltf { mesh: "Can".into(), primitive: 3, vertex: 7 };
        let nan = MeshReadError::NotFinite { vertex, coordinate: [0.0, f64::NAN, 1.0] }.reason();
        assert_eq!(nan.place.item.as_deref(), Some("mesh \"Can\", primitive 3, vertex 7"));
        assert!(nan.what.contains("NaN"), "{}", nan.what);

        let empty = MeshReadError::NoTriangles { cause: EmptyCause::ArchContainer }.reason();
        assert!(empty.remedy.contains("Select the bodies"), "{}", empty.remedy);
    }
}
