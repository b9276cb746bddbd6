//! Flat shading does not tell a round part from an angular one: such files are read as if they had no normals, whatever the order of
//! their faces, or what they leave open is in the report. The truth are the formulas of the parts.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsChoice, NormalsFound, NormalsUsed, PartReading, UpAxis,
};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use isomark::reason::Notice;
use nalgebra::{Point3, Vector3};

use super::bounds::SLACK;
use super::small_ink::{LETTERS, Part};

/// Where the axis of all parts is below z = 0, mm.
const RADIUS: f64 = 30.0;

/// Half a profile: radius and place along the axis, which runs along y, mm.
type Profile = Vec<[f64; 2]>;

/// Polygons, each with normals for its corners.
#[derive(Default)]
struct Model {
    faces: Vec<Vec<(Point3<f64>, Vector3<f64>)>>,
    /// The program that wrote the file; empty if the file does not say it.
    producer: &'static str,
}

impl Model {
    fn flat(&mut self, corners: Vec<Point3<f64>>) {
        let next = |at: usize| corners[(at + 1) % corners.len()].coords;
        let normal = corners
            .iter()
            .enumerate()
            .map(|(at, corner)| corner.coords.cross(&next(at)))
            .sum::<Vector3<f64>>();
        self.faces.push(corners.into_iter().map(|corner| (corner, normal.normalize())).collect());
    }

    /// The faces of a turned part with so many `sides`; the first ones close its ends if `are_caps_first`, otherwise the last.
    fn turned(profile: &Profile, sides: usize, are_caps_first: bool) -> Self {
        let at = |row: usize, side: usize| {
            let [radius, along] = profile[row];
            let angle = TAU * (side as f64 + 0.5) / sides as f64;
            Point3::new(radius * angle.sin(), along, radius * angle.cos() - RADIUS)
        };
        let cap = |model: &mut Self, row: usize| {
            let ring = (0..sides).map(|side| at(row, side));
            if profile[row][0] > 0.0 {
                model.flat(if row == 0 { ring.collect() } else { ring.rev().collect() });
            }
        };
        let (mut model, last) = (Self::default(), profile.len() - 1);
        if are_caps_first {
            [0, last].into_iter().for_each(|row| cap(&mut model, row));
        }
        for row in 0..last {
            for side in 0..sides {
                let next = (side + 1) % sides;
                let mut corners = vec![at(row, next), at(row, side), at(row + 1, side), at(row + 1, next)];
                corners.dedup_by(|one, other| (*one - *other).norm() < 1e-9);
                if (corners[0] - corners[corners.len() - 1]).norm() < 1e-9 {
                    corners.pop();
                }
                corners.reverse();
                model.flat(corners);
            }
        }
        if !are_caps_first {
            [0, last].into_iter().for_each(|row| cap(&mut model, row));
        }
        model
    }

    /// A prism of 30 mm with so many `sides` that is twisted by 10° on 80 mm in 40 steps, each quadrilateral of which is cut into
    /// two triangles.
    fn twisted(sides: usize) -> Self {
        let at = |step: usize, side: usize| {
            let angle = TAU * ((side as f64 + 0.5) / sides as f64 + 10.0 / 360.0 * step as f64 / 40.0);
            Point3::new(RADIUS * angle.sin(), 2.0 * step as f64 - 40.0, RADIUS * angle.cos() - RADIUS)
        };
        let mut model = Self::default();
        for step in 0..40 {
            for side in 0..sides {
                model.flat_triangle([at(step, side), at(step, side + 1), at(step + 1, side + 1)]);
                model.flat_triangle([at(step, side), at(step + 1, side + 1), at(step + 1, side)]);
            }
        }
        model
    }

