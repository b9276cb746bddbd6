//! Filled regions of a drawing as triangles, flat and on a surface.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;
use i_triangle::float::triangulatable::Triangulatable;
use nalgebra::Point3;

use super::ink::contours;
use super::pattern::Pattern;
use crate::geometry::divided::{SAGS, divided, must_divide};
use crate::geometry::space::FlatPoint;

/// Distance of contours from their chords, mm.
const CHORD: f64 = 0.005;
/// Triangles in the plane of the drawing, counter-clockwise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FlatMesh {
    points: Vec<FlatPoint>,
    triangles: Vec<[u32; 3]>,
}

impl FlatMesh {
    /// The inked area of a drawing, as [`Ink::sample`](super::ink::Ink::sample) defines it; places that several regions cover
    /// are covered once. Empty without area; `None` if the contours have more than `most` points.
    #[must_use]
    pub fn of_ink(pattern: &Pattern, most: usize) -> Option<Self> {
        let regions = contours(pattern, |_| true, CHORD);
        if regions.values().flatten().map(Vec::len).sum::<usize>() > most {
            return None;
        }
        let region = |contours: &Vec<Vec<FlatPoint>>| {
            let is_finite = |contour: &&Vec<FlatPoint>| contour.iter().all(|point| point.is_finite());
            let contours = contours.iter().filter(is_finite);
            let points = |contour: &Vec<FlatPoint>| contour.iter().map(|point| [point.x, point.y]).collect();
            let contours: Vec<Vec<[f64; 2]>> = contours.map(points).collect();
            contours.simplify_shape(FillRule::EvenOdd).into_iter().flatten()
        };
        // The outer contours are counter-clockwise and the holes clockwise, so that the winding numbers add up.
        let outlines: Vec<Vec<[f64; 2]>> = regions.values().flat_map(region).collect();
        if outlines.is_empty() {
            return Some(Self::default());
        }
        let mesh = outlines.triangulate().into_delaunay().to_triangulation::<u32>();
        Some(Self {
            points: mesh.points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect(),
            triangles: mesh
                .indices
                .chunks_exact(3)
                .map(|corners| [corners[0], corners[1], corners[2]])
                .collect(),
        })
    }

    /// The triangles on a surface: vertices and triangles. They are divided until their sides follow the
    /// surface to within 0.004 mm, or less closely if this would need more than `most` vertices and more than
    /// twice those of the flat mesh. `image` returns the image of a point of the drawing, mm.
    #[must_use]
    pub fn draped(
        &self,
        image: &dyn Fn(FlatPoint) -> Point3<f64>,
        most: usize,
    ) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let most = most.max(2 * self.points.len());
        let corners: Vec<Point3<f64>> = self.points.iter().map(|point| image(*point)).collect();
        let mut result = (corners.clone(), self.triangles.clone());
        for sag in SAGS {
            let (mut points, mut images) = (self.points.clone(), corners.clone());
            let mut is_full = false;
            let triangles = divided(self.triangles.clone(), |ends| {
                let [from, to] = ends.map(|end| points[end as usize]);
                let chord = ends.map(|end| images[end as usize]);
                let at = |t: f64| Some(image(from.lerp(to, t)));
                is_full |= points.len() >= most;
                if is_full || !must_divide(sag, from.distance(to), chord, at) {
                    return None;
                }
                let middle = from.lerp(to, 0.5);
                points.push(middle);
                images.push(image(middle));
                Some(points.len() as u32 - 1)
            });
            result = (images, triangles);
            if !is_full {
                break;
            }
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Color, Layer, Path, Segment, Shape, Source};
    use nalgebra::Vector2;
    use std::collections::BTreeMap;

    fn contour(points: &[[f64; 2]], region: Option<u32>) -> Path {
        let points: Vec<FlatPoint> = points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect();
        let pairs = points.iter().zip(points.iter().cycle().skip(1));
        let segments = pairs.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect();
        path(Shape::Closed(segments), region)
    }

    fn path(shape: Shape, region: Option<u32>) -> Path {
        Path { layer: 0, color: Color::ByLayer, shape, region, source: Source::default() }
    }

    fn square(half: f64, region: Option<u32>) -> Path {
        contour(&[[-half, -half], [half, -half], [half, half], [-half, half]], region)
    }

    fn pattern(paths: Vec<Path>) -> Pattern {
        Pattern { layers: vec![Layer { name: "0".into(), color: Color::Aci(7) }], paths }
    }

