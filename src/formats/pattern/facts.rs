//! Facts about a drawing besides its paths.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::content::FieldUse;
use super::units::DrawingUnit;
use crate::reason::Notice;

/// What the file states, and what was assumed, repaired and skipped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PatternFacts {
    /// The program that wrote the file, if known.
    pub producer: Option<String>,
    /// The version of the format, such as `R2000 (AC1015)`.
    pub version: String,
    /// The unit of the file's numbers.
    pub unit: DrawingUnit,
    /// The reason for the unit.
    pub unit_why: String,
    /// Width and height of the pattern, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 2],
    /// The bounding rectangle of the pattern: left, bottom, right, top, mm.
    #[serde(rename = "extents_mm")]
    pub extents: [f64; 4],
    /// Number of entities of the drawing by type and layer, without those inside blocks.
    pub entities: BTreeMap<String, BTreeMap<String, usize>>,
    /// The layers of the file, including those without paths.
    pub layers: BTreeMap<String, LayerFacts>,
    /// Every entity that draws something but is not in the pattern; the content of a block is listed once per layer.
    #[serde(rename = "not_taken")]
    pub skipped: Vec<Skipped>,
    /// What was repaired, such as loose pieces joined to contours; empty for drawings read with `strict`.
    pub repairs: Vec<Repair>,
    /// What was assumed or looks unusual.
    pub notices: Vec<Notice>,
    /// The fields in texts, such as `{serial}`, with their values.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fields: Vec<FieldUse>,
    /// Facts about the picture, if the drawing is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<RasterFacts>,
}

/// A picture and how it was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RasterFacts {
    /// Columns and rows of pixels.
    pub pixels: [usize; 2],
    /// Width and height of the whole picture with its blank border, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 2],
    /// The reason for the size.
    pub size_why: String,
    /// Resolution along x and y that the file states, pixels per inch.
    pub dots_per_inch: Option<[f64; 2]>,
    /// Pixels darker than this, from black at 0 to white at 100, are marked, or lighter ones if `inverted`.
    pub threshold_percent: f64,
    /// Whether light pixels are marked instead of dark ones.
    pub inverted: bool,
    /// Number of outlines, including those of holes.
    pub contours: usize,
    /// Number of corners of all outlines.
    pub vertices: usize,
}

/// A layer of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct LayerFacts {
    /// Its colour: an index of the AutoCAD colour table or `#rrggbb`.
    pub color: String,
    /// Number of paths on it in the pattern.
    pub paths: usize,
    /// The reason if nothing on it is marked: `off`, `frozen`, `not plotted` or, in SVG, `hidden`.
    pub hidden: Option<String>,
}

/// Something that was repaired.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Repair {
    /// What was repaired, with its number.
    #[serde(flatten)]
    pub notice: Notice,
    /// The number of places.
    #[serde(default)]
    pub count: usize,
    /// The first thousand of these places.
    pub places: Vec<RepairPlace>,
}

/// Where something was repaired.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RepairPlace {
    /// Type of the entity, or of the first one if there are several, such as `LINE`.
    pub entity: String,
    /// Its handle in hexadecimal, if the file has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<String>,
    /// The layer it is drawn on.
    pub layer: String,
    /// Its start point in the drawing, mm.
    pub at_mm: [f64; 2],
    /// Number of pieces affected.
    pub pieces: usize,
    /// The widest gap that was closed, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap_mm: Option<f64>,
}

/// An entity that is not in the pattern.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Skipped {
    /// Its type, such as `MTEXT`.
    pub entity: String,
    /// Its handle in hexadecimal, if the file has one.
    pub handle: Option<String>,
    /// The layer it is drawn on.
    pub layer: String,
    /// Why it was skipped, and what to do about it.
    pub why: Cow<'static, str>,
    /// Whether something that it draws is missing in the pattern, visible in the drawing or not.
    pub is_loss: bool,
    /// Whether the missing part is ink that the drawing shows and plots, or covers such ink.
    #[serde(default)]
    pub is_ink: bool,
}

/// Number of handles in a message for each type, layer and reason.
const MAX_HANDLES: usize = 3;
/// Number of combinations of type, layer and reason in a message.
const MAX_GROUPS: usize = 6;

impl PatternFacts {
    /// The visible ink that is not in the pattern, on the layers for which `is_marked` returns true.
    pub fn lost_ink(&self, is_marked: impl Fn(&str) -> bool) -> LostInk<'_> {
        LostInk(self.skipped.iter().filter(|skipped| skipped.is_ink && is_marked(&skipped.layer)).collect())
    }
}

/// Visible ink that is not in the pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct LostInk<'f>(pub Vec<&'f Skipped>);

impl std::fmt::Display for LostInk<'_> {
    /// One line with the first entities, with handle, layer and reason, and the number of further ones.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut groups: Vec<([&str; 3], Vec<&str>)> = Vec::new();
        let mut beyond = 0;
        for skipped in &self.0 {
            let key = [skipped.entity.as_str(), skipped.layer.as_str(), skipped.why.as_ref()];
            let handle = skipped.handle.as_deref().unwrap_or("without handle");
            match groups.iter().position(|(of, _)| *of == key) {
                Some(group) => groups[group].1.push(handle),
                None if groups.len() < MAX_GROUPS => groups.push((key, vec![handle])),
                None => beyond += 1,
            }
        }
        for (index, ([entity, layer, why], handles)) in groups.iter().enumerate() {
            let more = handles.len().saturating_sub(MAX_HANDLES);
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