    fn flat_triangle(&mut self, corners: [Point3<f64>; 3]) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a)).normalize();
        self.faces.push(corners.into_iter().map(|corner| (corner, normal)).collect());
    }

    fn without_normals(mut self) -> Self {
        self.faces.iter_mut().flatten().for_each(|(_, normal)| *normal = Vector3::zeros());
        self
    }

    /// An ellipsoid beside the marked part, in smooth shading: its normals are exact, and no averages.
    fn with_smooth_egg(mut self) -> Self {
        let at = |row: usize, side: usize| {
            let (out, along) = (TAU * row as f64 / 48.0).sin_cos();
            let angle = TAU * side as f64 / 48.0;
            Vector3::new(out * angle.sin(), along, out * angle.cos())
        };
        for row in 0..24 {
            for side in 0..48 {
                let mut corners =
                    vec![at(row, side), at(row, side + 1), at(row + 1, side + 1), at(row + 1, side)];
                corners.dedup_by(|one, other| (*one - *other).norm() < 1e-9);
                let (middle, half_axes) = (Point3::new(90.0, 0.0, -RADIUS), Vector3::new(8.0, 16.0, 8.0));
                let on_egg = |on_ball: Vector3<f64>| {
                    let normal = on_ball.component_div(&half_axes).normalize();
                    (middle + on_ball.component_mul(&half_axes), normal)
                };
                self.faces.push(corners.into_iter().map(on_egg).collect());
            }
        }
        self
    }

    /// The wall of a can of 30 mm in `sides` flat facets between two rims with fillets of 4 mm in smooth shading.
    fn can_with_smooth_rims(sides: usize) -> Self {
        let mut model = Self::turned(&vec![[RADIUS, -25.0], [RADIUS, 25.0]], sides, true);
        model.faces.drain(..2);
        let on_fillet = |end: f64, step: usize, side: usize| {
            let (up, out) = (TAU / 4.0 * step as f64 / 6.0).sin_cos();
            let angle = TAU * (side as f64 + 0.5) / sides as f64;
            let radius = RADIUS - 4.0 + 4.0 * out;
            let along = end * (25.0 + 4.0 * up);
            let normal = Vector3::new(out * angle.sin(), end * up, out * angle.cos());
            (Point3::new(radius * angle.sin(), along, radius * angle.cos() - RADIUS), normal)
        };
        for end in [-1.0, 1.0] {
            for step in 0..6 {
                for side in 0..sides {
                    let corner = |step: usize, side: usize| on_fillet(end, step, side);
                    let mut face = vec![
                        corner(step, side),
                        corner(step, side + 1),
                        corner(step + 1, side + 1),
                        corner(step + 1, side),
                    ];
                    if end > 0.0 {
                        face.reverse();
                    }
                    model.faces.push(face);
                }
            }
        }
        model
    }

    fn by_cad(self) -> Self {
        Self { producer: "# FreeCAD v0.21\n", ..self }
    }

    fn read(&self, normals: NormalsChoice) -> PartReading {
        let mut text = self.producer.to_owned();
        let mut first = 1;
        for face in &self.faces {
            for (at, normal) in face {
                writeln!(text, "v {:.6} {:.6} {:.6}", at.x, at.y, at.z).unwrap();
                if *normal != Vector3::zeros() {
                    writeln!(text, "vn {:.4} {:.4} {:.4}", normal.x, normal.y, normal.z).unwrap();
                }
            }
            let has_normals = face.iter().all(|(_, normal)| *normal != Vector3::zeros());
            let corners = (first..first + face.len()).map(|corner| match has_normals {
                true => format!("{corner}//{corner}"),
                false => corner.to_string(),
            });
            writeln!(text, "f {}", corners.collect::<Vec<_>>().join(" ")).unwrap();
            first += face.len();
        }
        let options =
            MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z).with_normals(normals);
        mesh::read(text.as_bytes(), MeshFormat::Obj, &options, &Default::default()).unwrap()
    }
}

fn fitted(reading: &PartReading) -> FittedSurface {
    let part = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
    FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
}

/// The reported and the true length error of the letters, mm.
fn length_errors(reading: &PartReading, height: impl Fn(f64, f64) -> f64 + 'static) -> [f64; 2] {
    let part = Part::new(String::new(), fitted(reading), height);
    part.judged(LETTERS, FlatPoint::new(0.0, 2.0), 0.3).unwrap().after.map(|of| of.length_error)
}

fn cylinder() -> Profile {
    vec![[RADIUS, -30.0], [RADIUS, 30.0]]
}

/// The round part: its radius at a place along the axis, mm.
type Radius = fn(f64) -> f64;

/// A profile with the radius of a part at `rows` + 1 places from −`end` to `end`, mm.
fn cut(radius: Radius, end: f64, rows: usize) -> Profile {
    let along = |row: usize| end * (2.0 * row as f64 / rows as f64 - 1.0);
    (0..=rows).map(|row| [radius(along(row)), along(row)]).collect()
}

/// A surface over 80 × 60 mm in `count` × `count` quadrangles, which need not be plane.
fn sheet(count: usize, height: impl Fn(f64, f64) -> f64) -> Model {
    let at = |column: usize, row: usize| {
        let (x, y) = (80.0 * (column as f64 / count as f64 - 0.5), 60.0 * (row as f64 / count as f64 - 0.5));
        Point3::new(x, y, height(x, y))
    };
    let mut model = Model::default();
    for (column, row) in (0..count).flat_map(|row| (0..count).map(move |column| (column, row))) {
        let [near, far] = [row, row + 1];
        model.flat(vec![at(column, near), at(column + 1, near), at(column + 1, far), at(column, far)]);
    }
    model
}

