//! Marks that go round a part: a simulated laser marks every tile of the delivered drawing on a cylinder or cone that is
//! turned by the angle of the table. The marks must be where the drawing, rolled round the part, has them.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;

use isomark::formats::pattern::{PatternOptions, read};
use nalgebra::{Point2, Point3, Rotation3, Unit, Vector3};
use serde_json::{Value, json};

use crate::desk::{Desk, assert_near, notices, number};
use crate::{ezdxf, schemas};

const AT_VERTICES: f64 = 1e-3;
const TOLERANCE: f64 = 0.01;

/// A cylinder or cone whose crest is at the origin of the view.
#[derive(Clone, Copy)]
struct Part {
    options: &'static str,
    start_radius: f64,
    end_radius: f64,
    length: f64,
    /// From the first end, in the view.
    axis: [f64; 3],
}

const PARTS: [Part; 4] = [
    Part {
        options: "--cylinder 66,120",
        start_radius: 33.0,
        end_radius: 33.0,
        length: 120.0,
        axis: [0.0, 1.0, 0.0],
    },
    Part {
        options: "--cylinder 40,90 --axis x",
        start_radius: 20.0,
        end_radius: 20.0,
        length: 90.0,
        axis: [1.0, 0.0, 0.0],
    },
    Part {
        options: "--cone 60,85,120",
        start_radius: 30.0,
        end_radius: 42.5,
        length: 120.0,
        axis: [0.0, 1.0, 0.0],
    },
    Part {
        options: "--cone 85,50,60 --axis x",
        start_radius: 42.5,
        end_radius: 25.0,
        length: 60.0,
        axis: [1.0, 0.0, 0.0],
    },
];

impl Part {
    fn axis(&self) -> Vector3<f64> {
        self.axis.into()
    }

    fn taper(&self) -> f64 {
        (self.end_radius - self.start_radius) / self.length
    }

    fn middle_radius(&self) -> f64 {
        f64::midpoint(self.start_radius, self.end_radius)
    }

    /// The middle of the axis in the view.
    fn middle(&self) -> Point3<f64> {
        Point3::new(0.0, 0.0, -self.middle_radius())
    }

    /// Signed distance outside of the part, measured across the axis.
    fn outside(&self, at: Point3<f64>) -> f64 {
        let along = (at - self.middle()).dot(&self.axis());
        let across = (at - self.middle()) - self.axis() * along;
        across.norm() - self.middle_radius() - self.taper() * along
    }

    /// Angle of the developed sector for an angle about the axis, and distance of the anchor from the apex; none on a cylinder.
    fn sector(&self) -> Option<(f64, f64)> {
        let sin = self.taper().abs().atan().sin();
        (self.taper() != 0.0).then(|| (sin, self.middle_radius() / sin))
    }

    /// The places of the points of a line on the part in the unrolled drawing, whose x goes round the axis.
    fn unrolled(&self, line: &[Point3<f64>]) -> Vec<Point2<f64>> {
        // Angles are measured from the middle of the line, so that none jumps.
        let middle = line.iter().map(|at| at - self.middle()).sum::<Vector3<f64>>();
        let middle = self.angle(self.middle() + middle);
        line.iter().map(|at| self.unrolled_from(*at, middle)).collect()
    }

    /// The angle of a point about the axis, rad.
    fn angle(&self, at: Point3<f64>) -> f64 {
        let from_middle = at - self.middle();
        let round = self.axis().cross(&Vector3::z());
        from_middle.dot(&round).atan2(from_middle.z)
    }

    fn unrolled_from(&self, at: Point3<f64>, middle: f64) -> Point2<f64> {
        let along = (at - self.middle()).dot(&self.axis());
        let round = self.axis().cross(&Vector3::z());
        let away = self.angle(at) - middle;
        let angle = middle + away - TAU * (away / TAU).round();
        // The drawing's x is to the right in the view, or upwards where the axis is horizontal; y is to its left.
        let sense = if round.x + round.y > 0.0 { 1.0 } else { -1.0 };
        let angle = angle * sense;
        let up = along * sense;
        match self.sector() {
            None => Point2::new(angle * self.middle_radius(), up),
            Some((sin, start)) => {
                let out = start + along * self.taper().signum() * (1.0 + self.taper().powi(2)).sqrt();
                let polar = angle * sin;
                // The apex is below or above the anchor.
                let side = self.taper().signum() * sense;
                Point2::new(out * polar.sin(), side * (out * polar.cos() - start))
            }
        }
    }

