//! Missing triangles are bridged as the surface leads; designed holes stay.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsFound, PartReading, Shape, UpAxis,
};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::fork::InTurn;
use isomark::geometry::holes;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::point_cloud::PointCloud;
use isomark::geometry::shapes;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use isomark::geometry::surface::scan::{SmoothedScan, Smoothing};
use nalgebra::{Point3, Vector3};

fn dome(x: f64, y: f64) -> f64 {
    (2500.0 - x * x - y * y).sqrt() - 40.0
}

/// The triangles of a dome but those whose middle is within `radius` of a place, mm.
fn holed(edge: f64, at: [f64; 2], radius: f64) -> TriMesh {
    let mesh = shapes::graph(20.0, edge, dome);
    let is_kept = |corners: &&[u32; 3]| {
        let middle = mesh.corners(**corners).iter().map(|at| at.coords).sum::<Vector3<f64>>() / 3.0;
        (middle.x - at[0]).hypot(middle.y - at[1]) > radius
    };
    let triangles = mesh.triangles().iter().filter(is_kept).copied().collect();
    TriMesh::new(mesh.positions().to_vec(), Vec::new(), triangles).unwrap()
}

/// The middle of the triangle of a dome that is nearest to a place, mm.
fn nearest_middle(edge: f64, at: [f64; 2]) -> [f64; 2] {
    let mesh = shapes::graph(20.0, edge, dome);
    let middles = mesh
        .triangles()
        .iter()
        .map(|&corners| mesh.corners(corners).iter().map(|at| at.coords).sum::<Vector3<f64>>() / 3.0);
    let off = |middle: &Vector3<f64>| (middle.x - at[0]).hypot(middle.y - at[1]);
    let nearest = middles.min_by(|one, other| off(one).total_cmp(&off(other))).unwrap();
    [nearest.x, nearest.y]
}

fn options(bridge: Option<f64>) -> MeshOptions {
    MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z).with_bridge(bridge)
}

fn obj(mesh: &TriMesh, has_normals: bool) -> String {
    let mut text = String::new();
    for at in mesh.positions() {
        writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
        if has_normals {
            writeln!(text, "vn {:.9} {:.9} {:.9}", at.x, at.y, at.z + 40.0).unwrap();
        }
    }
    for corners in mesh.triangles() {
        let corners = corners.map(|corner| match has_normals {
            true => format!("{0}//{0}", corner + 1),
            false => format!("{}", corner + 1),
        });
        writeln!(text, "f {}", corners.join(" ")).unwrap();
    }
    text
}

fn read(mesh: &TriMesh, has_normals: bool, bridge: Option<f64>) -> PartReading {
    let text = obj(mesh, has_normals);
    mesh::read(text.as_bytes(), MeshFormat::Obj, &options(bridge), &BTreeMap::new()).unwrap()
}

fn fitted(reading: &PartReading) -> FittedSurface {
    let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
    FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
}

/// How far the sampled surface is from the dome round a place, mm; infinite where there is none.
fn off(surface: &FittedSurface, at: [f64; 2], radius: f64) -> f64 {
    let places = (-8..=8).flat_map(|row| (-8..=8).map(move |column| (column, row)));
    let off = places.map(|(column, row)| {
        let (x, y) = (at[0] + radius * f64::from(column) / 8.0, at[1] + radius * f64::from(row) / 8.0);
        surface
            .sampled_height(ViewPoint::new(x, y))
            .map_or(f64::INFINITY, |height| (height - dome(x, y)).abs())
    });
    off.fold(0.0, f64::max)
}

fn notice(reading: &PartReading) -> Option<&str> {
    let notices = &reading.facts.notices;
    notices.iter().find(|notice| notice.code == "hole-bridged").map(|notice| notice.message.as_str())
}

