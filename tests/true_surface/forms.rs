//! Surfaces given by formulas, tessellated as in CAD programs: a net of isoparametric curves whose chords deviate
//! from the surface by a given sag, with exact vertices and normals.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions};
use isomark::geometry::mesh::TriMesh;
use nalgebra::{Point3, Vector3};

/// A surface over a rectangle of parameters, with its outer side towards +z, in mm.
#[derive(Clone, Copy)]
pub(super) struct Form {
    pub(super) name: &'static str,
    /// The point and the unit normal at two parameters.
    pub(super) at: fn(f64, f64) -> (Point3<f64>, Vector3<f64>),
    /// The ranges of the parameters.
    pub(super) range: [[f64; 2]; 2],
    /// The steps of both parameters for which the largest distance between a chord and the surface is `sag`.
    pub(super) steps: fn(sag: f64) -> [f64; 2],
}

/// The normals of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Normals {
    /// Those of the surface.
    Exact,
    /// Those of the triangles, as in OBJ files from FreeCAD.
    Facets,
    /// None.
    Missing,
}

/// The angle whose chord on a circle of `radius` deviates from it by `sag`, rad.
fn turn(radius: f64, sag: f64) -> f64 {
    2.0 * (1.0 - sag / radius).acos()
}

/// One step over a straight line of any length.
const STRAIGHT: f64 = f64::INFINITY;

/// Radius of the can of the samples, mm.
const CAN: f64 = 33.0;
const CONE_HALF_ANGLE: f64 = 0.3;
const BALL: f64 = 30.0;
/// Distance of the tube's centre from the torus axis, and radius of the tube, mm.
const RING: [f64; 2] = [45.0, 25.0];
const HALF_AXES: [f64; 3] = [40.0, 30.0, 25.0];

fn outward(angle: f64) -> Vector3<f64> {
    Vector3::new(angle.sin(), 0.0, angle.cos())
}

pub(super) const CYLINDER: Form = Form {
    name: "cylinder",
    at: |turn, y| (Point3::from(outward(turn) * CAN + Vector3::y() * y), outward(turn)),
    range: [[-FRAC_PI_2, FRAC_PI_2], [-53.0, 53.0]],
    steps: |sag| [turn(CAN, sag), STRAIGHT],
};

/// The axis along y, the apex 100 mm below the origin.
pub(super) const CONE: Form = Form {
    name: "cone",
    at: |turn, y| {
        let radius = (y + 100.0) * CONE_HALF_ANGLE.tan();
        let normal = outward(turn) * CONE_HALF_ANGLE.cos() - Vector3::y() * CONE_HALF_ANGLE.sin();
        (Point3::from(outward(turn) * radius + Vector3::y() * y), normal)
    },
    range: [[-FRAC_PI_2, FRAC_PI_2], [-30.0, 30.0]],
    steps: |sag| [turn(130.0 * CONE_HALF_ANGLE.tan(), sag), STRAIGHT],
};

/// Meridians from pole to pole along y.
pub(super) const SPHERE: Form = Form {
    name: "sphere",
    at: |longitude, latitude| {
        let normal = outward(longitude) * latitude.cos() + Vector3::y() * latitude.sin();
        (Point3::from(normal * BALL), normal)
    },
    range: [[-FRAC_PI_2, FRAC_PI_2], [-FRAC_PI_2, FRAC_PI_2]],
    steps: |sag| [turn(BALL, sag), turn(BALL, sag)],
};

/// The outer half of a torus about y.
pub(super) const TORUS: Form = Form {
    name: "torus",
    at: |longitude, latitude| {
        let normal = outward(longitude) * latitude.cos() + Vector3::y() * latitude.sin();
        (Point3::from(outward(longitude) * RING[0] + normal * RING[1]), normal)
    },
    range: [[-0.9, 0.9], [-1.3, 1.3]],
    steps: |sag| [turn(RING[0] + RING[1], sag), turn(RING[1], sag)],
};