    /// The drawing on this part, whose straight lines are round the axis on a cylinder: a band of letters with a ring above
    /// and below.
    fn drawing(&self, share: f64, letters: usize, rings: bool) -> Drawing {
        let half = PI * self.middle_radius() * share;
        let mut lines: Vec<Vec<Point2<f64>>> = Vec::new();
        // An arc about the apex stays at one height on the cone.
        let bend = |x: f64, y: f64| match self.sector() {
            None => Point2::new(x, y),
            Some((sin, start)) => {
                let round = self.axis().cross(&Vector3::z());
                let side = self.taper().signum() * (round.x + round.y).signum();
                let (out, polar) = (start + side * y, x / self.middle_radius() * sin);
                Point2::new(out * polar.sin(), side * (out * polar.cos() - start))
            }
        };
        let step = 2.0 * half / letters as f64;
        let letter = [
            [0.0, -3.0],
            [0.6, -3.0],
            [0.6, -0.5],
            [0.3, 0.0],
            [0.6, 0.5],
            [0.6, 3.0],
            [0.0, 3.0],
            [0.0, -3.0],
        ];
        for number in 0..letters {
            let from = -half + step * (number as f64 + 0.2);
            lines.push(letter.iter().map(|[x, y]| bend(from + x * step, *y)).collect());
        }
        if rings {
            for y in [-5.0, 5.5] {
                let count = if self.sector().is_some() { 720 } else { 1 };
                let at = |index: i32| bend(-half + 2.0 * half * f64::from(index) / f64::from(count), y);
                lines.push((0..=count).map(at).collect());
            }
        }
        Drawing(lines)
    }
}

struct Drawing(Vec<Vec<Point2<f64>>>);

impl Drawing {
    fn dxf(&self) -> String {
        let mut text =
            "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
        for line in &self.0 {
            let is_closed = line.first() == line.last();
            let points = &line[..line.len() - usize::from(is_closed)];
            let layer = if is_closed { "TEXT" } else { "RING" };
            write!(text, "0\nLWPOLYLINE\n8\n{layer}\n90\n{}\n70\n{}\n", points.len(), u8::from(is_closed))
                .unwrap();
            for at in points {
                write!(text, "10\n{:?}\n20\n{:?}\n", at.x, at.y).unwrap();
            }
        }
        text + "0\nENDSEC\n0\nEOF\n"
    }

    fn length(&self) -> f64 {
        self.0.iter().map(|line| line_length(line)).sum()
    }

    fn distance(&self, at: Point2<f64>) -> f64 {
        self.0.iter().map(|line| distance_to(line, at)).fold(f64::INFINITY, f64::min)
    }
}

fn line_length(line: &[Point2<f64>]) -> f64 {
    line.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum()
}

