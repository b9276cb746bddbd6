//! Why a drawing was refused.

use thiserror::Error;

use crate::reason::{Place, Reason};

/// Why a drawing could not be read.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PatternReadError {
    /// The bytes are no DXF file.
    #[error("this is not a DXF file: it seems to be {seems}")]
    NotDxf {
        /// What the bytes look like, with its article.
        seems: String,
    },
    /// The file is larger than is read.
    #[error("the file has {bytes} bytes, at most {limit} are read")]
    FileTooLarge {
        /// Size of the file, bytes.
        bytes: usize,
        /// The largest size that is read, bytes.
        limit: usize,
    },
    /// The file does not end with `EOF`.
    #[error("the file ends before its EOF mark")]
    Truncated {
        /// Where the bytes end.
        spot: Spot,
    },
    /// A picture has pixels, and nothing says how large they are.
    #[error("the picture of {} x {} pixels has no size in mm", pixels[0], pixels[1])]
    PictureWithoutSize {
        /// Columns and rows of pixels.
        pixels: [usize; 2],
    },
    /// A picture has more pixels than are read.
    #[error("the picture has {} x {} pixels", pixels[0], pixels[1])]
    PictureTooLarge {
        /// Columns and rows of pixels.
        pixels: [u32; 2],
        /// The largest number of pixels of this kind that is read.
        limit: u64,
    },
    /// A picture file does not reach to its end.
    #[error("the {format} picture ends too early")]
    PictureTruncated {
        /// Its format.
        format: &'static str,
        /// Where the bytes end.
        spot: Spot,
    },
    /// A picture cannot be decoded.
    #[error("the {format} picture cannot be decoded: {what}")]
    PictureDamaged {
        /// Its format.
        format: &'static str,
        /// What is wrong.
        what: String,
    },
    /// A line that should hold a group code does not, or a binary group code does not exist.
    #[error("`{text}` is not a group code")]
    UnreadableGroupCode {
        /// Where it stands.
        spot: Spot,
        /// What stands there.
        text: String,
    },
    /// A number of an entity is not a number, or not finite.
    #[error("`{text}` is not a finite number (group code {group} of {entity})")]
    UnreadableNumber {
        /// Where it stands.
        spot: Spot,
        /// Its group code.
        group: i32,
        /// What stands there.
        text: String,
        /// The entity that it belongs to.
        entity: EntityName,
    },
    /// A coordinate is so large that nothing sensible can be meant.
    #[error("{entity} reaches {reach:e} mm from the origin")]
    OutOfRange {
        /// The entity.
        entity: EntityName,
        /// The largest coordinate, mm; not finite when the numbers overflow.
        reach: f64,
        /// The largest coordinate that is read, mm.
        limit: f64,
    },
    /// The drawing unfolds to more than can be held in memory.
    #[error("the drawing has more than {limit} {what}")]
    TooMany {
        /// What there is too much of, such as `pieces`.
        what: &'static str,
        /// The largest number that is read.
        limit: usize,
        /// The entity where the limit was reached.
        entity: Option<EntityName>,
    },
    /// It is more than a moment's work, and only a moment was given to it.
    #[error("the drawing takes longer than a moment")]
    TakesLong,
    /// A block holds itself.
    #[error("the block {block} holds itself")]
    RecursiveBlock {
        /// The block's name.
        block: String,
        /// The INSERT that closes the circle.
        entity: EntityName,
    },
    /// Nothing in the drawing can be marked.
    #[error("there is nothing to mark in the drawing: {found}")]
    NothingToMark {
        /// What was found instead, such as `3 TEXT`.
        found: String,
        /// What most likely happened and what to do, as one sentence.
        remedy: String,
    },
}

/// A place in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spot {
    /// A line of a text file, from 1.
    Line(u64),
    /// An offset in a binary file, bytes.
    Byte(u64),
}