#[test]
fn a_missing_triangle_is_bridged_as_the_surface_leads() {
    for edge in [0.5, 1.0, 1.5] {
        let at = nearest_middle(edge, [3.0, -2.0]);
        let mesh = holed(edge, at, 0.1);
        assert_eq!(mesh.triangles().len() + 1, shapes::graph(20.0, edge, dome).triangles().len());
        for has_normals in [true, false] {
            let reading = read(&mesh, has_normals, None);
            let found = if has_normals { NormalsFound::Smooth } else { NormalsFound::None };
            assert_eq!(reading.facts.normals, found);
            let off_there = off(&fitted(&reading), at, 2.0);
            assert!(off_there < 0.001, "{edge} mm, normals {has_normals}: {off_there} mm");
            let message = notice(&reading).unwrap();
            let place = format!("({:.2}, {:.2}, ", at[0], at[1]);
            assert!(message.contains(&place) && message.contains(" mm wide with 3 sides"), "{message}");
            let open = read(&mesh, has_normals, Some(0.0));
            assert!(notice(&open).is_none());
            assert!(
                off(&fitted(&open), at, 2.0).is_infinite(),
                "{edge} mm: the hole is there without a bridge"
            );
        }
    }
}

#[test]
fn two_neighbouring_triangles_are_bridged_and_a_wider_hole_when_the_settings_say_so() {
    let at = nearest_middle(1.0, [3.0, -2.0]);
    let wide = holed(1.0, [3.0, -2.0], 1.2);
    let reading = read(&wide, false, None);
    assert!(notice(&reading).is_none() && off(&fitted(&reading), [3.0, -2.0], 3.0).is_infinite());
    let reading = read(&wide, false, Some(5.0));
    let off_there = off(&fitted(&reading), [3.0, -2.0], 3.0);
    assert!(notice(&reading).is_some() && off_there < 0.01, "{off_there} mm");
    let mesh = shapes::graph(20.0, 1.0, dome);
    let middle =
        |corners: [u32; 3]| mesh.corners(corners).iter().map(|at| at.coords).sum::<Vector3<f64>>() / 3.0;
    let distance = |corners: [u32; 3]| (middle(corners).x - at[0]).hypot(middle(corners).y - at[1]);
    let mut triangles = mesh.triangles().to_vec();
    triangles.sort_by(|one, other| distance(*one).total_cmp(&distance(*other)));
    let pair = TriMesh::new(mesh.positions().to_vec(), Vec::new(), triangles[2..].to_vec()).unwrap();
    let reading = read(&pair, false, None);
    let off_there = off(&fitted(&reading), at, 2.0);
    assert!(notice(&reading).is_some() && off_there < 0.002, "{off_there} mm");
}

#[test]
fn triangles_that_do_not_quite_meet_continue_each_other() {
    let mesh = shapes::graph(20.0, 4.0, dome);
    let corners: Vec<Point3<f64>> =
        mesh.triangles().iter().flat_map(|&corners| mesh.corners(corners)).collect();
    for by in [0.0, 4e-4, 1e-3] {
        // By a different length along each axis for each corner.
        let step = |index: usize, axis: usize| by * ((1 + index * 3 + axis) as f64 * 12.9898).sin();
        let moved = corners.iter().enumerate();
        let moved = moved.map(|(index, at)| at + Vector3::from_fn(|axis, _| step(index, axis))).collect();
        let triangles = (0..corners.len() as u32 / 3).map(|first| [0, 1, 2].map(|corner| 3 * first + corner));
        let loose = TriMesh::new(moved, Vec::new(), triangles.collect()).unwrap();
        let reading = read(&loose, false, None);
        let message = reading.facts.notices.iter().find(|notice| notice.code == "cracks-joined");
        assert_eq!(message.is_some(), by > 0.0, "{by} mm: {message:?}");
        // The facets by themselves are up to 0.05 mm below the dome.
        let off_there = off(&fitted(&reading), [0.0, 0.0], 8.0);
        assert!(off_there < 0.005 + 2.0 * by, "{by} mm: {off_there} mm");
    }
}