fn distance_to(line: &[Point2<f64>], at: Point2<f64>) -> f64 {
    let to_piece = |pair: &[Point2<f64>]| {
        let along = pair[1] - pair[0];
        let t = ((at - pair[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (pair[0] + along * t - at).norm()
    };
    line.windows(2).map(to_piece).fold(f64::INFINITY, f64::min)
}

/// The laser: its lens distances, the axis of the lens in the field, and the fixture of the part.
#[derive(Clone, Copy)]
struct Laser {
    lens: Option<[f64; 2]>,
    axis: [f64; 2],
    fixture: [f64; 3],
    rotation_deg: f64,
}

const LASERS: [Laser; 4] = [
    Laser { lens: None, axis: [0.0, 0.0], fixture: [0.0; 3], rotation_deg: 0.0 },
    Laser { lens: Some([300.0, 285.0]), axis: [0.0, 0.0], fixture: [0.0, 0.0, 0.0], rotation_deg: 0.0 },
    Laser { lens: Some([210.0, 230.0]), axis: [-8.0, 3.5], fixture: [30.0, -25.0, 6.0], rotation_deg: 0.0 },
    Laser { lens: Some([180.0, 170.0]), axis: [0.0, 0.0], fixture: [-20.0, 15.0, -12.0], rotation_deg: 35.0 },
];

impl Laser {
    fn settings(&self) -> String {
        let [x, y, z] = self.fixture;
        let lens = self.lens.map_or("kind = \"telecentric\"".into(), |[x, y]| {
            format!(
                "kind = \"perspective\"\nlens_distance_x_mm = {x:?}\nlens_distance_y_mm = {y:?}\naxis_mm = {:?}",
                self.axis
            )
        });
        format!(
            "[station]\nname = \"simulated\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 200\nheight_mm \
             = 200\n[optics]\n{lens}\n[fixture]\nx_mm = {x:?}\ny_mm = {y:?}\nz_mm = {z:?}\nrotation_deg = {:?}\n",
            self.rotation_deg
        )
    }

    fn spin(&self) -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vector3::z_axis(), self.rotation_deg.to_radians())
    }

    fn in_view(&self, at: Point3<f64>) -> Point3<f64> {
        self.spin().inverse() * (at - Vector3::from(self.fixture))
    }

    fn in_field(&self, view: Point3<f64>) -> Point3<f64> {
        self.spin() * view + Vector3::from(self.fixture)
    }

    /// The point at height `z` of the beam that passes `aim` at z = 0.
    fn beam(&self, aim: Point2<f64>, z: f64) -> Point3<f64> {
        let Some([x, y]) = self.lens else { return Point3::new(aim.x, aim.y, z) };
        let [axis_x, axis_y] = self.axis;
        Point3::new(axis_x + (aim.x - axis_x) * (x - z) / x, axis_y + (aim.y - axis_y) * (y - z) / y, z)
    }

    /// Where the beam first meets the part, in the laser's frame. A turn of the part about its own axis changes nothing.
    fn cast(&self, aim: Point2<f64>, part: &Part) -> Point3<f64> {
        let outside = |z: f64| part.outside(self.in_view(self.beam(aim, z)));
        let highest = self.fixture[2] + 20.0;
        let inside = (0..2000).map(|step| highest - 0.05 * f64::from(step)).find(|z| outside(*z) <= 0.0);
        let mut below = inside.unwrap_or_else(|| panic!("the beam through {aim} misses the part"));
        let mut above = below + 0.05;
        for _ in 0..60 {
            let middle = f64::midpoint(above, below);
            if outside(middle) > 0.0 { above = middle } else { below = middle }
        }
        self.beam(aim, f64::midpoint(above, below))
    }
}

/// The polylines of a drawing with their layers; contours repeat their first point.
fn polylines(dxf: &[u8]) -> Vec<(String, Vec<Point2<f64>>)> {
    let reading = read(dxf, &PatternOptions::default().strictly(true)).unwrap();
    let pattern = reading.pattern;
    let line = |path: &isomark::geometry::pattern::Path| {
        let segments = path.shape.segments();
        let starts = segments.iter().map(|segment| segment.start());
        let ends = starts.chain(segments.last().map(|segment| segment.end()));
        let points = ends.map(|at| Point2::from(at.coords())).collect();
        (pattern.layers[path.layer].name.clone(), points)
    };
    pattern.paths.iter().map(line).collect()
}

/// The rotary axis of a table, and its tiles by the names of their layers.
struct Table {
    axis: Unit<Vector3<f64>>,
    point: Point3<f64>,
    angles: BTreeMap<String, f64>,
}

impl Table {
    fn of(mark: &Value) -> Self {
        let vector = |key: &str| {
            let list: Vec<f64> =
                mark[key].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
            Vector3::new(list[0], list[1], list[2])
        };
        let tiles = mark["tiles"].as_array().unwrap();
        let angles = tiles.iter().flat_map(|tile| {
            let angle = tile["angle_deg"].as_f64().unwrap();
            let layers = tile["layers"].as_array().unwrap();
            layers.iter().map(move |layer| (layer.as_str().unwrap().to_owned(), angle))
        });
        Self {
            axis: Unit::new_normalize(vector("axis")),
            point: Point3::from(vector("axis_point_mm")),
            angles: angles.collect(),
        }
    }

    /// A point of the turned part, in the laser's frame, turned back.
    fn turned_back(&self, at: Point3<f64>, layer: &str) -> Point3<f64> {
        let angle = self.angles[layer];
        self.point + Rotation3::from_axis_angle(&self.axis, -angle.to_radians()) * (at - self.point)
    }
}

/// Where a delivered drawing is on the part: each line with its layer, in the unrolled drawing, and in three dimensions.
struct Mark {
    flat: Vec<(String, Vec<Point2<f64>>)>,
    points: Vec<Vec<Point3<f64>>>,
}

fn marked(dxf: &[u8], mark: &Value, laser: &Laser, part: &Part) -> Mark {
    let table = Table::of(mark);
    let known = laser.spin() * part.axis();
    assert!(table.axis.cross(&known).norm() < 1e-9, "{}", table.axis.as_ref());
    let beside = table.point - laser.in_field(part.middle());
    assert!(beside.cross(&known).norm() < 1e-6, "{beside}");
    let (mut flat, mut points) = (Vec::new(), Vec::new());
    for (layer, line) in polylines(dxf) {
        let on_part: Vec<Point3<f64>> =
            line.iter().map(|aim| laser.in_view(table.turned_back(laser.cast(*aim, part), &layer))).collect();
        flat.push((layer, part.unrolled(&on_part)));
        points.push(on_part);
    }
    Mark { flat, points }
}

fn report(desk: &Desk, part: &Part, options: &str) -> Value {
    desk.correct_to(
        "out.dxf",
        &["drawing.dxf"],
        &format!("{} --station station.toml --anchor origin {options}", part.options),
    )
}

/// Every laser with every part.
fn each(mut judge: impl FnMut(&Desk, &str, &Laser, &Part)) {
    let desk = Desk::new();
    for (number, laser) in LASERS.iter().enumerate() {
        for part in &PARTS {
            desk.write("station.toml", laser.settings());
            judge(&desk, &format!("{} at laser {number}", part.options), laser, part);
        }
    }
}

#[test]
fn a_text_round_the_whole_part_is_at_its_place_under_the_simulated_laser() {
    each(|desk, case, laser, part| {
        let drawing = part.drawing(1.0, 40, true);
        desk.write("drawing.dxf", drawing.dxf());
        let report = report(desk, part, "--rotary --vertices keep");
        let rotary = &report["rotary"];
        let mark = marked(&desk.read("out.dxf"), rotary, laser, part);
        assert!(rotary["tiles"].as_array().unwrap().len() > 3, "{case}");
        assert_near(&[number(rotary, "/width_deg")], &[360.0], 1e-3);
        let mut length = 0.0;
        for (layer, line) in &mark.flat {
            for at in line {
                let miss = drawing.distance(*at);
                assert!(miss <= AT_VERTICES, "{case}: {miss} mm at {at} of {layer}");
            }
            length += line_length(line);
        }
        assert!((length - drawing.length()).abs() < 0.05, "{case}: {length} of {}", drawing.length());
        let sum: f64 = rotary["tiles"].as_array().unwrap().iter().map(|tile| number(tile, "/ink_mm")).sum();
        assert!((sum - drawing.length()).abs() < 0.01, "{case}: {sum} of {}", drawing.length());
        // No letter is cut, and the rings are cut at every border.
        let contours = mark.flat.iter().filter(|(layer, _)| layer.ends_with("TEXT")).count();
        assert_eq!(contours, 40, "{case}");
        let is_within = |tile: &Value| number(tile, "/incidence_deg") <= 30.0;
        assert!(rotary["tiles"].as_array().unwrap().iter().all(is_within), "{case}: {rotary:#}");
        assert!(!notices(&report).contains(&"steep"), "{case}");
    });
}

#[test]
fn a_ring_closes_on_itself_and_its_tiles_join() {
    each(|desk, case, laser, part| {
        desk.write("drawing.dxf", part.drawing(1.0, 12, true).dxf());
        let report = report(desk, part, "--rotary");
        let mark = marked(&desk.read("out.dxf"), &report["rotary"], laser, part);
        let rings: Vec<&Vec<Point3<f64>>> = mark
            .flat
            .iter()
            .zip(&mark.points)
            .filter(|((layer, _), _)| layer.ends_with("RING"))
            .map(|(_, points)| points)
            .collect();
        let tiles = report["rotary"]["tiles"].as_array().unwrap().len();
        assert_eq!(rings.len(), 2 * tiles, "{case}");
        let ends: Vec<Point3<f64>> = rings.iter().flat_map(|ring| [ring[0], ring[ring.len() - 1]]).collect();
        for (index, end) in ends.iter().enumerate() {
            let others = ends.iter().enumerate().filter(|(other, _)| *other != index);
            let nearest = others.map(|(_, other)| (other - end).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest <= AT_VERTICES, "{case}: {nearest} mm");
        }
    });
}

#[test]
fn chords_of_tiles_stay_within_their_tolerance() {
    each(|desk, case, laser, part| {
        let drawing = part.drawing(0.8, 25, true);
        desk.write("drawing.dxf", drawing.dxf());
        let report = report(desk, part, &format!("--rotary --tolerance {TOLERANCE}"));
        let table = Table::of(&report["rotary"]);
        for (layer, line) in polylines(&desk.read("out.dxf")) {
            for pair in line.windows(2) {
                let at = |share: f64| {
                    let aim = pair[0] + (pair[1] - pair[0]) * share;
                    laser.in_view(table.turned_back(laser.cast(aim, part), &layer))
                };
                for on_part in part.unrolled(&[0.2, 0.5, 0.8].map(at)) {
                    // The tolerance is in the field; up to 30° of incidence make it longer on the part.
                    let miss = drawing.distance(on_part);
                    assert!(miss <= 1.2 * TOLERANCE + AT_VERTICES, "{case}: {miss} mm");
                }
            }
        }
    });
}

#[test]
fn only_the_overlap_is_marked_twice() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[1].settings());
    let part = &PARTS[0];
    let drawing = part.drawing(1.0, 30, true);
    desk.write("drawing.dxf", drawing.dxf());
    for overlap in [0.0, 0.3, 2.0] {
        let report = report(&desk, part, &format!("--rotary --overlap {overlap} --vertices keep"));
        let rotary = &report["rotary"];
        let tiles = rotary["tiles"].as_array().unwrap();
        let sum: f64 = tiles.iter().map(|tile| number(tile, "/ink_mm")).sum();
        let cuts = number(rotary, "/cuts_through_ink");
        assert_eq!(cuts as usize, tiles.len() - 1);
        // Two rings cross every cut.
        assert_near(&[sum], &[drawing.length() + 2.0 * cuts * overlap], 0.01);
        let mark = marked(&desk.read("out.dxf"), rotary, &LASERS[1], part);
        let on_part: f64 = mark.flat.iter().map(|(_, line)| line_length(line)).sum();
        assert_near(&[on_part], &[sum], 0.02);
        assert_near(&[number(&report, "/quality/after/length_mm")], &[sum], 0.01);
    }
}

