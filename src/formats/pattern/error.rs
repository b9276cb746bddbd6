//! Why a drawing was refused.

use thiserror::Error;

use crate::reason::{Place, Reason};

/// Why a drawing could not be read.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PatternReadError {
    /// The bytes are not a DXF file.
    #[error("this is not a DXF file: {found}")]
    NotDxf {
        /// What the bytes seem to be, as the end of a sentence.
        found: String,
    },
    /// The file is larger than allowed.
    #[error("the file has {bytes} bytes; at most {limit} are allowed")]
    FileTooLarge {
        /// Size of the file, bytes.
        bytes: usize,
        /// The largest allowed size, bytes.
        limit: usize,
    },
    /// The file does not end with `EOF`.
    #[error("the file is cut off: it has no EOF mark at its end")]
    Truncated {
        /// Where the bytes end.
        spot: Spot,
    },
    /// An SVG file does not end with its closing tag.
    #[error("the SVG file is cut off: it has no closing </svg> at its end")]
    SvgTruncated {
        /// Where the bytes end.
        spot: Spot,
    },
    /// An SVG file is not valid XML, or has another root.
    #[error("the SVG file cannot be read: {what}")]
    SvgDamaged {
        /// Where it is.
        spot: Spot,
        /// What is wrong.
        what: String,
    },
    /// The page of an SVG drawing has a size that cannot be read.
    #[error("the `{what}` of the page {why}: {text}")]
    SvgSize {
        /// Where it is.
        spot: Spot,
        /// The attribute or property, such as `width`.
        what: &'static str,
        /// The text that it has, or why that is not known.
        text: String,
        /// What is wrong with it.
        why: &'static str,
    },
    /// A picture states no resolution, and the settings give no size.
    #[error("the picture of {} x {} pixels has no size in mm", pixels[0], pixels[1])]
    PictureWithoutSize {
        /// Columns and rows of pixels.
        pixels: [usize; 2],
    },
    /// A picture has more pixels than allowed.
    #[error("the picture is too large: {} x {} pixels", pixels[0], pixels[1])]
    PictureTooLarge {
        /// Columns and rows of pixels.
        pixels: [u32; 2],
        /// The largest allowed number of pixels of this kind.
        limit: u64,
    },
    /// A picture file is not complete.
    #[error("the {format} picture is cut off")]
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
    /// A line that must contain a group code does not, or a binary group code does not exist.
    #[error("`{text}` is not a group code")]
    UnreadableGroupCode {
        /// Where it is.
        spot: Spot,
        /// The text at this place.
        text: String,
    },
    /// A number of an entity is not a number, or not finite.
    #[error("`{text}` is not a finite number (group code {group} of {entity})")]
    UnreadableNumber {
        /// Where it is.
        spot: Spot,
        /// Its group code.
        group: i32,
        /// The text at this place.
        text: String,
        /// The entity that it belongs to.
        entity: EntityName,
    },
    /// A coordinate is too large to be plausible.
    #[error("{entity} extends to {reach:e} mm from the origin")]
    OutOfRange {
        /// The entity.
        entity: EntityName,
        /// The largest coordinate, mm; not finite when the numbers overflow.
        reach: f64,
        /// The largest allowed coordinate, mm.
        limit: f64,
    },
    /// The drawing is too large, with blocks and arrays expanded.
    #[error("the drawing has more than {limit} {what}")]
    TooMany {
        /// What exceeds its limit, such as `pieces`.
        what: &'static str,
        /// The largest allowed number.
        limit: usize,
        /// The entity where the limit was reached.
        entity: Option<EntityName>,
    },
    /// The drawing needs more time than [`Pace::Quick`](crate::formats::Pace::Quick) allows.
    #[error("reading the drawing takes longer than allowed here")]
    TakesLong,
    /// A block contains itself.
    #[error("the block {block} contains itself")]
    RecursiveBlock {
        /// The block's name.
        block: String,
        /// The INSERT that closes the cycle.
        entity: EntityName,
    },
    /// The settings ask for a sheet in paper space, and it is not clear which.
    #[error("{}", unclear_sheet(asked.as_deref(), sheets))]
    UnclearSheet {
        /// The name in the settings.
        asked: Option<String>,
        /// The names of the sheets with content.
        sheets: Vec<String>,
    },
    /// Nothing in the drawing can be marked.
    #[error("there is nothing to mark in the drawing: {found}")]
    NothingToMark {
        /// What was found instead, such as `3 TEXT`.
        found: String,
        /// What to do, with the likely cause, as one sentence.
        remedy: String,
    },
}

fn unclear_sheet(asked: Option<&str>, sheets: &[String]) -> String {
    let names = || sheets.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    match (asked, sheets.is_empty()) {
        (_, true) => "no sheet in paper space has content".into(),
        (None, false) => format!("{} sheets in paper space have content: {}", sheets.len(), names()),
        (Some(asked), false) => {
            format!("the drawing has no sheet \"{asked}\" in paper space with content, but {}", names())
        }
    }
}

/// A place in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spot {
    /// A line of a text file, from 1.
    Line(u64),
    /// An offset in a binary file, bytes.
    Byte(u64),
}

/// An entity's type, handle and layer, for messages.
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

/// What a file without content looks like.
pub(super) const EMPTY: &str = "it is empty";

