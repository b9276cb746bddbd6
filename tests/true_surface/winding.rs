//! The winding of triangles does not matter.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsFound, NormalsUsed, PartReading, UpAxis,
};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shapes;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use isomark::geometry::winding;
use isomark::reason::Severity;
use nalgebra::{Point3, Vector3};

use super::forms::{ALL, Normals, SPHERE};
use super::largest_miss;

/// Whether a triangle is among the chosen `percent`, which are scattered irregularly.
fn is_chosen(triangle: usize, percent: usize) -> bool {
    triangle.wrapping_mul(0x9E37_79B9) % 10_007 * 100 / 10_007 < percent
}

/// An OBJ file with a percentage of the triangles reversed, with a normal for each vertex or none.
fn obj(mesh: &TriMesh, percent: usize, normals: &[Vector3<f64>]) -> String {
    let mut text = String::new();
    for at in mesh.positions() {
        writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
    }
    for normal in normals {
        writeln!(text, "vn {:.9} {:.9} {:.9}", normal.x, normal.y, normal.z).unwrap();
    }
    for (triangle, corners) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = corners.map(|vertex| match normals.is_empty() {
            true => format!("{}", vertex + 1),
            false => format!("{0}//{0}", vertex + 1),
        });
        let (b, c) = if is_chosen(triangle, percent) { (c, b) } else { (b, c) };
        writeln!(text, "f {a} {b} {c}").unwrap();
    }
    text
}