#[test]
fn letters_alone_are_divided_in_their_gaps() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[2].settings());
    for part in &PARTS {
        let drawing = part.drawing(0.95, 22, false);
        desk.write("drawing.dxf", drawing.dxf());
        let report = report(&desk, part, "--rotary --overlap 1");
        assert_eq!(report["rotary"]["cuts_through_ink"], 0);
        let lines = polylines(&desk.read("out.dxf"));
        assert_eq!(lines.len(), 22);
        assert!(lines.iter().all(|(_, line)| line.first() == line.last()));
    }
}

#[test]
fn a_mark_round_a_real_can_closes_and_keeps_its_lengths() {
    let desk = Desk::new();
    let can = format!("{}/examples/parts/can.glb", env!("CARGO_MANIFEST_DIR"));
    let part =
        Part { options: "", start_radius: 33.0, end_radius: 33.0, length: 100.0, axis: [0.0, 1.0, 0.0] };
    desk.write("drawing.dxf", part.drawing(0.5, 10, true).dxf());
    let options = "--facing=-y --anchor origin --place 0,60 --rotary";
    let report = desk.correct(&can, "drawing.dxf", options);
    let radius = number(&report, "/map/radius_mm");
    assert!(number(&report, "/map/residual_mm") <= 0.005);
    let part = Part { start_radius: radius, end_radius: radius, ..part };
    let drawing = part.drawing(1.0, 30, true);
    desk.write("drawing.dxf", drawing.dxf());
    let report = desk.correct(&can, "drawing.dxf", &format!("{options} --vertices keep"));
    let after = &report["quality"]["after"];
    assert!(number(after, "/length_error_mm") < 2e-3 * number(after, "/length_mm"), "{after:#}");
    // The can of the view, whose middle is at (0, 60) and whose crest is where the fit found it.
    let mark = &report["rotary"];
    let center: Vec<f64> =
        report["map"]["center_mm"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    assert!(center[0].abs() < 1e-3, "{center:?}");
    let laser = Laser { fixture: [center[0], 60.0, center[2] + radius], ..LASERS[0] };
    let shifted: Vec<_> = polylines(&desk.read("out.dxf"));
    let table = Table::of(mark);
    let mut worst = 0.0f64;
    for (layer, line) in shifted {
        let landed = |aim: &Point2<f64>| laser.in_view(table.turned_back(laser.cast(*aim, &part), &layer));
        let landed: Vec<Point3<f64>> = line.iter().map(landed).collect();
        worst = part.unrolled(&landed).into_iter().map(|at| drawing.distance(at)).fold(worst, f64::max);
    }
    assert!(worst <= 5e-3, "{worst} mm");
}

#[test]
fn files_have_the_angles_in_their_names_and_are_clean() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[1].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 30, true).dxf());
    report(&desk, part, "--rotary --overlap 0.2");
    let layered = polylines(&desk.read("out.dxf"));
    let table = schemas::document(desk.read("out.rotary.json"));
    assert_eq!(table["schema"], "isomark.rotary/1");
    assert!(table["tiles"].as_array().unwrap().iter().all(|tile| tile["file"] == "out.dxf"));
    std::fs::remove_file(desk.path("out.dxf")).unwrap();
    // A tile of an earlier mark is not removed, but mentioned.
    desk.write("out.r+011.000.dxf", "");
    let arguments =
        ["correct", "--cylinder", "66,120", "--station", "station.toml", "--rotary", "--overlap", "0.2"];
    let output =
        desk.isomark(&[&arguments[..], &["--tiles-as", "files", "--out", "out.dxf", "drawing.dxf"]].concat());
    assert_eq!(output.code, 0, "{}", output.err);
    assert!(output.err.contains("out.r+011.000.dxf"), "{}", output.err);
    assert!(!desk.path("out.dxf").exists());
    let table = schemas::document(desk.read("out.rotary.json"));
    let tiles = table["tiles"].as_array().unwrap();
    let csv = desk.text("out.rotary.csv");
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), tiles.len() + 1);
    assert_eq!(rows[0][..4], ["tile", "angle_deg", "name", "file"]);
    let mut united = Vec::new();
    for (tile, row) in tiles.iter().zip(&rows[1..]) {
        let angle = number(tile, "/angle_deg");
        let file = tile["file"].as_str().unwrap();
        assert_eq!(file, format!("out.r{angle:+08.3}.dxf"));
        assert_eq!((row[1], row[3]), (format!("{angle:.3}").as_str(), file));
        let dxf = desk.read(file);
        let lines = polylines(&dxf);
        assert_eq!(lines.len() as f64, number(tile, "/paths"));
        if let Some(judged) = ezdxf::judged(&dxf) {
            ezdxf::assert_clean(&judged);
            let layers = judged["layers"].as_object().unwrap();
            assert!(layers.contains_key("TEXT") && layers.contains_key("RING"), "{layers:?}");
        }
        united.extend(lines.into_iter().map(|(layer, line)| (format!("R{angle:+08.3} {layer}"), line)));
    }
    assert_eq!(united, layered);
    // Neither is the file of an earlier mark with layers.
    desk.write("out.dxf", "");
    let output =
        desk.isomark(&[&arguments[..], &["--tiles-as", "files", "--out", "out.dxf", "drawing.dxf"]].concat());
    assert!(output.err.contains("an earlier one: out.dxf; remove"), "{}", output.err);
}

