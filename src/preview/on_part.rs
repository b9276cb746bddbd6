//! The mark on the part in three dimensions, as a glTF scene for browsers, CAD and rendering programs.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::PreviewPath;
use super::ink::{self, Line};
use super::stretch_scale::{StretchScale, rgb};
use crate::formats::scene::{self, Material, Node, Primitive, Scene};
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::space::View;

/// The schema of the data in the root node's `extras.isomark`.
pub const ON_PART_SCHEMA: &str = "isomark.on-part/1";
/// Distance of the lines from the surface, mm, along its normal.
pub const LIFT: f64 = 0.02;
/// Distance of the filled regions from the surface, mm.
pub const INK_LIFT: f64 = 0.015;

/// Largest number of lines that are separate primitives; each takes 300 bytes of JSON.
const MAX_STRIPS: usize = 200;
/// Largest number of pieces of the lines of one node; beyond it neighbours are joined.
const MAX_PIECES: usize = 60_000;

const PART: Material = Material { color: [196, 202, 212], is_lit: true };
const LINES: Material = Material { color: [255, 255, 255], is_lit: false };
const INK: Material = Material { color: [31, 41, 55], is_lit: false };
const VIEW: Material = Material { color: [15, 118, 110], is_lit: false };

/// The content of the picture. Lines are in mm of the part frame, on the surface without [`LIFT`] unless stated otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct OnPart {
    /// The product.
    pub sku: String,
    /// The drawing's file name.
    pub drawing: String,
    /// Name and version of the program.
    pub program: String,
    /// The part's file name, or its sizes as text.
    pub part_file: String,
    /// The part.
    pub part: Arc<PictureMesh>,
    /// What the part's mesh was made from.
    pub part_source: PartSource,
    /// Whether the mesh has fewer triangles than the part, except under the drawing.
    pub is_part_thinned: bool,
    /// How the laser sees the part.
    pub view: View,
    /// The lines without a correction, as far as they are on the part, lifted by [`LIFT`].
    pub drawn: Vec<PreviewPath<3>>,
    /// The corrected lines, with the remaining stretch, lifted by [`LIFT`].
    pub mark: Vec<PreviewPath<3>>,
    /// The filled regions of the corrected drawing; `None` if they are too many to be shown.
    pub ink: Option<InkMesh>,
    /// The borders of the surface that the laser sees: closed lines.
    pub rims: Arc<Vec<Vec<Point3<f64>>>>,
    /// Smallest and largest measured stretch of the lines without a correction, if any line is on the part.
    pub drawn_range: Option<[f64; 2]>,
    /// Smallest and largest measured stretch of the corrected lines.
    pub mark_range: Option<[f64; 2]>,
}

/// What the part in a picture was made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PartSource {
    /// The mesh of the part's file.
    File,
    /// The sampled heights of the side that faces the laser: for scans, and where the mesh is not kept.
    Heights,
    /// The sizes of a cylinder or cone.
    Sizes,
}

impl PartSource {
    /// Its name in the file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::File => "file",
            Self::Heights => "heights",
            Self::Sizes => "sizes",
        }
    }
}

/// Filled regions as triangles, mm in the part frame, lifted by [`INK_LIFT`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InkMesh {
    /// The vertices, mm.
    pub positions: Vec<Point3<f64>>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
}

