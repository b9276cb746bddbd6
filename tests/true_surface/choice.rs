//! What a mesh follows between its vertices can be chosen, and the choice is reported.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsChoice, NormalsFound, NormalsUsed, PartReading, UpAxis,
};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::height_field::{Grid, Node};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector3};

use super::forms::{CYLINDER, Normals, SPHERE};

/// The upper half of a prism along y with so many sides to the whole round, radius 30 mm: corners first.
fn prism(sides: u32) -> TriMesh {
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for side in 0..=sides / 2 {
        let angle = TAU * f64::from(side) / f64::from(sides);
        points.extend([-20.0, 20.0].map(|y| Point3::new(30.0 * angle.cos(), y, 30.0 * angle.sin())));
        if side > 0 {
            let last = 2 * side;
            triangles.extend([[last - 2, last + 1, last - 1], [last - 2, last, last + 1]]);
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

fn obj(mesh: &TriMesh, normals: &[Vector3<f64>]) -> String {
    let mut text = String::new();
    for at in mesh.positions() {
        writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
    }
    for normal in normals {
        writeln!(text, "vn {:.9} {:.9} {:.9}", normal.x, normal.y, normal.z).unwrap();
    }
    for corners in mesh.triangles() {
        let corners = corners.map(|corner| match normals.is_empty() {
            true => format!("{}", corner + 1),
            false => format!("{0}//{0}", corner + 1),
        });
        writeln!(text, "f {}", corners.join(" ")).unwrap();
    }
    text
}

fn read(text: &str, normals: NormalsChoice) -> PartReading {
    let options =
        MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z).with_normals(normals);
    mesh::read(text.as_bytes(), MeshFormat::Obj, &options, &BTreeMap::new()).unwrap()
}

/// The largest distance of the sampled part from a height, mm, away from its rims.
fn off(reading: &PartReading, height: impl Fn(f64, f64) -> f64) -> f64 {
    let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
    let grid = Grid::over(&part.extents(), 0.37);
    let samples = part.sample(&grid);
    let mut off = 0.0f64;
    for row in 0..grid.rows {
        for column in 0..grid.columns {
            let at = grid.position(column, row);
            if at.x.abs() < 20.0 && at.y.abs() < 15.0 {
                let Node::Surface(sampled) = samples.field.nodes()[row * grid.columns + column] else {
                    panic!("no surface at {at:?}")
                };
                off = off.max((sampled - height(at.x, at.y)).abs());
            }
        }
    }
    off
}

/// The height of the flat facets of [`prism`].
fn facets(sides: u32) -> impl Fn(f64, f64) -> f64 {
    move |x, _| {
        let step = TAU / f64::from(sides);
        let first = ((x / 30.0).acos() / step).floor() * step;
        let [[x0, z0], [x1, z1]] =
            [first, first + step].map(|angle| [30.0 * angle.cos(), 30.0 * angle.sin()]);
        z0 + (z1 - z0) * (x - x0) / (x1 - x0)
    }
}

fn cylinder(x: f64, _: f64) -> f64 {
    (900.0 - x * x).sqrt()
}

#[test]
fn facets_are_marked_exactly_as_they_are() {
    // From low-poly art to facets that hardly bend.
    for sides in [16, 40, 200, 400] {
        let mesh = prism(sides);
        let exact: Vec<Vector3<f64>> =
            mesh.positions().iter().map(|at| Vector3::new(at.x, 0.0, at.z) / 30.0).collect();
        for text in [obj(&mesh, &[]), obj(&mesh, &exact)] {
            let reading = read(&text, NormalsChoice::Facets);
            assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Facets));
            let off_there = off(&reading, facets(sides));
            assert!(off_there < 1e-7, "{sides} sides: {off_there} mm");
            // The same file without the setting is the cylinder.
            let round = read(&text, NormalsChoice::Auto);
            assert!(off(&round, cylinder) < 0.02, "{sides} sides: {} mm", off(&round, cylinder));
        }
    }
}

