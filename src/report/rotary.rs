//! A mark round a cylinder or cone in tiles: the angles of the rotary axis, and what is marked at each.

use serde::{Deserialize, Serialize};

/// Name and version of the JSON form of a [`RotaryTable`].
pub const ROTARY_SCHEMA: &str = "isomark.rotary/1";

/// A mark in tiles. The part turns by the angle of a tile from its position in the settings, right-handed about `axis`; then
/// the tile is marked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RotaryReport {
    /// Direction of the axis in the laser's frame.
    pub axis: [f64; 3],
    /// A point of the axis in the laser's frame, mm.
    pub axis_point_mm: [f64; 3],
    /// Circumference of the part where the ink is farthest from the axis, mm.
    pub circumference_mm: f64,
    /// Width of the ink round the axis, degrees.
    pub width_deg: f64,
    /// Width of the widest tile that incidence, focus and field allow, degrees.
    pub widest_deg: f64,
    /// How far two tiles overlap where a contour is cut, mm: exact on a cylinder, on a cone where the ink is farthest from
    /// the axis.
    pub overlap_mm: f64,
    /// Number of borders between tiles that cut contours; the others are in gaps.
    pub cuts_through_ink: usize,
    /// Length of all lines as drawn, mm. The lines of all tiles are longer by the overlaps and by the borders of cut fills.
    pub ink_mm: f64,
    /// The tiles, in the order of their angles on the part.
    pub tiles: Vec<TileReport>,
}

/// One tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct TileReport {
    /// Its number, from 1.
    pub tile: usize,
    /// The angle by which the part is turned, degrees: exact, with three decimals.
    pub angle_deg: f64,
    /// Its name: the beginning of its layers' names, or the ending of its file's name.
    pub name: String,
    /// The file that contains it; absent if the name of the file is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Its layers in the file.
    pub layers: Vec<String>,
    /// Where its ink begins and ends on the part, degrees about the axis from the drawing's anchor.
    pub on_part_deg: [f64; 2],
    /// Largest angle between beam and surface normal, degrees.
    pub incidence_deg: f64,
    /// Length of its lines as drawn, mm.
    pub ink_mm: f64,
    /// Number of its paths.
    pub paths: usize,
    /// Its bounding rectangle in the field: left, bottom, right, top, mm.
    pub extents_mm: [f64; 4],
}

/// The table of a mark in tiles, for the program that turns the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RotaryTable {
    /// [`ROTARY_SCHEMA`].
    pub schema: String,
    /// Name and version of the program.
    pub program: String,
    /// The product.
    pub sku: String,
    /// The drawing's file name.
    pub pattern: String,
    /// The mark.
    #[serde(flatten)]
    pub mark: RotaryReport,
}

impl RotaryTable {
    /// The JSON form, indented, with a newline at its end.
    ///
    /// # Errors
    /// Never for finite numbers.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// A table of comma-separated values with one row for each tile, and names in its first row.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut text =
            String::from("tile,angle_deg,name,file,from_deg,to_deg,incidence_deg,ink_mm,paths\r\n");
        for tile in &self.mark.tiles {
            let [from, to] = tile.on_part_deg;
            text += &format!(
                "{},{:.3},{},{},{from:.3},{to:.3},{:.2},{:.3},{}\r\n",
                tile.tile,
                tile.angle_deg,
                tile.name,
                quoted(tile.file.as_deref().unwrap_or_default()),
                tile.incidence_deg,
                tile.ink_mm,
                tile.paths,
            );
        }
        text
    }
}

/// A field of a table (RFC 4180).
fn quoted(text: &str) -> String {
    match text.contains(['"', ',', '\r', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

impl RotaryReport {
    /// One line for people.
    pub(super) fn summary(&self) -> String {
        let angles: Vec<String> = self.tiles.iter().map(|tile| format!("{:+.3}", tile.angle_deg)).collect();
        let cuts = match (self.cuts_through_ink, self.tiles.len()) {
            (_, 1) => String::new(),
            (0, _) => ", all borders in gaps of the drawing".to_owned(),
            (1, _) => format!(", 1 border through ink, overlap {:.2} mm", self.overlap_mm),
            (count, _) => format!(", {count} borders through ink, overlap {:.2} mm", self.overlap_mm),
        };
        let tiles = if self.tiles.len() == 1 { "tile" } else { "tiles" };
        format!("rotary        {} {tiles} at {} deg{cuts}", self.tiles.len(), angles.join(", "))
    }
}

impl TileReport {
    /// The report of a tile whose ink is in this rectangle of the field: left, bottom, right, top, mm.
    pub(crate) fn new(tile: usize, angle_deg: f64, name: String, extents_mm: [f64; 4]) -> Self {
        Self {
            tile,
            angle_deg,
            name,
            file: None,
            layers: Vec::new(),
            on_part_deg: [0.0; 2],
            incidence_deg: 0.0,
            ink_mm: 0.0,
            paths: 0,
            extents_mm,
        }
    }
}