/// The picture as a binary glTF file, in metres with +Y up. Its nodes are `part`, `mark-ink`, `mark`, `drawn` and `view`,
/// without those that are empty. Long drawings are simplified, so that the file stays within a few megabytes.
#[must_use]
pub fn glb(picture: &OnPart) -> Vec<u8> {
    let (mark, drawn) = (ink::lines(&picture.mark), ink::lines(&picture.drawn));
    let scale = StretchScale::covering(ink::weighted(&drawn).chain(ink::weighted(&mark)));
    let part = Primitive::Triangles {
        positions: picture.part.positions().to_vec(),
        normals: picture.part.normals().to_vec(),
        triangles: picture.part.triangles().to_vec(),
    };
    let filled = picture.ink.as_ref().map(|ink| Primitive::Triangles {
        positions: ink.positions.iter().map(|point| single(&point.coords.into())).collect(),
        normals: Vec::new(),
        triangles: ink.triangles.clone(),
    });
    let closed = |ring: &Vec<Point3<f64>>| {
        let points = ring.iter().chain(ring.first()).map(|point| single(&point.coords.into()));
        Strip { positions: points.collect(), colors: Vec::new() }
    };
    let node = |name: &str, material: Material, primitives: Vec<Primitive>| Node {
        name: name.to_owned(),
        material,
        primitives,
    };
    let scene = Scene {
        name: "isomark-mark".into(),
        extras: json!({ "isomark": extras(picture, &scale) }),
        nodes: vec![
            node("part", PART, vec![part]),
            node("mark-ink", INK, filled.into_iter().collect()),
            node("mark", LINES, primitives(strips(&mark, &scale))),
            node("drawn", LINES, primitives(strips(&drawn, &scale))),
            node("view", VIEW, primitives(picture.rims.iter().map(closed).collect())),
        ],
    };
    scene::write(&scene, &picture.program)
}

fn extras(picture: &OnPart, scale: &StretchScale) -> Value {
    let vector =
        |vector: Vector3<f64>| <[f64; 3]>::from(picture.view.part_vector(vector).map(|value| value + 0.0));
    let is_of_file = picture.part_source == PartSource::File;
    let of_file = if is_of_file { picture.part.source_triangles() } else { 0 };
    json!({
        "schema": ON_PART_SCHEMA,
        "program": picture.program,
        "sku": picture.sku,
        "drawing": picture.drawing,
        "part": picture.part_file,
        "part_source": picture.part_source.name(),
        "part_thinned": is_of_file && picture.is_part_thinned,
        "part_triangles": picture.part.triangles().len(),
        "part_triangles_of_file": of_file,
        "stretch_range": [picture.drawn_range, picture.mark_range],
        "stretch_scale": scale.limit,
        "ink_shown": picture.ink.is_some(),
        "lift_mm": LIFT,
        "towards_laser": vector(Vector3::z()),
        "up_in_view": vector(Vector3::y()),
    })
}

/// A line in single precision.
struct Strip {
    positions: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
}

fn single(point: &[f64; 3]) -> [f32; 3] {
    point.map(|value| value as f32)
}

fn strips(lines: &[Line<3>], scale: &StretchScale) -> Vec<Strip> {
    ink::thinned(lines, MAX_PIECES).iter().map(|line| strip(line, scale)).collect()
}

/// A line with the colour of the stretch round each of its points.
fn strip(line: &Line<3>, scale: &StretchScale) -> Strip {
    let color = |index: usize| {
        let (mut sum, mut known) = (0.0, 0);
        for stretch in line.stretch.iter().take(index + 1).skip(index.saturating_sub(1)) {
            if stretch.is_finite() {
                (sum, known) = (sum + stretch, known + 1);
            }
        }
        rgb(scale.shade(sum / f64::from(known)))
    };
    Strip {
        positions: line.points.iter().map(single).collect(),
        colors: (0..line.points.len()).map(color).collect(),
    }
}

/// One primitive for each line, or one for all if there are many.
fn primitives(strips: Vec<Strip>) -> Vec<Primitive> {
    if strips.len() <= MAX_STRIPS {
        let strip = |Strip { positions, colors }| Primitive::Strip { positions, colors };
        return strips.into_iter().map(strip).collect();
    }
    let (mut positions, mut colors, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    for strip in strips {
        let (first, count) = (positions.len() as u32, strip.positions.len() as u32);
        lines.extend((1..count).map(|index| [first + index - 1, first + index]));
        positions.extend(strip.positions);
        colors.extend(strip.colors);
    }
    vec![Primitive::Lines { positions, colors, lines }]
}