/// The upper half of a ball of 30 mm with so many sides to the whole round and a pole above: corners first.
fn facetted_ball(sides: u32) -> TriMesh {
    let at = |ring: u32, side: u32| {
        let [from_pole, round] = [ring, side].map(|part| TAU * f64::from(part) / f64::from(sides));
        Point3::new(from_pole.sin() * round.cos(), from_pole.sin() * round.sin(), from_pole.cos()) * 30.0
    };
    let rings = sides / 4;
    let mut points = vec![at(0, 0)];
    for ring in 1..=rings {
        points.extend((0..sides).map(|side| at(ring, side)));
    }
    let number = |ring: u32, side: u32| if ring == 0 { 0 } else { 1 + (ring - 1) * sides + side % sides };
    let mut triangles = Vec::new();
    for (ring, side) in (0..rings).flat_map(|ring| (0..sides).map(move |side| (ring, side))) {
        let [a, b] = [number(ring, side), number(ring, side + 1)];
        let [c, d] = [number(ring + 1, side), number(ring + 1, side + 1)];
        triangles.push([a, c, d]);
        if ring > 0 {
            triangles.push([a, d, b]);
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

#[test]
fn a_fit_to_flat_facets_has_no_pits_at_their_corners() {
    for sides in [24, 32, 64] {
        let ball = facetted_ball(sides);
        // The ball is convex: each point of its upper side is on the lowest of the planes of its facets.
        let plane = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|corner| ball.positions()[corner as usize]);
            (a, (b - a).cross(&(c - a)))
        };
        let planes: Vec<(Point3<f64>, Vector3<f64>)> = ball.triangles().iter().map(plane).collect();
        let height = |at: ViewPoint| {
            let over = planes.iter().map(|(a, n)| a.z - (n.x * (at.x - a.x) + n.y * (at.y - a.y)) / n.z);
            over.fold(f64::INFINITY, f64::min)
        };
        let reading = read(&obj(&ball, &[]), NormalsChoice::Facets);
        let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
        let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        let mut off = 0.0f64;
        for (column, row, _) in surface.field.surface_nodes() {
            let at = surface.field.position(column, row);
            if at.x.hypot(at.y) < 18.0 {
                off = off.max((surface.jet(at).height - height(at)).abs());
            }
        }
        // A span is off a ridge by at most its length times a quarter of the turn, on a side that leans by up to 37 degrees.
        let span = 2.0 * surface.field.step();
        let most = span * TAU / f64::from(sides) / 4.0 / 37f64.to_radians().cos();
        assert!(off < most, "{sides} sides: {off} mm off the facets, {most} mm allowed");
    }
}

#[test]
fn normals_of_the_file_are_followed_or_not_as_the_settings_say() {
    // Normals of a flatter cylinder: nobody's average, and not what the facets lead to.
    let mesh = prism(40);
    let flatter: Vec<Vector3<f64>> =
        mesh.positions().iter().map(|at| Vector3::new(at.x * 0.9, 0.0, at.z).normalize()).collect();
    let text = obj(&mesh, &flatter);
    let (file, estimated) = (read(&text, NormalsChoice::File), read(&text, NormalsChoice::Estimate));
    assert_eq!(file.facts.normals_used, Some(NormalsUsed::File));
    assert_eq!(estimated.facts.normals_used, Some(NormalsUsed::Estimated));
    assert!(file.facts.normals == NormalsFound::Smooth && estimated.facts.normals == NormalsFound::Smooth);
    let [with, without] = [&file, &estimated].map(|reading| off(reading, cylinder));
    assert!(with > 0.02 && without < 0.01, "{with} mm with the file's, {without} mm with estimated normals");
    // Averages of the facets, which are found out unless the settings say otherwise.
    let shaded = shaded_box();
    let [auto, file] = [NormalsChoice::Auto, NormalsChoice::File].map(|choice| read(&shaded, choice));
    assert_eq!(auto.facts.normals_used, Some(NormalsUsed::Estimated));
    assert_eq!(file.facts.normals_used, Some(NormalsUsed::File));
    assert!(auto.facts.normals == NormalsFound::Averaged && file.facts.normals == NormalsFound::Averaged);
    let [auto, file] = [auto, file].map(|reading| off(&reading, |_, _| 25.0));
    assert!(auto < 1e-6 && file > 1.0, "{auto} mm and {file} mm off the flat top");
}

/// A cube of 50 mm, shaded smooth.
fn shaded_box() -> String {
    let corner = |corner: u32| {
        let sign = |bit: u32| if corner >> bit & 1 == 1 { 25.0 } else { -25.0 };
        Point3::new(sign(0), sign(1), sign(2))
    };
    let points: Vec<Point3<f64>> = (0..8).map(corner).collect();
    let normals: Vec<Vector3<f64>> = points.iter().map(|at| at.coords.normalize()).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    obj(&TriMesh::new(points, Vec::new(), triangles).unwrap(), &normals)
}

#[test]
fn the_choice_is_reported_with_its_numbers() {
    let exact = SPHERE.mesh(0.1, Normals::Exact);
    let text = obj(&exact, exact.normals());
    assert_eq!(read(&text, NormalsChoice::Auto).facts.normals_used, Some(NormalsUsed::File));
    let bare = obj(&exact, &[]);
    let reading = read(&bare, NormalsChoice::File);
    assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Estimated));
    assert!(reading.facts.notices.iter().any(|notice| notice.code == "normals-missing"));
    // A third of the vertices have a normal of no direction.
    let cylinder = CYLINDER.mesh(0.02, Normals::Exact);
    let mut normals = cylinder.normals().to_vec();
    normals.iter_mut().step_by(3).for_each(|normal| *normal = Vector3::zeros());
    let missing = normals.iter().filter(|normal| normal.norm() == 0.0).count();
    let reading = read(&obj(&cylinder, &normals), NormalsChoice::Auto);
    assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Mixed));
    assert_eq!(reading.facts.normals_missing, missing);
}