/// How an entity is called when something is said about it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EntityName {
    /// Its type, such as `LWPOLYLINE`.
    pub kind: String,
    /// Its handle in hexadecimal, if the file has one.
    pub handle: Option<String>,
    /// Its layer.
    pub layer: String,
}

impl std::fmt::Display for EntityName {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.handle {
            Some(handle) => write!(out, "{} {handle}", self.kind),
            None => write!(out, "{}", self.kind),
        }
    }
}

impl Spot {
    fn place(self) -> Place {
        match self {
            Self::Line(line) => Place { line: Some(line), ..Place::default() },
            Self::Byte(byte) => Place { byte: Some(byte), ..Place::default() },
        }
    }
}

impl EntityName {
    fn place(&self) -> Place {
        Place { item: Some(self.to_string()), layer: Some(self.layer.clone()), ..Place::default() }
    }
}

impl PatternReadError {
    /// Whether the bytes end too early, so that more of them may still come.
    pub fn is_cut_short(&self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::PictureTruncated { .. })
    }

    /// The reason as people and machines are told.
    pub fn reason(&self) -> Reason {
        let told = |code: &str, remedy: &str| Reason::new(code, self.to_string(), remedy);
        match self {
            Self::NotDxf { .. } => told(
                "pattern-not-dxf",
                "Export the drawing as DXF (R12 to R2018, text or binary), or save the picture as PNG.",
            ),
            Self::FileTooLarge { bytes, limit } => told(
                "pattern-too-large",
                "Export only what is to be marked, with fewer points.",
            )
            .with_number("file size", *bytes as f64, "bytes", Some(*limit as f64)),
            Self::Truncated { spot } => told(
                "pattern-truncated",
                "Copy or export the file again; it was probably read or cut off while it was being written.",
            )
            .at(spot.place()),
            Self::PictureWithoutSize { .. } => told(
                "picture-size",
                "Give its width in mm: `--width` for one job, `width_mm` under [pattern] in the settings; or export it \
                 with its resolution (dpi).",
            ),
            Self::PictureTooLarge { pixels, limit } => {
                let count = pixels.map(f64::from).iter().product();
                told(
                    "picture-too-large",
                    "Export it with fewer pixels; 600 to an inch are plenty for a laser.",
                )
                .with_number("pixels", count, "", Some(*limit as f64))
            }
            Self::PictureTruncated { spot, .. } => told(
                "pattern-truncated",
                "Copy or export the file again; it was probably read or cut off while it was being written.",
            )
            .at(spot.place()),
            Self::PictureDamaged { .. } => {
                told("picture-damaged", "Open it in a picture program and save it as PNG.")
            }
            Self::UnreadableGroupCode { spot, .. } => {
                told("pattern-group-code", "Export the drawing again; the file is damaged at this place.")
                    .at(spot.place())
            }
            Self::UnreadableNumber { spot, entity, .. } => told(
                "pattern-number",
                "Export the drawing again with a point as the decimal separator, or delete this entity.",
            )
            .at(Place { line: spot.place().line, byte: spot.place().byte, ..entity.place() }),
            Self::OutOfRange { entity, reach, limit } => told(
                "pattern-out-of-range",
                "Delete the stray entity, or move the drawing near the origin and check its unit.",
            )
            .at(entity.place())
            .with_number("coordinate", *reach, "mm", Some(*limit)),
            Self::TooMany { entity, .. } => {
                let reason = told("pattern-too-many", "Simplify the drawing, or mark it in several jobs.");
                match entity {
                    Some(entity) => reason.at(entity.place()),
                    None => reason,
                }
            }
            Self::TakesLong => told("takes-long", "Give it more time."),
            Self::RecursiveBlock { entity, .. } => told(
                "pattern-recursive-block",
                "Explode the block in the drawing program, or purge and export again.",
            )
            .at(entity.place()),
            Self::NothingToMark { remedy, .. } => told("pattern-nothing-to-mark", remedy),
        }
    }
}
