//! The mark on the part: from a corrected drawing to the picture in three dimensions.

use std::sync::Arc;

use nalgebra::{Point3, Vector2, Vector3};

use super::landmarks::view_of;
use super::marked::{DrawnPart, Marked};
use super::preview::{lifted, piece, uncorrected};
use super::{LearnedPart, Pipeline, program};
use crate::config::Sku;
use crate::geometry::ink_mesh::FlatMesh;
use crate::geometry::pattern::{Pattern, Segment, Shape};
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::rims::rims;
use crate::geometry::space::{Extents, FlatPoint, View, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;
use crate::preview::{INK_LIFT, InkMesh, LIFT, OnPart, PartSource, PreviewPath};

/// Largest number of points of the surface's borders.
const MAX_RIM_POINTS: usize = 20_000;
/// Largest number of points of filled regions, as drawn.
const MAX_INK_POINTS: usize = 60_000;
/// Number of vertices of filled regions on the part that is not exceeded to follow it more closely.
const MAX_INK_VERTICES: usize = 15_000;
/// Largest number of vertices that are added to the part under the drawing.
const MAX_ADDED: usize = 10_000;
/// Distance round the drawing in which the part follows the surface at least, mm.
const MARGIN: f64 = 1.0;
/// The sides of this area are at multiples of this, mm: drawings of almost the same size have the same part.
const AREA_STEP: f64 = 5.0;
/// Length of the line that shows a dot, mm: a line needs two points.
const DOT: f64 = 0.1;

impl Pipeline {
    /// The picture of a corrected drawing on its part. The part's mesh is that of the file, as the cache keeps it; without
    /// it, the picture shows the side that faces the laser ([`PartSource::Heights`]).
    #[must_use]
    pub fn on_part(&self, learned: &LearnedPart, marked: &Marked) -> OnPart {
        learned.recent.picture(marked, || self.drawn_on_part(learned, marked))
    }

    fn drawn_on_part(&self, learned: &LearnedPart, marked: &Marked) -> OnPart {
        let surface = marked.surface(&learned.kept.surface);
        let projection = marked.projection(surface);
        let view = view_of(&learned.settings);
        let area = marked.area().grown(MARGIN).outwards_to(AREA_STEP);
        let part = learned.recent.part(&area, || self.drawn_part(learned, &marked.sku, &view, &area));
        let height = |at: ViewPoint| surface.nurbs.height(at) + surface.difference(at);
        let landing = |flat: FlatPoint| {
            let at = marked.map.point(flat);
            let round = marked.map.point_round(flat).filter(|_| marked.is_round);
            round.unwrap_or_else(|| Point3::new(at.x, at.y, height(at)))
        };
        let raise = |point: Point3<f64>, distance: f64| match marked.map.outward(point) {
            Some(outward) if marked.is_round => point + outward * distance,
            _ => raised(surface, point, distance),
        };
        let mut mark = lines(&marked.ink, marked, &view, landing, raise);
        mark.extend(lines(&marked.fill, marked, &view, landing, raise));
        let plain = |flat: FlatPoint| {
            let at = uncorrected(&projection, flat);
            Point3::new(at.x, at.y, surface.sampled_height(at).unwrap_or(f64::NAN))
        };
        // A drawing that goes round is wider than the part.
        let drawn =
            if marked.is_round { Vec::new() } else { lines(&marked.ink, marked, &view, plain, raise) };
        OnPart {
            sku: marked.sku.to_string(),
            drawing: marked.drawing.clone(),
            program: program(),
            part_file: learned.kept.origin.file.clone(),
            part: part.mesh.clone(),
            part_source: part.source,
            is_part_thinned: part.is_thinned,
            view,
            drawn,
            mark,
            ink: FlatMesh::of_ink(&marked.ink, MAX_INK_POINTS).map(|flat| {
                let lifted = |flat| match marked.is_round {
                    true => raise(landing(flat), INK_LIFT),
                    // Height and normal of the surface from one evaluation: there are thousands of points.
                    false => {
                        let at = marked.map.point(flat);
                        let jet = surface.jet(at);
                        let on_part = Point3::new(at.x, at.y, jet.height + surface.difference(at));
                        on_part + outwards(jet.gradient) * INK_LIFT
                    }
                };
                let image = |flat| view.part_point(lifted(flat));
                let (positions, triangles) = flat.draped(&image, MAX_INK_VERTICES);
                InkMesh { positions, triangles }
            }),
            rims: part.rims.clone(),
            drawn_range: marked.drawn_range,
            mark_range: Some(marked.mark_range),
        }
    }

    fn drawn_part(&self, learned: &LearnedPart, sku: &Sku, view: &View, area: &Extents) -> DrawnPart {
        let surface = &learned.kept.surface;
        let (source, mesh) = self.part_for_picture(learned, sku, view);
        let is_thinned = mesh.triangles().len() < mesh.source_triangles();
        let mesh = mesh.following(view, area, &|at| surface.finest_height(at), MAX_ADDED);
        let in_part = |ring: Vec<Point3<f64>>| ring.into_iter().map(|point| view.part_point(point)).collect();
        let rims = rims(&surface.field, MAX_RIM_POINTS).into_iter().map(in_part).collect();
        let is_final = source != PartSource::Heights || learned.kept.facts.scan.is_some();
        DrawnPart { source, mesh: Arc::new(mesh), is_thinned, rims: Arc::new(rims), is_final }
    }

    fn part_for_picture(&self, learned: &LearnedPart, sku: &Sku, view: &View) -> (PartSource, PictureMesh) {
        if let Some(primitive) = &learned.settings.primitive {
            return (PartSource::Sizes, PictureMesh::of_primitive(primitive));
        }
        let kept = || self.cache.as_ref()?.picture_mesh(sku, &learned.key);
        match learned.mesh.clone().or_else(kept) {
            Some(mesh) => (PartSource::File, mesh),
            None => {
                let field = &learned.kept.surface.field;
                (PartSource::Heights, PictureMesh::of_heights(field, view, PictureMesh::MAX_TRIANGLES))
            }
        }
    }
}

/// The lines of the ink on the part, lifted; `image` maps the drawing to the view.
fn lines(
    pattern: &Pattern,
    marked: &Marked,
    view: &View,
    image: impl Fn(FlatPoint) -> Point3<f64>,
    raise: impl Fn(Point3<f64>, f64) -> Point3<f64>,
) -> Vec<PreviewPath<3>> {
    let piece = piece(marked.length);
    let line = |shape: &Shape| {
        let mut path = match shape {
            Shape::Dot(at) => {
                let half = Vector2::new(DOT / 2.0, 0.0);
                let line = Segment::Line { from: *at + -half, to: *at + half };
                lifted(&Shape::Open(vec![line]), piece, &image)
            }
            shape => lifted(shape, piece, &image),
        };
        for point in &mut path.points {
            *point = view.part_point(raise(Point3::from(*point), LIFT)).coords.into();
        }
        path
    };
    pattern.paths.iter().map(|path| line(&path.shape)).collect()
}

/// A point of the surface, moved towards the outside by `distance` mm.
fn raised(surface: &FittedSurface, point: Point3<f64>, distance: f64) -> Point3<f64> {
    point + outwards(surface.jet(ViewPoint::new(point.x, point.y)).gradient) * distance
}

/// The unit normal of a surface with this gradient, towards the laser.
fn outwards(gradient: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(-gradient.x, -gradient.y, 1.0).normalize()
}