#[test]
fn a_layered_file_is_clean_in_every_version() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[1].settings());
    let part = &PARTS[2];
    desk.write("drawing.dxf", part.drawing(1.0, 30, true).dxf());
    for version in ["R2000", "R12", "R12-lines"] {
        let report = report(&desk, part, &format!("--rotary --set output.dxf={version}"));
        assert_eq!(report["output"]["read_back"], true);
        let dxf = desk.read("out.dxf");
        if let Some(judged) = ezdxf::judged(&dxf) {
            ezdxf::assert_clean(&judged);
            let tiles = report["rotary"]["tiles"].as_array().unwrap();
            let named = judged["layers"].as_object().unwrap().len();
            assert!(named >= 2 * tiles.len(), "{named} layers for {} tiles", tiles.len());
        }
    }
}

#[test]
fn fills_are_cut_into_closed_pieces() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    let mut text =
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    let half = 33.0 * PI * 0.9;
    let rectangle = |x: f64, y: f64| [[-x, -y], [x, -y], [x, y], [-x, y]];
    text += "0\nHATCH\n8\nFILL\n10\n0\n20\n0\n30\n0\n210\n0\n220\n0\n230\n1\n2\nSOLID\n70\n1\n71\n0\n91\n2\n";
    for (flag, corners) in [(1, rectangle(half, 6.0)), (16, rectangle(half - 5.0, 2.0))] {
        write!(text, "92\n{}\n72\n0\n73\n1\n93\n4\n", flag | 2).unwrap();
        for [x, y] in corners {
            write!(text, "10\n{x:?}\n20\n{y:?}\n").unwrap();
        }
        text += "97\n0\n";
    }
    text += "75\n0\n76\n1\n98\n0\n0\nENDSEC\n0\nEOF\n";
    desk.write("drawing.dxf", text);
    let report = report(&desk, &PARTS[0], "--rotary --vertices keep");
    let mark = marked(&desk.read("out.dxf"), &report["rotary"], &LASERS[0], &PARTS[0]);
    let area = |line: &Vec<Point2<f64>>| {
        assert_eq!(line.first(), line.last());
        line.windows(2).map(|ends| ends[0].coords.perp(&ends[1].coords)).sum::<f64>().abs() / 2.0
    };
    let sum: f64 = mark.flat.iter().map(|(_, line)| area(line)).sum();
    let drawn = 2.0 * half * 12.0 - 2.0 * (half - 5.0) * 4.0;
    assert_near(&[sum], &[drawn], 0.02);
    assert_near(&[number(&report, "/quality/after/area_mm2")], &[drawn], 0.02 * drawn);
}

