//! A fitted surface as triangles in Wavefront OBJ (Wavefront, Advanced Visualizer, appendix B1), one vertex per node.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};

use crate::geometry::height_field::Node;
use crate::geometry::space::View;
use crate::geometry::surface::fit::FittedSurface;

pub(super) fn write(surface: &FittedSurface, view: &View, part: &str) -> Vec<u8> {
    let field = &surface.field;
    let (columns, rows) = field.size();
    let name: String = part.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    let mut text = format!("# isomark {}: surface fitted to {name}, mm\n", env!("CARGO_PKG_VERSION"));
    let mut numbers = vec![0; field.nodes().len()];
    let mut normals = String::new();
    for (number, (column, row, _)) in field.surface_nodes().enumerate() {
        numbers[row * columns + column] = number + 1;
        let at = field.position(column, row);
        let jet = surface.jet(at);
        let point = view.part_point(Point3::new(at.x, at.y, jet.height));
        let normal = Vector3::new(-jet.gradient.x, -jet.gradient.y, 1.0).normalize();
        let normal = view.part_vector(normal);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "v {:.6} {:.6} {:.6}", point.x, point.y, point.z);
        let _ = writeln!(normals, "vn {:.6} {:.6} {:.6}", normal.x, normal.y, normal.z);
    }
    text += &normals;
    let is_surface = |index: &usize| matches!(field.nodes()[*index], Node::Surface(_));
    for row in 0..rows.saturating_sub(1) {
        for column in 0..columns.saturating_sub(1) {
            let [a, b, c, d] = field.cell_nodes(column, row);
            for triangle in [[a, b, d], [a, d, c]] {
                if triangle.iter().all(is_surface) {
                    let [a, b, c] = triangle.map(|index| numbers[index]);
                    let _ = writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}");
                }
            }
        }
    }
    text.into_bytes()
}