/// A flat sheet 40 mm wide with a hole of so many sides and a radius, mm; the rings round the hole have widths.
fn sheet(sides: u32, radius: f64, rings: &[f64]) -> TriMesh {
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for width in std::iter::once(&radius).chain(rings) {
        for side in 0..sides {
            let angle = TAU * f64::from(side) / f64::from(sides);
            points.push(Point3::new(width * angle.cos(), width * angle.sin(), 1.0));
        }
    }
    for ring in 0..u32::try_from(rings.len()).unwrap() {
        for side in 0..sides {
            let [here, next] = [side, (side + 1) % sides].map(|side| ring * sides + side);
            triangles.extend([[here, here + sides, next + sides], [here, next + sides, next]]);
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

#[test]
fn designed_holes_and_outlines_stay() {
    for (sides, radius) in [(4, 0.7), (6, 0.5), (8, 0.5), (12, 0.5), (16, 0.5), (16, 1.5), (32, 3.0)] {
        let mesh = sheet(sides, radius, &[radius + 2.0, 10.0, 20.0]);
        let (after, bridges) = holes::bridged(mesh.clone(), None);
        assert!(bridges.is_empty() && after == mesh, "{sides} sides, radius {radius} mm: {bridges:?}");
    }
    // A loose triangle and a small patch end at their outlines.
    let triangle = TriMesh::new(
        vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)],
        Vec::new(),
        vec![[0, 1, 2]],
    );
    let (_, bridges) = holes::bridged(triangle.unwrap(), Some(50.0));
    assert!(bridges.is_empty(), "{bridges:?}");
    let (_, bridges) = holes::bridged(shapes::graph(3.0, 1.0, dome), Some(50.0));
    assert!(bridges.is_empty(), "{bridges:?}");
}

/// A block with a drill hole 1 mm wide whose wall goes down to a floor.
#[test]
fn a_drill_hole_of_a_solid_is_no_hole_of_its_mesh() {
    let mut mesh = sheet(12, 0.5, &[3.0, 20.0]);
    let (mut points, mut triangles) = (mesh.positions().to_vec(), mesh.triangles().to_vec());
    let first = u32::try_from(points.len()).unwrap();
    for side in 0..12 {
        points.push(Point3::new(points[side].x, points[side].y, -4.0));
    }
    for side in 0..12u32 {
        let next = (side + 1) % 12;
        triangles.extend([[side, next, first + next], [side, first + next, first + side]]);
    }
    triangles.extend((1..11).map(|side| [first, first + side, first + side + 1]));
    mesh = TriMesh::new(points, Vec::new(), triangles).unwrap();
    let (after, bridges) = holes::bridged(mesh.clone(), Some(2.0));
    assert!(bridges.is_empty() && after == mesh, "{bridges:?}");
}

#[test]
fn gaps_of_scans_are_bridged_up_to_the_same_width() {
    let points: Vec<Point3<f64>> = shapes::graph(20.0, 0.5, dome)
        .positions()
        .iter()
        .filter(|at| at.x.hypot(at.y) < 20.0 && (at.x - 3.0).hypot(at.y + 2.0) > 2.5)
        .copied()
        .collect();
    let cloud = PointCloud::new(points, Vec::new());
    let smoothed = |widest| {
        let scan = SmoothedScan::bridged(&cloud, &View::top(), Smoothing::Auto, widest, &InTurn).unwrap();
        FittedSurface::of_field(scan.field).unwrap()
    };
    assert!(off(&smoothed(None), [3.0, -2.0], 2.0).is_infinite());
    let off_there = off(&smoothed(Some(6.0)), [3.0, -2.0], 2.0);
    assert!(off_there < 0.02, "{off_there} mm");
}

#[test]
fn scans_have_no_holes_of_a_mesh() {
    let reading = read(&shapes::graph(20.0, 1.0, dome), false, Some(50.0));
    assert!(matches!(reading.shape, Shape::Mesh(_)) && notice(&reading).is_none());
}
