//! The outline of a part, straight down onto the plane below it.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;

use super::mesh::TriMesh;
use crate::geometry::space::{View, ViewPoint};

/// Triangles with a smaller area in the view are seen from the side, mm².
const EDGE_ON: f64 = 1e-9;

/// The outer borders and the holes of the area that a part covers in the view, closed without repeated points.
pub fn silhouette(mesh: &TriMesh, view: &View) -> Vec<Vec<ViewPoint>> {
    let triangles = mesh.triangles().iter().filter_map(|triangle| {
        let [a, b, c] = mesh.corners(*triangle).map(|corner| view.point(corner).xy());
        let area = (b - a).perp(&(c - a));
        let corners = if area > 0.0 { [a, b, c] } else { [a, c, b] };
        (area.abs() > EDGE_ON).then(|| corners.map(|corner| [corner.x, corner.y]).to_vec())
    });
    let triangles: Vec<Vec<[f64; 2]>> = triangles.collect();
    let shapes = triangles.simplify_shape(FillRule::NonZero);
    let contour = |contour: Vec<[f64; 2]>| contour.into_iter().map(|[x, y]| ViewPoint::new(x, y)).collect();
    shapes.into_iter().flatten().map(contour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;

    #[test]
    fn the_outline_of_a_graph_encloses_the_area_of_its_triangles() {
        let mesh = shapes::graph(20.0, 1.0, shapes::sphere);
        let truth = mesh.triangles().iter().map(|triangle| {
            let [a, b, c] = mesh.corners(*triangle);
            (b - a).xy().perp(&(c - a).xy()).abs() / 2.0
        });
        let truth: f64 = truth.sum();
        let outlines = silhouette(&mesh, &View::top());
        assert_eq!(outlines.len(), 1);
        let ring = &outlines[0];
        let area: f64 = (0..ring.len())
            .map(|index| ring[index].coords().perp(&ring[(index + 1) % ring.len()].coords()) / 2.0)
            .sum();
        assert!((area.abs() - truth).abs() < 1e-2 && truth > 1000.0, "{area} for {truth}");
    }
}