#[test]
fn a_small_drawing_off_the_crest_is_turned_to_the_laser() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    desk.write("drawing.dxf", PARTS[0].drawing(0.1, 4, true).dxf());
    let report = report(&desk, &PARTS[0], "--rotary --place 20,0");
    let tiles = report["rotary"]["tiles"].as_array().unwrap();
    assert_eq!(tiles.len(), 1);
    let angle = (20.0f64 / 33.0).asin().to_degrees();
    assert_near(&[number(&tiles[0], "/angle_deg")], &[angle], 0.002);
    let incidence = 0.1 * 180.0;
    assert_near(&[number(&tiles[0], "/incidence_deg")], &[incidence], 0.02);
    let plain = self::report(&desk, &PARTS[0], "--rotary --place 20,0 --reverse");
    assert_near(&[number(&plain, "/rotary/tiles/0/angle_deg")], &[-angle], 0.002);
    let opposite = |pointer: &str| number(&plain, pointer) + number(&report, pointer);
    assert!(
        ["/rotary/axis/0", "/rotary/axis/1", "/rotary/axis/2"].iter().all(|axis| opposite(axis).abs() < 1e-9)
    );
}

#[test]
fn limits_of_the_laser_decide_how_wide_a_tile_is() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 40, true).dxf());
    let widest =
        |options: &str| number(&report(&desk, part, &format!("--rotary {options}")), "/rotary/widest_deg");
    // Within 30° of incidence; in a depth of focus of 1 mm; in a field of 20 mm; as given.
    let in_focus = 2.0 * (1.0f64 - 1.0 / 33.0).acos().to_degrees();
    let in_field = 2.0 * (10.0f64 / 33.0).asin().to_degrees();
    assert_near(&[widest("")], &[60.0], 0.05);
    assert_near(&[widest("--set optics.focus_depth_mm=1")], &[in_focus], 0.01);
    assert_near(&[widest("--set field.width_mm=20")], &[in_field], 0.01);
    assert_near(&[widest("--max-tile 25")], &[25.0], 1e-6);
    let tiles = |options: &str| report(&desk, part, options)["rotary"]["tiles"].as_array().unwrap().len();
    assert_eq!([tiles("--rotary=4"), tiles("--rotary=9"), tiles("--rotary=12 --max-tile 30.1")], [4, 9, 12]);
    // At least a fifteenth of a turn, and not more than two letters less than that.
    assert!((15..=20).contains(&tiles("--rotary --max-tile 25")));
}