impl PatternReadError {
    /// Whether the file ends too early, so that it may still be being written.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::SvgTruncated { .. } | Self::PictureTruncated { .. })
    }

    /// The error as a reason about the file of this name, whose extension states what it should be.
    pub fn reason_for(&self, file_name: &str) -> Reason {
        let kind = match file_name
            .rsplit_once('.')
            .map(|(_, extension)| extension.to_ascii_lowercase())
            .as_deref()
        {
            Some("png") => Some(("a PNG picture", "Save the picture as PNG again.")),
            Some("bmp") => Some(("a BMP picture", "Save the picture as BMP again, or as PNG.")),
            Some("svg") => Some(("an SVG drawing", "Export the drawing as plain SVG again.")),
            _ => None,
        };
        let reason = match (self, kind) {
            (Self::NotDxf { found }, Some((kind, remedy))) if found != EMPTY => {
                // "Another" is one other than DXF.
                let found = found.replace("another ", "a ");
                Reason::new("pattern-not-dxf", format!("this is not {kind}: {found}"), remedy)
            }
            _ => self.reason(),
        };
        reason.in_file(file_name)
    }

    /// The error as a reason: code, sentence, place, number and remedy. The caller adds the file's name.
    pub fn reason(&self) -> Reason {
        let reason = |code: &str, remedy: &str| Reason::new(code, self.to_string(), remedy);
        match self {
            Self::NotDxf { found } if found == EMPTY => {
                Reason::new("pattern-not-dxf", "The file is empty.", "Export or copy it again.")
            }
            Self::NotDxf { .. } => reason(
                "pattern-not-dxf",
                "Export the drawing as DXF (R12 to R2018, text or binary) or plain SVG, or save the picture as PNG.",
            ),
            Self::FileTooLarge { bytes, limit } => {
                reason("pattern-too-large", "Export only the entities to be marked, with fewer points.")
                    .with_number("file size", *bytes as f64, "bytes", Some(*limit as f64))
            }
            Self::SvgDamaged { spot, .. } => {
                reason("svg-damaged", "Export the drawing again as plain SVG.").at(spot.place())
            }
            Self::SvgSize { spot, .. } => reason(
                "svg-size",
                "Export the drawing with its width and height in mm and no other style of the page's size, or correct it in a text \
                 editor: `width=\"40mm\" height=\"20mm\" viewBox=\"0 0 40 20\"`.",
            )
            .at(spot.place()),
            Self::Truncated { spot } | Self::SvgTruncated { spot } => reason(
                "pattern-truncated",
                "Copy or export the file again; the copy or export was probably interrupted.",
            )
            .at(spot.place()),
            Self::PictureWithoutSize { .. } => reason(
                "picture-size",
                "Give its width in mm (`--width` for one job, `width_mm` under [pattern] in the settings), or export \
                 it with its resolution (dpi).",
            ),
            Self::PictureTooLarge { pixels, limit } => {
                let count = pixels.map(f64::from).iter().product();
                reason(
                    "picture-too-large",
                    "Export it with fewer pixels; 600 pixels per inch are enough for a laser.",
                )
                .with_number("pixels", count, "", Some(*limit as f64))
            }
            Self::PictureTruncated { spot, .. } => reason(
                "pattern-truncated",
                "Copy or export the file again; the copy or export was probably interrupted.",
            )
            .at(spot.place()),
            Self::PictureDamaged { .. } => {
                reason("picture-damaged", "Open it in a picture program and save it as PNG.")
            }
            Self::UnreadableGroupCode { spot, .. } => {
                reason("pattern-group-code", "Export the drawing again; the file is damaged at this place.")
                    .at(spot.place())
            }
            Self::UnreadableNumber { spot, entity, .. } => reason(
                "pattern-number",
                "Export the drawing again with a decimal point in numbers, or delete this entity.",
            )
            .at(Place { line: spot.place().line, byte: spot.place().byte, ..entity.place() }),
            Self::OutOfRange { entity, reach, limit } => reason(
                "pattern-out-of-range",
                "Delete the stray entity, or move the drawing near the origin and check its unit.",
            )
            .at(entity.place())
            .with_number("coordinate", *reach, "mm", Some(*limit)),
            Self::TooMany { entity, .. } => {
                let reason = reason("pattern-too-many", "Simplify the drawing, or mark it in several jobs.");
                match entity {
                    Some(entity) => reason.at(entity.place()),
                    None => reason,
                }
            }
            Self::TakesLong => reason("takes-long", "Read the drawing without a time limit."),
            Self::RecursiveBlock { entity, .. } => reason(
                "pattern-recursive-block",
                "Explode the block in the drawing program, or purge the drawing and export it again.",
            )
            .at(entity.place()),
            Self::UnclearSheet { sheets, .. } => match sheets.first() {
                Some(first) => reason(
                    "sheet-unclear",
                    &format!(
                        "Name the sheet: `space = \"paper:{first}\"` under [pattern] (`--space \"paper:{first}\"`)."
                    ),
                ),
                None => reason("sheet-unclear", "Set `space = \"model\"` under [pattern] (`--space model`)."),
            },
            Self::NothingToMark { remedy, .. } => reason("pattern-nothing-to-mark", remedy),
        }
    }
}
