//! Fitted surfaces as files: another program that reads them gets the part.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail as tests do")]

use std::collections::BTreeMap;

use isomark::formats::mesh::{self, LengthUnit, MeshFormat, MeshOptions, UpAxis};
use isomark::formats::surface::{SurfaceFormat, write};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shapes;
use isomark::geometry::space::{Facing, View};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Rotation3, Vector3};

/// A ball of radius 30 mm that faces the laser from an oblique direction: the surface, the view and the ball's centre.
fn ball() -> (FittedSurface, View, Point3<f64>) {
    let up = shapes::graph(20.0, 0.75, shapes::sphere);
    let side = Vector3::new(1.0, -2.0, 0.5).normalize();
    let turn = Rotation3::rotation_between(&Vector3::z(), &side).unwrap();
    let shift = Vector3::new(100.0, 20.0, -7.0);
    let points = up.positions().iter().map(|point| turn * point + shift).collect();
    let part = TriMesh::new(points, Vec::new(), up.triangles().to_vec()).unwrap();
    let view = View::new(Facing::towards(side).unwrap(), 0.0);
    let surface = FittedSurface::of_part(&FacingPart::new(&part, &view), &FitOptions::default()).unwrap();
    (surface, view, Point3::from(shift))
}

#[test]
fn triangles_lie_on_the_part_and_face_the_laser() {
    let (surface, view, middle) = ball();
    let bytes = write(&surface, &view, "ball.glb", SurfaceFormat::Obj);
    let options = MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z);
    let reading = mesh::read(&bytes, MeshFormat::Obj, &options, &BTreeMap::new()).unwrap();
    let mesh = reading.shape.mesh().unwrap();
    assert!(mesh.triangles().len() > 10_000, "{}", mesh.triangles().len());
    for corners in mesh.triangles() {
        let [a, b, c] = mesh.corners(*corners);
        let normal = (b - a).cross(&(c - a));
        assert!(normal.dot(&(a - middle)) > 0.0, "a triangle faces inwards");
    }
    let seen = |point: &&Point3<f64>| view.point(**point - middle.coords).xy().coords.norm() < 17.0;
    let inner: Vec<_> = mesh.positions().iter().filter(seen).collect();
    assert!(inner.len() > 4_000);
    for point in inner {
        assert!(((point - middle).norm() - 30.0).abs() < 3e-4, "{point}");
    }
}

/// The entity instances of a STEP file by name, as text.
fn instances(bytes: &[u8]) -> BTreeMap<String, String> {
    let text = std::str::from_utf8(bytes).unwrap();
    let data = text.split_once("DATA;\n").unwrap().1.split_once("ENDSEC;").unwrap().0;
    data.lines()
        .map(|line| {
            let (name, entity) = line.strip_suffix(';').unwrap().split_once('=').unwrap();
            (name.to_owned(), entity.to_owned())
        })
        .collect()
}

/// The arguments of an entity: the texts between commas outside nested brackets.
fn arguments(text: &str) -> Vec<String> {
    let inner = &text[text.find('(').unwrap() + 1..text.rfind(')').unwrap()];
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for letter in inner.chars() {
        match letter {
            '(' => depth += 1,
            ')' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(String::new());
                continue;
            }
            _ => {}
        }
        parts.last_mut().unwrap().push(letter);
    }
    parts
}

fn numbers(text: &str) -> Vec<f64> {
    arguments(text).iter().map(|number| number.parse().unwrap()).collect()
}

/// All basis functions of degree 3 (Piegl & Tiller, The NURBS Book, eq. 2.5), straight from the recursion.
fn basis(knots: &[f64], index: usize, degree: usize, at: f64) -> f64 {
    if degree == 0 {
        return f64::from(u8::from(knots[index] <= at && at < knots[index + 1]));
    }
    let share = |from: f64, to: f64, part: f64| if to == from { 0.0 } else { part / (to - from) };
    share(knots[index], knots[index + degree], at - knots[index]) * basis(knots, index, degree - 1, at)
        + share(knots[index + 1], knots[index + degree + 1], knots[index + degree + 1] - at)
            * basis(knots, index + 1, degree - 1, at)
}

#[test]
fn the_spline_in_step_lies_on_the_part() {
    let (surface, view, middle) = ball();
    let bytes = write(&surface, &view, "ball 'ø'.glb", SurfaceFormat::Step);
    let instances = instances(&bytes);
    let point = |name: &str| {
        let coordinates = arguments(&instances[name]).remove(1);
        Point3::from(Vector3::from_vec(numbers(&coordinates)))
    };
    let entity = |kind: &str| {
        let found: Vec<_> = instances.values().filter(|text| text.starts_with(kind)).collect();
        assert_eq!(found.len(), 1, "{kind}");
        arguments(found[0])
    };
    let spline = entity("B_SPLINE_SURFACE_WITH_KNOTS");
    let net: Vec<Vec<Point3<f64>>> = arguments(&spline[3])
        .iter()
        .map(|column| arguments(column).iter().map(|name| point(name)).collect())
        .collect();
    let knots = |counts: &str, values: &str| -> Vec<f64> {
        let repeated = numbers(counts).into_iter().zip(numbers(values));
        repeated.flat_map(|(count, value)| std::iter::repeat_n(value, count as usize)).collect()
    };
    let (along_u, along_v) = (knots(&spline[8], &spline[10]), knots(&spline[9], &spline[11]));
    assert_eq!((along_u.len(), along_v.len()), (net.len() + 4, net[0].len() + 4));
    let at = |u: f64, v: f64| {
        let mut sum = Vector3::zeros();
        for (column, points) in net.iter().enumerate() {
            let weight = basis(&along_u, column, 3, u);
            if weight != 0.0 {
                for (row, point) in points.iter().enumerate() {
                    sum += point.coords * (weight * basis(&along_v, row, 3, v));
                }
            }
        }
        Point3::from(sum)
    };
    let on_view = view.point(middle);
    for (x, y) in [(0.0, 0.0), (9.0, 9.0), (-13.0, 4.0), (0.5, -16.0)] {
        let point = at(on_view.x + x, on_view.y + y);
        assert!(((point - middle).norm() - 30.0).abs() < 3e-4, "{point}");
    }

    // The border is a closed loop of four edges between the corners of the net.
    let (last_u, last_v) = (net.len() - 1, net[0].len() - 1);
    let corners = [net[0][0], net[last_u][0], net[last_u][last_v], net[0][last_v]];
    let edges: Vec<[Point3<f64>; 2]> = arguments(&arguments(&instances[&entity("FACE_OUTER_BOUND")[1]])[1])
        .iter()
        .map(|oriented| {
            let oriented = arguments(&instances[oriented]);
            let edge = arguments(&instances[&oriented[3]]);
            let curve = arguments(&instances[&edge[3]]);
            let ends = [1, 2].map(|end| point(&arguments(&instances[&edge[end]])[1]));
            let poles = arguments(&curve[2]);
            assert_eq!([&poles[0], &poles[poles.len() - 1]].map(|pole| point(pole)), ends);
            if oriented[4] == ".T." { ends } else { [ends[1], ends[0]] }
        })
        .collect();
    for (index, edge) in edges.iter().enumerate() {
        assert_eq!(*edge, [corners[index], corners[(index + 1) % 4]]);
    }
    assert!(String::from_utf8(bytes).unwrap().contains("PRODUCT('ball ''\\X4\\000000F8\\X0\\''.glb',"));
}