#[test]
fn a_given_number_of_tiles_is_about_even_and_cuts_no_letters() {
    let desk = Desk::new();
    for laser in [LASERS[0], LASERS[1]] {
        desk.write("station.toml", laser.settings());
        for part in &PARTS {
            // Twelve letters of 18° in steps of 30°, between two rings.
            desk.write("drawing.dxf", part.drawing(1.0, 12, true).dxf());
            for count in [4, 6, 8, 12] {
                let report =
                    report(&desk, part, &format!("--rotary={count} --set optics.incidence_refuse_deg=75"));
                let case = format!("{count} tiles of {}", part.options);
                let tiles = report["rotary"]["tiles"].as_array().unwrap();
                assert_eq!(tiles.len(), count, "{case}");
                let even = 360.0 / count as f64;
                for tile in tiles {
                    let width = number(tile, "/on_part_deg/1") - number(tile, "/on_part_deg/0");
                    let fair = if 12 % count == 0 { [1.0, 1.0] } else { [0.75, 4.0 / 3.0] };
                    assert!(
                        width >= fair[0] * even - 1e-3 && width <= fair[1] * even + 1e-3,
                        "{case}: {width}"
                    );
                    // Half the width, and what the lens and the cone add.
                    assert!(number(tile, "/incidence_deg") <= width / 2.0 + 16.0, "{case}: {tile:#}");
                }
                let lines = polylines(&desk.read("out.dxf"));
                assert_eq!(lines.iter().filter(|(layer, _)| layer.ends_with("TEXT")).count(), 12, "{case}");
                assert!(!notices(&report).contains(&"rotary-more-tiles"), "{case}");
            }
        }
    }
}

#[test]
fn more_tiles_than_letters_get_a_warning() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 12, false).dxf());
    let report = |count: usize| report(&desk, part, &format!("--rotary={count}"));
    assert!(!notices(&report(12)).contains(&"rotary-more-tiles"));
    let warned = report(13);
    assert!(notices(&warned).contains(&"rotary-more-tiles"));
    let mut messages =
        warned["notices"].as_array().unwrap().iter().map(|notice| notice["message"].to_string());
    assert!(messages.any(|message| message.contains("12 tiles would be as narrow as 13")), "{warned:#}");
}

#[test]
fn what_cannot_go_round_is_refused_with_a_number_and_a_remedy() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 40, true).dxf());
    desk.write("wide.dxf", part.drawing(1.05, 40, true).dxf());
    let refused = |inputs: &str, code: &str, words: &[&str]| {
        let line = format!("correct --json --out out.dxf {inputs}");
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let output = desk.isomark(&arguments);
        output.refused(1, words);
        let reason: Value = serde_json::from_str(&output.out).unwrap();
        assert_eq!(reason["code"], code, "{reason:#}");
        assert!(!desk.path("out.dxf").exists());
    };
    refused("--cylinder 66,120 --rotary wide.dxf", "rotary-too-wide", &["378", "217.", "207.", "95.23"]);
    refused(
        "--cylinder 66,120 --rotary --overlap 9.9 --max-tile 30 drawing.dxf",
        "rotary-overlap",
        &["9.9", "overlap_mm"],
    );
    refused("--cylinder 66,120 --rotary=2 drawing.dxf", "rotary-tiles", &["2 tiles", "at least 4"]);
    // Rings of 36° have 72 pieces of half a degree.
    desk.write("narrow.dxf", part.drawing(0.1, 4, true).dxf());
    refused(
        "--cylinder 66,120 --rotary=300 narrow.dxf",
        "rotary-tiles",
        &["300 tiles", "at most 72", "0.50 deg"],
    );
    refused(
        "--cylinder 66,120 --rotary --method isometric drawing.dxf",
        "rotary-method",
        &["isometric", "auto"],
    );
    // The numbers are those of the whole drawing: the circumference of 207.35 mm.
    refused(
        "--cylinder 66,20 --rotary --place 0,8 drawing.dxf",
        "off-surface",
        &["the drawing x -103.7 to 103.7"],
    );
    let mouse = format!("{}/examples/parts/mouse.glb", env!("CARGO_MANIFEST_DIR"));
    refused(&format!("{mouse} drawing.dxf --rotary --place 0,8"), "rotary-not-round", &["0.005", "facing"]);
    for options in ["--rotary=many", "--rotary --overlap -1", "--rotary --max-tile 0", "--rotary=0"] {
        let line = format!("correct --out out.dxf --cylinder 66,120 drawing.dxf {options}");
        let arguments: Vec<&str> = line.split_whitespace().collect();
        let code = desk.isomark(&arguments).code;
        assert!(code != 0 && !desk.path("out.dxf").exists(), "{options}: {code}");
    }
    // Without tiles, the drawing is refused as before.
    refused("--cylinder 66,120 drawing.dxf", "off-surface", &[]);
}