/// Meridians from pole to pole along the middle axis.
pub(super) const ELLIPSOID: Form = Form {
    name: "ellipsoid",
    at: |longitude, latitude| {
        let on_unit = outward(longitude) * latitude.cos() + Vector3::y() * latitude.sin();
        let [a, b, c] = HALF_AXES;
        let point = Point3::new(a * on_unit.x, b * on_unit.y, c * on_unit.z);
        (point, Vector3::new(on_unit.x / a, on_unit.y / b, on_unit.z / c).normalize())
    },
    range: [[-FRAC_PI_2, FRAC_PI_2], [-FRAC_PI_2, FRAC_PI_2]],
    // A chord of an ellipse is the image of a chord of the unit circle, so its deviation is at most the longer half
    // axis times as large.
    steps: |sag| [turn(HALF_AXES[0], sag), turn(HALF_AXES[1], sag)],
};

pub(super) const ALL: [Form; 5] = [CYLINDER, CONE, SPHERE, TORUS, ELLIPSOID];

impl Form {
    /// The number of steps of each parameter for a sag, mm.
    pub(super) fn counts(&self, sag: f64) -> [u32; 2] {
        let steps = (self.steps)(sag);
        [0, 1].map(|side| ((self.range[side][1] - self.range[side][0]) / steps[side]).ceil().max(1.0) as u32)
    }

    /// The tessellation with exact normals.
    fn exact_mesh(&self, sag: f64) -> TriMesh {
        let counts = self.counts(sag);
        let along = |side: usize, index: u32| {
            let [from, to] = self.range[side];
            from + (to - from) * f64::from(index) / f64::from(counts[side])
        };
        let nodes = (0..=counts[1]).flat_map(|j| (0..=counts[0]).map(move |i| (i, j)));
        let vertices = nodes.map(|(i, j)| (self.at)(along(0, i), along(1, j)));
        let (positions, normals): (Vec<_>, Vec<_>) = vertices.unzip();
        let width = counts[0] + 1;
        let cells = (0..counts[1]).flat_map(|j| (0..counts[0]).map(move |i| j * width + i));
        let triangles = cells.flat_map(|lower| {
            [[lower, lower + 1, lower + width + 1], [lower, lower + width + 1, lower + width]]
        });
        // Triangles with two corners at a pole have no area.
        let is_triangle = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|index| positions[index as usize]);
            (b - a).cross(&(c - a)).norm() > 1e-9
        };
        let triangles = triangles.filter(is_triangle).collect();
        TriMesh::new(positions, normals, triangles).unwrap()
    }

    /// The tessellation with a sag, mm. Facet normals are written to a file, because its reader must recognise them.
    pub(super) fn mesh(&self, sag: f64, normals: Normals) -> TriMesh {
        let exact = self.exact_mesh(sag);
        let bare = TriMesh::new(exact.positions().to_vec(), Vec::new(), exact.triangles().to_vec()).unwrap();
        match normals {
            Normals::Exact => exact,
            Normals::Missing => bare,
            Normals::Facets => {
                let mut text = String::from("# Created by FreeCAD\n");
                for at in bare.positions() {
                    text += &format!("v {:.9} {:.9} {:.9}\n", at.x, at.y, at.z);
                }
                for (number, &corners) in bare.triangles().iter().enumerate() {
                    let [a, b, c] = bare.corners(corners);
                    let normal = (b - a).cross(&(c - a)).normalize();
                    let [i, j, k] = corners.map(|index| index + 1);
                    let n = number + 1;
                    text += &format!("vn {:.9} {:.9} {:.9}\n", normal.x, normal.y, normal.z);
                    text += &format!("f {i}//{n} {j}//{n} {k}//{n}\n");
                }
                let (options, none) = (MeshOptions::default(), BTreeMap::new());
                let reading = mesh::read(text.as_bytes(), MeshFormat::Obj, &options, &none);
                reading.unwrap().shape.mesh().unwrap().clone()
            }
        }
    }
}