/// A binary STL file with a percentage of the triangles reversed, including their normals.
fn stl(mesh: &TriMesh, percent: usize) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(u32::try_from(mesh.triangles().len()).unwrap().to_le_bytes());
    for (triangle, &corners) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = mesh.corners(corners);
        let (b, c) = if is_chosen(triangle, percent) { (c, b) } else { (b, c) };
        let normal = Point3::from((b - a).cross(&(c - a)).normalize());
        let values = [normal, a, b, c].into_iter().flat_map(|point| [point.x, point.y, point.z]);
        values.for_each(|value| bytes.extend((value as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn read(name: &str, bytes: &[u8]) -> PartReading {
    let options = MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z);
    mesh::read(bytes, MeshFormat::from_name(name).unwrap(), &options, &BTreeMap::new()).unwrap()
}

fn fitted(reading: &PartReading) -> FittedSurface {
    let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
    FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
}

fn has_notice(reading: &PartReading, code: &str) -> bool {
    reading.facts.notices.iter().any(|notice| notice.code == code)
}

#[test]
fn reversed_triangles_do_not_change_the_surface() {
    for form in ALL {
        let mesh = form.mesh(0.1, Normals::Missing);
        let margins = match form.counts(0.1) {
            [_, 1] => [0.01, 0.01],
            counts => counts.map(|count| 1.0 / f64::from(count)),
        };
        for percent in [0, 20, 50, 100] {
            for (name, bytes) in
                [("a.obj", obj(&mesh, percent, &[]).into_bytes()), ("a.stl", stl(&mesh, percent))]
            {
                let reading = read(name, &bytes);
                let (miss, at) = largest_miss(&form, &fitted(&reading), margins);
                assert!(miss < 0.005, "{} {name} {percent} %: {miss} mm at {at:?}", form.name);
                assert_eq!(
                    has_notice(&reading, "winding-made-alike"),
                    percent % 100 > 0,
                    "{name} {percent} %"
                );
            }
        }
    }
}

#[test]
fn reversed_triangles_do_not_change_a_fine_free_form() {
    let mesh = shapes::graph(25.0, 0.5, shapes::mouse);
    for percent in [20, 50] {
        let reading = read("a.obj", obj(&mesh, percent, &[]).as_bytes());
        let surface = fitted(&reading);
        for (row, column) in (-18..=18).flat_map(|row| (-18..=18).map(move |column| (row, column))) {
            let (x, y) = (f64::from(column), f64::from(row));
            let off = surface.nurbs.height(ViewPoint::new(x, y)) - shapes::mouse(x, y);
            assert!(off.abs() < 0.005, "{percent} % at ({x}, {y}): {off} mm");
        }
    }
}

#[test]
fn the_number_of_reversed_triangles_is_reported() {
    let mesh = shapes::graph(10.0, 2.0, shapes::sphere);
    let triangles = mesh.triangles().len();
    let reversed = (0..triangles).filter(|&triangle| is_chosen(triangle, 20)).count();
    let reading = read("a.obj", obj(&mesh, 20, &[]).as_bytes());
    let notice = reading.facts.notices.iter().find(|notice| notice.code == "winding-made-alike").unwrap();
    assert!(
        notice.message.starts_with(&format!("{reversed} of {triangles} triangles")),
        "{}",
        notice.message
    );
    assert_eq!(notice.severity, Severity::Note);
}

/// A sphere of radius 10 mm with triangles at the poles.
fn ball() -> TriMesh {
    let (rings, columns) = (12u32, 24u32);
    let angle = |index: u32, count: u32, whole: f64| whole * f64::from(index) / f64::from(count);
    let mut points = vec![Point3::new(0.0, 0.0, 10.0), Point3::new(0.0, 0.0, -10.0)];
    let mut triangles = Vec::new();
    for ring in 1..rings {
        let polar = angle(ring, rings, std::f64::consts::PI);
        for column in 0..columns {
            let turn = angle(column, columns, std::f64::consts::TAU);
            points.push(Point3::new(
                10.0 * polar.sin() * turn.cos(),
                10.0 * polar.sin() * turn.sin(),
                10.0 * polar.cos(),
            ));
            let here = |ring: u32, column: u32| 2 + (ring - 1) * columns + column % columns;
            if ring == 1 {
                triangles.push([0, here(1, column), here(1, column + 1)]);
            } else {
                let [a, b] = [here(ring - 1, column), here(ring - 1, column + 1)];
                let [c, d] = [here(ring, column), here(ring, column + 1)];
                triangles.extend([[a, c, d], [a, d, b]]);
            }
            if ring == rings - 1 {
                triangles.push([1, here(ring, column + 1), here(ring, column)]);
            }
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

/// The signed volume of a closed mesh, mm³: positive if its triangles face outwards.
fn volume(mesh: &TriMesh) -> f64 {
    let of = |&corners: &[u32; 3]| {
        let [a, b, c] = mesh.corners(corners).map(|corner| corner.coords);
        a.dot(&b.cross(&c)) / 6.0
    };
    mesh.triangles().iter().map(of).sum()
}

#[test]
fn the_triangles_of_a_closed_body_face_outwards() {
    let whole = volume(&ball());
    assert!(whole > 4000.0, "the original ball faces outwards: {whole} mm³");
    for percent in [20, 50, 80] {
        let reading = read("a.stl", &stl(&ball(), percent));
        let turned = volume(reading.shape.mesh().unwrap());
        assert!((turned / whole - 1.0).abs() < 1e-6, "{percent} %: {turned} mm³ for {whole} mm³");
        let top = fitted(&reading).nurbs.height(ViewPoint::new(1.0, 2.0));
        assert!((top - 95.0f64.sqrt()).abs() < 0.01, "{percent} %: {top} mm");
    }
}

/// The normals that modelling programs write for smooth shading: those of the triangles at a vertex, as they run in the file, weighted by
/// their angles there.
fn averages(mesh: &TriMesh, percent: usize) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); mesh.positions().len()];
    for (triangle, &corners) in mesh.triangles().iter().enumerate() {
        let points = mesh.corners(corners);
        let sign = if is_chosen(triangle, percent) { -1.0 } else { 1.0 };
        let normal = sign * (points[1] - points[0]).cross(&(points[2] - points[0])).normalize();
        for corner in 0..3 {
            let [here, next, last] = [0, 1, 2].map(|turn| points[(corner + turn) % 3]);
            sums[corners[corner] as usize] += normal * (next - here).angle(&(last - here));
        }
    }
    sums.into_iter().map(|sum| sum.try_normalize(1e-9).unwrap_or_else(Vector3::z)).collect()
}

#[test]
fn averages_over_triangles_that_run_in_opposite_ways_are_not_believed() {
    let mesh = shapes::graph(10.0, 1.0, shapes::sphere);
    for percent in [1, 3, 20, 50, 80] {
        let chosen = (0..mesh.triangles().len()).filter(|&triangle| is_chosen(triangle, percent)).count();
        let reading = read("a.obj", obj(&mesh, percent, &averages(&mesh, percent)).as_bytes());
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "winding-made-alike").unwrap();
        let reversed = chosen.min(mesh.triangles().len() - chosen);
        assert!(notice.message.starts_with(&format!("{reversed} of ")), "{}", notice.message);
        assert!(notice.message.contains("normals were computed from them"), "{}", notice.message);
        // Normals far from few reversed triangles are those of the surface.
        let used = reading.facts.normals_used;
        assert!(matches!(used, Some(NormalsUsed::Estimated | NormalsUsed::Mixed)), "{percent} %: {used:?}");
        if percent >= 20 {
            assert_eq!(reading.facts.normals, NormalsFound::Averaged, "{percent} %");
            assert!(has_notice(&reading, "normals-estimated"), "{percent} %");
        }
        let surface = fitted(&reading);
        for (x, y) in [(0.3, 0.4), (-6.2, 5.1), (7.0, -6.6)] {
            let off = surface.nurbs.height(ViewPoint::new(x, y)) - shapes::sphere(x, y);
            assert!(off.abs() < 0.005, "{percent} % at ({x}, {y}): {off} mm");
        }
    }
}

/// A reversed patch with normals of its own, as where smooth shading ends at reversed faces.
#[test]
fn normals_of_a_reversed_patch_are_turned_round() {
    let mesh = shapes::graph(10.0, 1.0, shapes::sphere);
    let is_patch = |corners: &[u32; 3]| {
        mesh.corners(*corners).iter().map(|corner| corner.x + 0.3 * corner.y).sum::<f64>() > 9.0
    };
    let count = mesh.positions().len() as u32;
    let outward = |at: &Point3<f64>| Vector3::new(at.x, at.y, at.z + 15.0).normalize();
    let positions = mesh.positions().iter().chain(mesh.positions());
    let exact = mesh.positions().iter().map(outward);
    let normals = exact.clone().chain(exact.map(|normal| -normal));
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| match is_patch(&[a, b, c]) {
        true => [a + count, c + count, b + count],
        false => [a, b, c],
    });
    let patched = TriMesh::new(positions.copied().collect(), normals.collect(), triangles.collect()).unwrap();
    let reading = read("a.obj", obj(&patched, 0, patched.normals()).as_bytes());
    let reversed = mesh.triangles().iter().filter(|corners| is_patch(corners)).count();
    let notice = reading.facts.notices.iter().find(|notice| notice.code == "winding-made-alike").unwrap();
    assert!(notice.message.starts_with(&format!("{reversed} of ")), "{}", notice.message);
    let surface = fitted(&reading);
    for (x, y) in [(0.3, 0.4), (-6.2, 5.1), (7.0, -6.6), (3.0, 0.1), (8.0, 2.0)] {
        let off = surface.nurbs.height(ViewPoint::new(x, y)) - shapes::sphere(x, y);
        // Between normals of the surface and estimated ones, at the rim of the sheet, it is a little further off than without normals.
        assert!(off.abs() < 0.01, "at ({x}, {y}): {off} mm");
    }
}