    /// The signed and the absolute sum of the areas: they are equal if all triangles are counter-clockwise.
    fn areas(mesh: &FlatMesh) -> [f64; 2] {
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|index| mesh.points[index as usize]);
            (b - a).perp(&(c - a)) / 2.0
        };
        [mesh.triangles.iter().map(area).sum(), mesh.triangles.iter().map(|t| area(t).abs()).sum()]
    }

    fn filled(paths: Vec<Path>) -> [f64; 2] {
        areas(&FlatMesh::of_ink(&pattern(paths), 10_000).unwrap())
    }

    #[test]
    fn the_inked_area_has_the_area_of_the_even_odd_rule() {
        let bow = contour(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]], None);
        let lines = path(
            Shape::Open(vec![Segment::Line { from: FlatPoint::new(0.0, 0.0), to: FlatPoint::new(9.0, 0.0) }]),
            None,
        );
        for (paths, expected) in [
            (vec![square(5.0, None)], 100.0),
            // A hole, and an island in it.
            (vec![square(5.0, None), square(3.0, None), square(1.0, None)], 100.0 - 36.0 + 4.0),
            // Drawn twice, and filled as well.
            (vec![square(5.0, None), square(5.0, None), square(5.0, Some(1))], 100.0),
            // Two fills that overlap.
            (vec![square(5.0, Some(1)), square(3.0, Some(2))], 100.0),
            // A contour that crosses itself.
            (vec![bow], 8.0),
            (vec![lines, path(Shape::Dot(FlatPoint::new(1.0, 1.0)), None)], 0.0),
        ] {
            let [signed, absolute] = filled(paths);
            assert!(
                (signed - expected).abs() < 1e-4 && (absolute - expected).abs() < 1e-4,
                "{signed} {absolute}"
            );
        }
    }

    #[test]
    fn a_circle_is_filled_to_its_chords() {
        let center = FlatPoint::new(0.0, 0.0);
        let (u, v) = (Vector2::new(5.0, 0.0), Vector2::new(0.0, 5.0));
        let circle = Segment::Arc { center, u, v, start: 0.0, sweep: std::f64::consts::TAU };
        let [area, _] = filled(vec![path(Shape::Closed(vec![circle]), None)]);
        let exact = std::f64::consts::PI * 25.0;
        assert!(area < exact && area > exact - CHORD * 10.0 * std::f64::consts::PI, "{area}");
    }

    #[test]
    fn more_points_than_the_bound_give_nothing() {
        assert_eq!(FlatMesh::of_ink(&pattern(vec![square(5.0, None)]), 3), None);
    }

    #[test]
    fn on_a_cylinder_all_triangles_follow_the_surface_without_gaps() {
        let radius = 20.0;
        let image = |at: FlatPoint| {
            let (sin, cos) = (at.x / radius).sin_cos();
            Point3::new(radius * sin, at.y, radius * cos)
        };
        let hole = contour(&[[-3.0, -1.0], [4.0, -2.0], [3.0, 2.0]], None);
        let flat = FlatMesh::of_ink(&pattern(vec![square(15.0, None), hole]), 10_000).unwrap();
        let [area, _] = areas(&flat);
        let (points, triangles) = flat.draped(&image, 100_000);
        let mut on_surface = 0.0;
        let mut sides: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for triangle in &triangles {
            let [a, b, c] = triangle.map(|index| points[index as usize]);
            on_surface += (b - a).cross(&(c - a)).norm() / 2.0;
            for (i, j) in [(0.2, 0.2), (0.33, 0.33), (0.6, 0.2), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)] {
                let inside = a + (b - a) * i + (c - a) * j;
                let off = radius - inside.x.hypot(inside.z);
                assert!((-1e-9..0.05).contains(&off), "{off} mm");
            }
            for corner in 0..3 {
                let (from, to) = (triangle[corner], triangle[(corner + 1) % 3]);
                let sense = if from < to { 1 } else { -1 };
                *sides.entry([from.min(to), from.max(to)]).or_default() += sense;
            }
        }
        // The map keeps areas, and each side inside has a triangle on both sides.
        assert!((on_surface / area - 1.0).abs() < 2e-3, "{on_surface} {area}");
        let border = sides.iter().filter(|(_, sum)| **sum != 0);
        let length: f64 =
            border.map(|([from, to], _)| (points[*from as usize] - points[*to as usize]).norm()).sum();
        let around = 4.0 * 30.0 + 50f64.sqrt() + 17f64.sqrt() + 45f64.sqrt();
        assert!((length - around).abs() < 0.05, "{length} {around}");
    }

    #[test]
    fn the_number_of_vertices_is_bounded() {
        let image = |at: FlatPoint| Point3::new(at.x, at.y, (at.x * 9.0).sin() * (at.y * 9.0).cos());
        let flat = FlatMesh::of_ink(&pattern(vec![square(40.0, None)]), 10_000).unwrap();
        let (points, triangles) = flat.draped(&image, 2000);
        assert!(points.len() <= 2000 && triangles.len() > 1000, "{} {}", points.len(), triangles.len());
    }
}
