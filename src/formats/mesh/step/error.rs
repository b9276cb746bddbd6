//! Why a STEP file cannot be read.

use std::fmt;

use crate::geometry::solid::bezier::SplineError;

/// Why a STEP file cannot be read, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct StepError {
    /// Line of the file, from 1.
    pub line: u64,
    /// Number of the record, if the place is in one.
    pub record: Option<u64>,
    /// What is wrong.
    pub problem: StepProblem,
}

/// What is wrong in a STEP file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StepProblem {
    /// The file does not start as STEP files do.
    #[error("this is not a STEP file: it begins with \"{found}\"")]
    NotStep {
        /// What it begins with.
        found: String,
    },
    /// The file ends in the middle of a statement, or without an end.
    #[error("the file is cut off")]
    CutOff,
    /// The text breaks the rules of ISO 10303-21.
    #[error("there is \"{found}\" where {expected} is expected")]
    Syntax {
        /// What is expected.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// Two records have one number.
    #[error("the number is used for two records")]
    Duplicate,
    /// A record refers to one that does not exist.
    #[error("it refers to #{target}, which does not exist")]
    Missing {
        /// The number of the missing record.
        target: u64,
    },
    /// A record is of another kind than its use requires.
    #[error("it is a {found}, not a {expected}")]
    WrongKind {
        /// The kind that is required.
        expected: &'static str,
        /// The kind that it is.
        found: String,
    },
    /// A parameter is of another type than its kind requires.
    #[error("parameter {index} is not {expected}")]
    WrongValue {
        /// Number of the parameter, from 1.
        index: usize,
        /// What it must be.
        expected: &'static str,
    },
    /// A number is not in its range.
    #[error("the {what} {value} is not valid")]
    WrongNumber {
        /// What the number is.
        what: &'static str,
        /// The number as text.
        value: String,
    },
    /// A direction has no length, or two directions are the same.
    #[error("its directions do not define axes")]
    NoAxes,
    /// A record refers to itself, directly or through others.
    #[error("it contains itself")]
    Cyclic,
    /// Lists or assemblies are nested too deep.
    #[error("it is nested more than {limit} deep")]
    Nested {
        /// The limit.
        limit: usize,
    },
    /// There is too much of something.
    #[error("there are more than {limit} {what}")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
        /// The limit.
        limit: u64,
    },
    /// A unit is not known.
    #[error("the unit {name} is not known")]
    Unit {
        /// Its name.
        name: String,
    },
    /// A spline is not valid.
    #[error(transparent)]
    Spline(#[from] SplineError),
    /// A placement scales or mirrors.
    #[error("the placement scales or mirrors the part")]
    Scaled,
    /// Geometry of this kind is not read.
    #[error("{} {kind} is not read", article(.kind))]
    Unread {
        /// Its kind.
        kind: String,
    },
    /// The file has no faces.
    #[error("the file has no faces{}", skipped(.found))]
    NoFaces {
        /// What it has instead.
        found: Vec<String>,
    },
    /// The file is an assembly whose shapes are in other files.
    #[error("the file is an assembly whose shapes are in other files: {files}")]
    Elsewhere {
        /// Their names.
        files: String,
    },
}

impl StepProblem {
    /// Whether no line is its place.
    pub(crate) fn is_of_the_whole_file(&self) -> bool {
        matches!(self, Self::NotStep { .. } | Self::NoFaces { .. } | Self::Elsewhere { .. })
    }

    /// What helps.
    pub(crate) fn remedy(&self) -> &'static str {
        match self {
            Self::NotStep { .. } => "export the part as STEP again",
            Self::CutOff => "wait until the export has finished, then copy the file again",
            Self::NoFaces { .. } => {
                "select the solid before exporting; sketches, points and tessellations have no exact faces"
            }
            Self::Elsewhere { .. } => {
                "export the assembly as one STEP file, or use the file of the component that is marked"
            }
            Self::TooLarge { .. } => "export only the body that is marked",
            Self::Scaled => "apply the scale in the CAD program, and export the part again",
            Self::Syntax { .. }
            | Self::Duplicate
            | Self::Missing { .. }
            | Self::WrongKind { .. }
            | Self::WrongValue { .. }
            | Self::WrongNumber { .. }
            | Self::NoAxes
            | Self::Cyclic
            | Self::Nested { .. }
            | Self::Unit { .. }
            | Self::Spline(_) => {
                "open the file in FreeCAD and export the body as STEP again, or as GLB (File > Export)"
            }
            Self::Unread { .. } => {
                "set `converter = \"freecad\"` under [part] where FreeCAD is installed, or open the file in FreeCAD and export the \
                 body as GLB (File > Export)"
            }
        }
    }
}

fn article(kind: &str) -> &'static str {
    if kind.starts_with(['A', 'E', 'I', 'O', 'U', 'a', 'e', 'i', 'o', 'u']) { "an" } else { "a" }
}

fn skipped(found: &[String]) -> String {
    if found.is_empty() { String::new() } else { format!(", but {}", found.join(", ")) }
}

impl fmt::Display for StepError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.record {
            None if self.problem.is_of_the_whole_file() => self.problem.fmt(out),
            Some(record) => write!(out, "line {}, #{record}: {}", self.line, self.problem),
            None => write!(out, "line {}: {}", self.line, self.problem),
        }
    }
}

impl std::error::Error for StepError {}