/// A bar with a round top, one facet long, and a cap at one end.
struct Bar {
    positions: Vec<Point3<f64>>,
    /// Those of the surface; the first 22 are of the top.
    normals: Vec<Vector3<f64>>,
    top: Vec<[u32; 3]>,
    cap: Vec<[u32; 3]>,
}

fn bar() -> Bar {
    let outward = |step: u32| {
        let (sin, cos) = (f64::from(step) * 12.0 - 60.0).to_radians().sin_cos();
        Vector3::new(0.0, sin, cos)
    };
    let ends = |x: f64| (0..=10).map(move |step| Point3::from(outward(step) * 20.0 + Vector3::x() * x));
    let positions = ends(-30.0).chain(ends(30.0)).chain(ends(30.0)).collect();
    let normals = (0..22).map(|index| outward(index % 11)).chain([Vector3::x(); 11]).collect();
    let top = (0..10).flat_map(|at| [[at, at + 11, at + 12], [at, at + 12, at + 1]]).collect();
    let cap = (23..32).map(|at| [22, at + 1, at]).collect();
    Bar { positions, normals, top, cap }
}

#[test]
fn exact_normals_are_believed_beside_a_flipped_face_and_on_an_open_sheet() {
    let reversed = |triangles: &[[u32; 3]], percent: usize| -> Vec<[u32; 3]> {
        let turned = |(index, &[a, b, c]): (usize, &[u32; 3])| {
            if is_chosen(index, percent) { [a, c, b] } else { [a, b, c] }
        };
        triangles.iter().enumerate().map(turned).collect()
    };
    let Bar { positions, normals, top, cap } = bar();
    // The cap with its own normals.
    let mut flipped = normals.clone();
    flipped[22..].iter_mut().for_each(|normal| *normal = -*normal);
    let part = [top.clone(), reversed(&cap, 100)].concat();
    let (alike, winding) = winding::made_alike(TriMesh::new(positions.clone(), flipped, part).unwrap());
    assert_eq!(winding.spoilt_normals, 0);
    let are_same = |one: &[Vector3<f64>], other: &[Vector3<f64>]| {
        one.iter().zip(other).all(|(one, other)| (one - other).norm() < 1e-9)
    };
    assert!(are_same(&alike.normals()[..22], &normals[..22]));
    // Normals that show the outside of the top, and the inside, whichever way most of the triangles run.
    for side in [1.0, -1.0] {
        let normals: Vec<Vector3<f64>> = normals[..22].iter().map(|normal| normal * side).collect();
        for percent in [15, 60, 85] {
            let top =
                TriMesh::new(positions[..22].to_vec(), normals.clone(), reversed(&top, percent)).unwrap();
            let (alike, winding) = winding::made_alike(top);
            assert_eq!(winding.spoilt_normals, 0, "{side} {percent} %");
            assert!(are_same(alike.normals(), &normals), "{side} {percent} %");
        }
    }
}

