//! What was found in a drawing besides its paths.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::units::DrawingUnit;
use crate::reason::Notice;

/// What the file says of itself, and what was assumed, repaired and left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PatternFacts {
    /// The program that wrote the file, as far as it can be told.
    pub producer: Option<String>,
    /// The dialect, such as `R2000 (AC1015)`.
    pub version: String,
    /// The unit of the file's numbers.
    pub unit: DrawingUnit,
    /// What decided the unit.
    pub unit_why: String,
    /// Width and height of what is drawn, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 2],
    /// The rectangle round what is drawn: left, bottom, right, top, mm.
    #[serde(rename = "extents_mm")]
    pub extents: [f64; 4],
    /// Number of entities of the drawing (those inside blocks not counted) by type and layer.
    pub entities: BTreeMap<String, BTreeMap<String, usize>>,
    /// The layers of the file, those without paths too.
    pub layers: BTreeMap<String, LayerFacts>,
    /// Everything that draws something in the file and not in the pattern; what a block holds is named once for each layer.
    #[serde(rename = "not_taken")]
    pub skipped: Vec<Skipped>,
    /// What was repaired, such as loose pieces joined to contours; empty for drawings read strictly.
    pub repairs: Vec<Repair>,
    /// What was assumed or looks unusual.
    pub notices: Vec<Notice>,
    /// What is known of the picture, if the drawing is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<RasterFacts>,
}

/// A picture and how it was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RasterFacts {
    /// Columns and rows of pixels.
    pub pixels: [usize; 2],
    /// Width and height of the whole picture with its blank border, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 2],
    /// What decided the size.
    pub size_why: String,
    /// Resolution along x and y that the file names, pixels to an inch.
    pub dots_per_inch: Option<[f64; 2]>,
    /// Pixels darker than this, from black at 0 to white at 100, are marked, or lighter ones if `inverted`.
    pub threshold_percent: f64,
    /// Whether light pixels are marked instead of dark ones.
    pub inverted: bool,
    /// Number of outlines, those of holes too.
    pub contours: usize,
    /// Number of their corners.
    pub vertices: usize,
}

/// A layer of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayerFacts {
    /// Its colour: an index of the AutoCAD colour table or `#rrggbb`.
    pub color: String,
    /// Number of paths on it in the pattern.
    pub paths: usize,
    /// Why nothing on it is marked: `off`, `frozen` or `not plotted`.
    pub hidden: Option<String>,
}

/// Something that was repaired.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repair {
    /// What was repaired, with its number.
    #[serde(flatten)]
    pub notice: Notice,
    /// In how many places it was repaired.
    #[serde(default)]
    pub count: usize,
    /// These places, the first thousand of them.
    pub places: Vec<RepairPlace>,
}

/// Where something was repaired.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RepairPlace {
    /// Type of the entity, or of the first of several, such as `LINE`.
    pub entity: String,
    /// Its handle in hexadecimal, if the file has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<String>,
    /// The layer it is drawn on.
    pub layer: String,
    /// Where it begins in the drawing, mm.
    pub at_mm: [f64; 2],
    /// Number of pieces concerned.
    pub pieces: usize,
    /// The widest gap that was closed, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_mm: Option<f64>,
}

/// An entity that is not in the pattern.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skipped {
    /// Its type, such as `MTEXT`.
    pub entity: String,
    /// Its handle in hexadecimal, if the file has one.
    pub handle: Option<String>,
    /// The layer it is drawn on.
    pub layer: String,
    /// Why it was left out, and what can be done about it.
    pub why: Cow<'static, str>,
    /// Whether something that it draws is missing now, visible in the drawing or not.
    pub is_loss: bool,
    /// Whether that is ink which the drawing shows and plots, or a cover over such ink.
    #[serde(default)]
    pub is_ink: bool,
}

/// Entities that a list names in full, of each kind, layer and reason.
const MOST_HANDLES: usize = 3;
/// Kinds, layers and reasons that a list names.
const MOST_GROUPS: usize = 6;

impl PatternFacts {
    /// The visible ink that is not in the pattern, on the layers for which `counts` says yes.
    pub fn lost_ink(&self, counts: impl Fn(&str) -> bool) -> LostInk<'_> {
        LostInk(self.skipped.iter().filter(|left| left.is_ink && counts(&left.layer)).collect())
    }
}

/// Visible ink that is not in the pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct LostInk<'f>(pub Vec<&'f Skipped>);

impl std::fmt::Display for LostInk<'_> {
    /// The first entities with handle, layer and reason, and how many more there are; one line.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut groups: Vec<([&str; 3], Vec<&str>)> = Vec::new();
        let mut beyond = 0;
        for left in &self.0 {
            let key = [left.entity.as_str(), left.layer.as_str(), left.why.as_ref()];
            let handle = left.handle.as_deref().unwrap_or("without handle");
            match groups.iter().position(|(of, _)| *of == key) {
                Some(group) => groups[group].1.push(handle),
                None if groups.len() < MOST_GROUPS => groups.push((key, vec![handle])),
                None => beyond += 1,
            }
        }
        for (index, ([entity, layer, why], handles)) in groups.iter().enumerate() {
            let more = handles.len().saturating_sub(MOST_HANDLES);
            let separator = if index > 0 { "; " } else { "" };
            write!(out, "{separator}{entity} {}", handles[..handles.len() - more].join(", "))?;
            if more > 0 {
                write!(out, " and {more} more")?;
            }
            write!(out, " on layer {layer}: {why}")?;
        }
        if beyond > 0 { write!(out, "; and {beyond} more") } else { Ok(()) }
    }
}