/// A twisted quadrangle in flat shading has the normal of its area vector, which leaves its triangles by up to 10° here.
#[test]
fn twisted_quadrangles_in_flat_shading_are_upper_estimates() {
    let saddle = |x: f64, y: f64| x * y / 80.0;
    for count in [4, 6, 8, 16] {
        let reading = sheet(count, saddle).read(NormalsChoice::Auto);
        assert_eq!(reading.facts.normals, NormalsFound::FacetsOnly, "{count}");
        let [reported, truth] = length_errors(&reading, saddle);
        assert!(reported >= truth - SLACK[0], "{count}: {truth:.4} is reported as {reported:.4}");
        assert!(truth < 0.3, "{count}: {truth:.4}");
    }
}

/// The vertices scatter in z; so the quadrangles are neither plane nor parts of a round face.
#[test]
fn noisy_quadrangles_in_flat_shading_are_smoothed() {
    let height = |x: f64, y: f64| {
        let mixed = ((x * 71.3 + y * 313.7).sin() * 43_758.545_3).fract();
        x * y / 80.0 + 0.1 * mixed
    };
    let reading = sheet(60, height).read(NormalsChoice::Auto);
    assert_eq!(reading.facts.normals, NormalsFound::FacetsOnly);
    assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Smoothed));
}

const PARTS: [(&str, Radius, usize); 4] = [
    ("cylinder", |_| RADIUS, 1),
    ("cone", |y| RADIUS + 0.15 * y, 1),
    ("barrel", |y| RADIUS - 80.0 + (6400.0 - y * y).sqrt(), 12),
    ("egg", |y| RADIUS * (1.0 - (y / 40.0).powi(2)).sqrt() * (1.0 + 0.003 * y), 16),
];