#[test]
fn normals_of_the_file_determine_the_winding() {
    let exact = SPHERE.mesh(0.1, Normals::Exact);
    for percent in [20, 50] {
        let reading = read("a.obj", obj(&exact, percent, exact.normals()).as_bytes());
        assert_eq!(reading.facts.normals, NormalsFound::Smooth);
        assert!(!has_notice(&reading, "winding-made-alike"));
        let (miss, at) = largest_miss(&SPHERE, &fitted(&reading), [0.01, 0.01]);
        assert!(miss < 0.005, "{percent} %: {miss} mm at {at:?}");
    }
}

/// All facet normals point outwards, while half of the triangles are reversed.
#[test]
fn facet_normals_are_recognised_with_any_winding() {
    let mesh = SPHERE.mesh(0.1, Normals::Missing);
    let mut text = String::new();
    for (triangle, &corners) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = mesh.corners(corners);
        let normal = (b - a).cross(&(c - a)).normalize();
        for at in [a, b, c] {
            writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
        }
        writeln!(text, "vn {:.9} {:.9} {:.9}", normal.x, normal.y, normal.z).unwrap();
        let [first, n] = [triangle * 3 + 1, triangle + 1];
        let (second, third) =
            if is_chosen(triangle, 50) { (first + 2, first + 1) } else { (first + 1, first + 2) };
        writeln!(text, "f {first}//{n} {second}//{n} {third}//{n}").unwrap();
    }
    let reading = read("a.obj", text.as_bytes());
    assert_eq!(reading.facts.normals, NormalsFound::FacetsOnly);
    let (miss, at) =
        largest_miss(&SPHERE, &fitted(&reading), SPHERE.counts(0.1).map(|count| 1.0 / f64::from(count)));
    assert!(miss < 0.005, "{miss} mm at {at:?}");
}