#[test]
fn a_station_delivers_the_tiles_as_layers() {
    let desk = Desk::new();
    let part = &PARTS[0];
    let mut settings = LASERS[1].settings();
    settings += "[rotary]\ntiles = \"auto\"\nas = \"files\"\n";
    desk.write("station.toml", settings);
    desk.write("skus/tube.toml", "[part]\nshape = \"cylinder\"\ndiameter_mm = 66\nlength_mm = 120\n");
    std::fs::create_dir_all(desk.path("import")).unwrap();
    desk.write("hot/tube@ring.dxf", part.drawing(1.0, 40, true).dxf());
    let output = desk.isomark(&["watch", "station.toml", "--once"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let delivered: Vec<String> = std::fs::read_dir(desk.path("import"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(delivered, ["tube@ring.dxf"]);
    let report = schemas::document(desk.read("reports/tube/tube@ring.dxf.report.json"));
    assert!(notices(&report).contains(&"rotary-as-layers"));
    let laser = &LASERS[1];
    let mark = marked(&desk.read("import/tube@ring.dxf"), &report["rotary"], laser, part);
    assert_eq!(mark.flat.iter().filter(|(layer, _)| layer.ends_with("TEXT")).count(), 40);
    // A limit of the laser decides how the mark is divided, so it makes delivered drawings outdated; a note does not.
    let state = |key: &str| {
        let text = desk.text("station.toml").replace("[optics]\n", &format!("[optics]\n{key}\n"));
        desk.write("station.toml", text);
        let output = desk.isomark(&["watch", "station.toml", "--once"]);
        assert_eq!(output.code, 0, "{}", output.err);
        desk.isomark(&["status", "station.toml", "--json"])
    };
    state("incidence_note_deg = 5");
    let report = schemas::document(desk.read("reports/tube/tube@ring.dxf.report.json"));
    assert!(report["rotary"].is_object());
}

#[test]
fn ink_layers_and_other_layers_are_divided() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[0].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 40, true).dxf());
    let report = report(&desk, part, "--rotary --ink-layers text");
    assert_eq!(report["pattern"]["ink_layers"], json!(["text"]));
    assert_eq!(report["pattern"]["paths"], 42);
    let text_only = 40.0 * {
        let drawing = part.drawing(1.0, 40, false);
        line_length(&drawing.0[0])
    };
    assert_near(&[number(&report, "/quality/after/length_mm")], &[text_only], 0.01);
    // The rings are carried along, in every tile.
    let rings = polylines(&desk.read("out.dxf")).iter().filter(|(layer, _)| layer.ends_with("RING")).count();
    assert_eq!(rings, 2 * report["rotary"]["tiles"].as_array().unwrap().len());
}

#[test]
fn pictures_show_every_tile() {
    let desk = Desk::new();
    desk.write("station.toml", LASERS[1].settings());
    let part = &PARTS[0];
    desk.write("drawing.dxf", part.drawing(1.0, 40, true).dxf());
    let report = report(&desk, part, "--rotary --preview out.svg --on-part out.glb --report-html out.html");
    let svg = desk.text("out.svg");
    for tile in report["rotary"]["tiles"].as_array().unwrap() {
        let name = format!("{:+.3}°", number(tile, "/angle_deg"));
        assert_eq!(svg.matches(&name).count(), 2, "{name}");
    }
    assert!(svg.len() < 1_000_000 && !svg.contains("NaN"));
}

/// A drawing with its zero at the corner of its page is on the part when it turns.
#[test]
fn a_drawing_beside_the_facing_side_is_put_on_the_part_by_the_remedy() {
    let desk = Desk::new();
    let mut text =
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    for x in (2..=195).step_by(8) {
        text += &format!("0\nLINE\n8\n0\n10\n{x}\n20\n2\n11\n{x}\n21\n18\n");
    }
    desk.write("corner.dxf", text.clone() + "0\nENDSEC\n0\nEOF\n");
    let correct = |options: &str| {
        let line = format!("correct --cylinder 66,120 corner.dxf --out out.dxf {options}");
        desk.isomark(&line.split(' ').collect::<Vec<_>>())
    };
    let refused = correct("--rotary");
    refused.refused(1, &["off-surface", "--place 0,10`", "The part turns"]);
    assert_eq!(correct("--rotary --place 0,10").code, 0);
    // A blank before the number of tiles.
    correct("--rotary 6").refused(2, &["--rotary=6"]);
    assert_eq!(correct("--place 0,10 --rotary=6").code, 0);
}