#[test]
fn round_parts_in_flat_shading_are_upper_estimates() {
    let mut failures = Vec::new();
    for (name, radius, rows) in PARTS {
        for sides in [12, 16, 24, 32, 48, 64, 96] {
            for are_caps_first in [true, false] {
                let model = Model::turned(&cut(radius, 30.0, rows), sides, are_caps_first);
                let reading = model.read(NormalsChoice::Auto);
                let [reported, truth] =
                    length_errors(&reading, move |x, y| (radius(y).powi(2) - x * x).sqrt() - RADIUS);
                let part = format!("{name} {sides} sides, caps first {are_caps_first}");
                println!("{part:40} {reported:8.4} {truth:8.4} {:?}", reading.facts.normals);
                if reported < truth - SLACK[0] || reading.facts.normals != NormalsFound::FacetsOnly {
                    failures.push(format!("{part}: {truth:.4} is reported as {reported:.4}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Each body of a file is shaded in its own way.
#[test]
fn a_flat_body_beside_a_smooth_one_is_read_without_its_normals() {
    for sides in [16, 32, 96] {
        let model = Model::turned(&cylinder(), sides, true).with_smooth_egg();
        let reading = model.read(NormalsChoice::Auto);
        assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Mixed));
        let [reported, truth] = length_errors(&reading, |x, _| (RADIUS * RADIUS - x * x).sqrt() - RADIUS);
        assert!(reported >= truth - SLACK[0] && truth < 0.05, "{sides}: {truth} is reported as {reported}");
        let stated = model.read(NormalsChoice::File);
        assert_eq!(stated.facts.normals_used, Some(NormalsUsed::File));
    }
}

/// Where the rest of a body is smooth, its flat facets may be meant. Both readings are in the report, unless a setting decides.
#[test]
fn flat_facets_of_a_smooth_body_are_in_doubt() {
    for sides in [12, 16, 32] {
        let model = Model::can_with_smooth_rims(sides);
        let reading = model.read(NormalsChoice::Auto);
        assert_eq!(reading.facts.normals_used, Some(NormalsUsed::File));
        assert!(reading.facts.notices.iter().any(|notice| notice.code == "facets-flat"));
        let round = |x: f64, _: f64| (RADIUS * RADIUS - x * x).sqrt() - RADIUS;
        let [reported, truth] = length_errors(&reading, round);
        assert!(reported >= truth, "{sides}: {truth} is reported as {reported}");
        // In the middle of the upper facet.
        let slope = |reading: &PartReading| fitted(reading).uncertainty(ViewPoint::new(0.3, 0.3)).slope;
        let [open, stated] = [&reading, &model.read(NormalsChoice::File)].map(slope);
        assert!(open > 0.05 && stated < 0.001, "{sides}: {open} rad and {stated} rad");
    }
}

/// A program that knows the faces shades what is round smooth, so that flat facets are flat faces.
#[test]
fn flat_faces_from_cad_are_flat() {
    let beside = Model::turned(&cylinder(), 12, true).with_smooth_egg();
    for model in [beside.by_cad(), Model::can_with_smooth_rims(12).by_cad()] {
        let reading = model.read(NormalsChoice::Auto);
        assert_eq!(reading.facts.normals_used, Some(NormalsUsed::File));
        assert_eq!(doubt(&reading), None);
        // The upper facet is a plane through its chord.
        let surface = fitted(&reading);
        let height = |x: f64| surface.sampled_height(ViewPoint::new(x, 0.3)).unwrap();
        let plane = RADIUS * (TAU / 24.0).cos() - RADIUS;
        assert!([-5.0, 0.3, 5.0].iter().all(|x| (height(*x) - plane).abs() < 1e-3), "{}", height(0.3));
        assert!(surface.uncertainty(ViewPoint::new(0.3, 0.3)).slope < 0.001);
    }
    // Without anything smooth, nothing shows what the program shades flat.
    let alone = Model::turned(&cylinder(), 12, true).by_cad().read(NormalsChoice::Auto);
    assert!(doubt(&alone).is_some());
}

/// The warning that facets may be flat or round.
fn doubt(reading: &PartReading) -> Option<&Notice> {
    let mut notices = reading.facts.notices.iter();
    notices.find(|notice| ["facets-rounded", "facets-flat"].contains(&notice.code.as_str()))
}

#[test]
fn what_flat_facets_are_taken_for_is_stated_with_the_choice() {
    let of = |model: &Model, normals: NormalsChoice| doubt(&model.read(normals)).cloned();
    // The sagitta of a chord: 30 mm * (1 - cos(180 deg / sides)).
    for (sides, sagitta) in [(12, 1.02), (16, 0.58), (24, 0.26)] {
        let alone = Model::turned(&cylinder(), sides, true);
        let beside = Model::turned(&cylinder(), sides, true).with_smooth_egg();
        // All facets are kept, or those that the file shades flat.
        for (model, choice) in [(alone, "--normals facets"), (beside, "--normals file")] {
            let notice = of(&model, NormalsChoice::Auto).unwrap();
            let text = &notice.message;
            let said: f64 = text.split("up to ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert!((said - sagitta).abs() < 0.1 * sagitta, "{sides}: {text}");
            assert!(notice.code == "facets-rounded" && text.contains(choice), "{sides}: {text}");
            for decided in [NormalsChoice::File, NormalsChoice::Facets, NormalsChoice::Estimate] {
                assert_eq!(of(&model, decided), None);
            }
        }
    }
    // As fine as CAD programs cut, and as coarse as no round part is.
    assert_eq!(of(&Model::turned(&cylinder(), 64, true), NormalsChoice::Auto), None);
    assert_eq!(of(&Model::turned(&cylinder(), 6, true), NormalsChoice::Auto), None);
}

/// The two triangles of a quadrilateral on a twisted side lean by up to 2.5° from one another.
#[test]
fn the_sides_of_twisted_prisms_may_be_round_as_well() {
    let of = |model: Model| doubt(&model.read(NormalsChoice::Auto)).cloned();
    for sides in [10, 12, 14, 16] {
        let sagitta = RADIUS * (1.0 - (TAU / 2.0 / sides as f64).cos());
        for model in [Model::twisted(sides), Model::twisted(sides).without_normals()] {
            let text = of(model).unwrap_or_else(|| panic!("{sides} sides: no doubt")).message;
            let said: f64 = text.split("up to ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert!((said - sagitta).abs() < 0.1 * sagitta, "{sides}: {text} instead of {sagitta}");
        }
    }
    assert_eq!(of(Model::twisted(6).without_normals()), None);
}

/// CAD programs let facets turn by 0.5 rad. Where they turn more, lengths along small facets differ by more than 1 %, too.
#[test]
fn small_facets_are_in_doubt_if_they_turn_more_than_cad_programs_let_them() {
    let of = |sides: usize| {
        let small = Model::turned(&vec![[4.0, -4.0], [4.0, 4.0]], sides, true);
        doubt(&small.read(NormalsChoice::Auto)).cloned()
    };
    // The share by which the arc is longer than its chord: 1 - sin(15 deg) / (pi / 12).
    assert!(of(12).unwrap().message.contains(" 1.1 %"));
    assert_eq!(of(13), None);
}

/// Prisms and roofs are what their normals say.
#[test]
fn angular_parts_keep_their_normals() {
    let hexagon = Model::turned(&cylinder(), 6, true).read(NormalsChoice::Auto);
    assert_eq!(hexagon.facts.normals, NormalsFound::Smooth);
    // In the middle of the upper facet.
    assert_eq!(fitted(&hexagon).uncertainty(ViewPoint::new(0.3, 0.3)).slope, 0.0);
}