/// A box with normals from smooth shading; its top stays flat.
#[test]
fn shaded_boxes_stay_flat_with_any_winding() {
    let points: Vec<Point3<f64>> = (0..8)
        .map(|corner| {
            let sign = |bit: u32| if corner >> bit & 1 == 1 { 25.0 } else { -25.0 };
            Point3::new(sign(0), sign(1), sign(2))
        })
        .collect();
    let normals: Vec<Vector3<f64>> = points.iter().map(|point| point.coords.normalize()).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let mesh = TriMesh::new(points, Vec::new(), triangles).unwrap();
    for percent in [0, 20, 50] {
        let reading = read("a.obj", obj(&mesh, percent, &normals).as_bytes());
        assert_eq!(reading.facts.normals, NormalsFound::Averaged, "{percent} %");
        let top = fitted(&reading).sampled_height(ViewPoint::new(3.0, 8.0)).unwrap();
        assert!((top - 25.0).abs() < 0.01, "{percent} %: {top} mm");
    }
}

#[test]
fn a_moebius_strip_is_reported_with_its_place() {
    let (count, mut points, mut triangles) = (60u32, Vec::new(), Vec::new());
    for step in 0..count {
        let turn = f64::from(step) / f64::from(count) * std::f64::consts::TAU;
        let out = Vector3::new(turn.cos(), turn.sin(), 0.0);
        let across = out * (turn / 2.0).cos() + Vector3::z() * (turn / 2.0).sin();
        points.extend([Point3::from(out * 30.0 - across * 8.0), Point3::from(out * 30.0 + across * 8.0)]);
        let [a, b] = [2 * step, 2 * step + 1];
        // After one turn, the strip's two rims are exchanged.
        let [c, d] = if step + 1 == count { [1, 0] } else { [a + 2, b + 2] };
        triangles.extend([[a, b, d], [a, d, c]]);
    }
    let mesh = TriMesh::new(points, Vec::new(), triangles).unwrap();
    for percent in [0, 20] {
        let reading = read("a.obj", obj(&mesh, percent, &[]).as_bytes());
        let notice =
            reading.facts.notices.iter().find(|notice| notice.code == "winding-contradicts").unwrap();
        assert_eq!(notice.severity, Severity::Warning);
        let inside = notice.message.split(['(', ')']).nth(1).unwrap();
        let at: Vec<f64> = inside.split(", ").map(|number| number.parse().unwrap()).collect();
        let from_axis = at[0].hypot(at[1]);
        assert!((22.0..=38.0).contains(&from_axis) && at[2].abs() <= 8.0, "{}", notice.message);
    }
}

/// Two bodies at one place, or the front and the back of a sheet: a triangle is no neighbour of its copy.
#[test]
fn a_copy_of_a_skin_reverses_nothing_and_hides_no_reversed_triangles() {
    let mesh = shapes::graph(10.0, 1.0, shapes::sphere);
    for (is_turned, percent) in [(false, 0), (true, 0), (false, 20)] {
        let chosen = (0..mesh.triangles().len()).filter(|&triangle| is_chosen(triangle, percent)).count();
        let single = |(triangle, &[a, b, c]): (usize, &[u32; 3])| {
            if is_chosen(triangle, percent) { [a, c, b] } else { [a, b, c] }
        };
        let singles: Vec<[u32; 3]> = mesh.triangles().iter().enumerate().map(single).collect();
        let copies = singles.iter().map(|&[a, b, c]| if is_turned { [a, c, b] } else { [a, b, c] });
        let both = singles.iter().copied().chain(copies).collect();
        let both = TriMesh::new(mesh.positions().to_vec(), Vec::new(), both).unwrap();
        let reading = read("a.obj", obj(&both, 0, &[]).as_bytes());
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "winding-made-alike");
        let reversed: usize =
            notice.map_or(0, |notice| notice.message.split(' ').next().unwrap().parse().unwrap());
        assert_eq!(reversed, 2 * chosen, "{is_turned} {percent} %");
        let surface = fitted(&reading);
        for (x, y) in [(0.3, 0.4), (-6.2, 5.1), (7.0, -6.6)] {
            let off = surface.nurbs.height(ViewPoint::new(x, y)) - shapes::sphere(x, y);
            assert!(off.abs() < 0.005, "{is_turned} {percent} % at ({x}, {y}): {off} mm");
        }
    }
}
