//! A simulated laser marks delivered drawings on parts that are given by formulas: each beam leaves the centres of the
//! two mirrors, or of a lens that needs a table, passes the delivered point of the field and meets the part. The mark there must be the drawing.

use std::fmt::Write as _;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::shapes;
use isomark::geometry::space::FlatPoint;
use nalgebra::{Point2, Point3, Rotation3, Vector2, Vector3};

use crate::desk::{Desk, assert_near, number, part};

/// Largest distance of the beam from a vertex of the drawing, mm.
const AT_VERTICES: f64 = 1e-3;
/// The chord tolerance of the jobs, mm.
const TOLERANCE: f64 = 0.01;

/// A part, given by the height over the view of the side that faces the laser, mm.
struct Part {
    name: &'static str,
    height: fn(f64, f64) -> f64,
    /// The position of a point after unrolling the part; only for developable parts.
    unrolled: Option<fn(Point3<f64>) -> Point2<f64>>,
}

fn tilted_plane(x: f64, y: f64) -> f64 {
    4.0 + 0.2 * x - 0.1 * y
}

/// A cylinder of radius 30 mm around the y axis, tilted by 0.12 rad so that it rises with y.
fn tipped_cylinder(x: f64, y: f64) -> f64 {
    let (sin, cos) = 0.12f64.sin_cos();
    (shapes::cylinder(x, 0.0) + y * sin) / cos
}

fn unrolled_tipped_cylinder(at: Point3<f64>) -> Point2<f64> {
    let (sin, cos) = 0.12f64.sin_cos();
    let (along, up) = (at.y * cos + at.z * sin, at.z * cos - at.y * sin);
    Point2::new(30.0 * at.x.atan2(up), along)
}

/// [`shapes::cone`]: apex at y = −60, half angle 0.3 rad, axis y.
fn unrolled_cone(at: Point3<f64>) -> Point2<f64> {
    let from_apex = at + Vector3::y() * 60.0;
    let angle = at.x.atan2(at.z) * 0.3f64.sin();
    Point2::from(Vector2::new(angle.sin(), angle.cos()) * from_apex.coords.norm())
}

fn unrolled_tilted_plane(at: Point3<f64>) -> Point2<f64> {
    let right = Vector3::new(1.0, 0.0, 0.2).normalize();
    let up = Vector3::new(-0.2, 0.1, 1.0).normalize().cross(&right);
    Point2::new(at.coords.dot(&right), at.coords.dot(&up))
}

const PARTS: [Part; 6] = [
    Part { name: "plate", height: |_, _| 0.0, unrolled: Some(|at| at.xy()) },
    Part { name: "tilted-plane", height: tilted_plane, unrolled: Some(unrolled_tilted_plane) },
    Part { name: "tipped-cylinder", height: tipped_cylinder, unrolled: Some(unrolled_tipped_cylinder) },
    Part { name: "cone", height: shapes::cone, unrolled: Some(unrolled_cone) },
    Part { name: "sphere", height: shapes::sphere, unrolled: None },
    Part { name: "saddle", height: shapes::saddle, unrolled: None },
];

/// A side of the part that faces the laser, and the map from a point of its view to the part's file.
struct Side {
    facing: &'static str,
    in_file: fn(Point3<f64>) -> Point3<f64>,
}

const SIDES: [Side; 3] = [
    Side { facing: "+z", in_file: |view| view },
    Side { facing: "-y", in_file: |view| Point3::new(view.x, -view.z, view.y) },
    Side { facing: "+x", in_file: |view| Point3::new(view.z, view.x, view.y) },
];

impl Part {
    /// The part as an OBJ file with the formula's normals.
    fn obj(&self, side: &Side) -> String {
        let mesh = shapes::graph(18.0, 0.75, self.height);
        let turned = |direction: Vector3<f64>| (side.in_file)(direction.into()).coords;
        let mut text = String::new();
        for at in mesh.positions() {
            let [point, normal] = [(side.in_file)(*at).coords, turned(self.normal(at.x, at.y))];
            writeln!(text, "v {} {} {}", point.x, point.y, point.z).unwrap();
            writeln!(text, "vn {} {} {}", normal.x, normal.y, normal.z).unwrap();
        }
        for corners in mesh.triangles() {
            let [a, b, c] = corners.map(|index| index + 1);
            writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
        }
        text
    }

    fn normal(&self, x: f64, y: f64) -> Vector3<f64> {
        let step = 1e-4;
        let slope =
            |dx: f64, dy: f64| ((self.height)(x + dx, y + dy) - (self.height)(x - dx, y - dy)) / (2.0 * step);
        Vector3::new(-slope(step, 0.0), -slope(0.0, step), 1.0).normalize()
    }

    fn point(&self, view: Point2<f64>) -> Point3<f64> {
        Point3::new(view.x, view.y, (self.height)(view.x, view.y))
    }
}

/// A station: the origin of its field, its lens, and the position of the part.
struct Station {
    /// Where the field has its zero: a name, or mm from its lower left corner.
    origin: &'static str,
    /// Lens distances; `None` for a telecentric lens.
    lens: Option<[f64; 2]>,
    /// The axis in the settings; by default the centre of the field of 200 × 160 mm.
    axis: Option<[f64; 2]>,
    /// For a lens that the station knows by a table: how much more the beams lean at 100 mm from the axis than those of the
    /// two-point model. Its field is not quite true, either.
    bulge: Option<f64>,
    fixture: [f64; 3],
    rotation_deg: f64,
}

const STATIONS: [Station; 10] = [
    Station {
        origin: "center",
        lens: Some([300.0, 285.0]),
        axis: None,
        bulge: None,
        fixture: [0.0; 3],
        rotation_deg: 0.0,
    },
    Station {
        origin: "corner",
        lens: Some([300.0, 285.0]),
        axis: None,
        bulge: None,
        fixture: [100.0, 80.0, 10.0],
        rotation_deg: 0.0,
    },
    Station {
        origin: "corner",
        lens: Some([160.0, 150.0]),
        axis: None,
        bulge: None,
        fixture: [60.0, 110.0, -12.0],
        rotation_deg: 35.0,
    },
    Station {
        origin: "center",
        lens: Some([210.0, 230.0]),
        axis: None,
        bulge: None,
        fixture: [-30.0, 25.0, 6.0],
        rotation_deg: -120.0,
    },
    Station {
        origin: "center",
        lens: Some([210.0, 230.0]),
        axis: Some([-8.0, 3.5]),
        bulge: None,
        fixture: [20.0, 10.0, -20.0],
        rotation_deg: 90.0,
    },
    Station {
        origin: "corner",
        lens: Some([300.0, 285.0]),
        axis: Some([92.0, 85.0]),
        bulge: None,
        fixture: [120.0, 60.0, 0.0],
        rotation_deg: 0.0,
    },
    Station {
        origin: "corner",
        lens: None,
        axis: None,
        bulge: None,
        fixture: [70.0, 90.0, 5.0],
        rotation_deg: 10.0,
    },
    Station {
        origin: "30, 120",
        lens: Some([300.0, 285.0]),
        axis: None,
        bulge: None,
        fixture: [50.0, -10.0, 8.0],
        rotation_deg: -20.0,
    },
    Station {
        origin: "30, 120",
        lens: Some([260.0, 250.0]),
        axis: Some([60.0, -33.0]),
        bulge: Some(0.15),
        fixture: [85.0, -60.0, -7.0],
        rotation_deg: 70.0,
    },
    Station {
        origin: "corner",
        lens: Some([190.0, 205.0]),
        axis: None,
        bulge: Some(-0.1),
        fixture: [110.0, 90.0, 6.0],
        rotation_deg: 0.0,
    },
];

impl Station {
    fn settings(&self, facing: &str) -> String {
        let [x, y, z] = self.fixture;
        let axis = self.axis.map_or(String::new(), |axis| format!("\naxis_mm = {axis:?}"));
        let lens = match (self.lens, self.bulge) {
            (None, _) => "kind = \"telecentric\"".to_owned(),
            (_, Some(_)) => "table = \"lens.csv\"".to_owned(),
            (Some([x, y]), None) => format!(
                "kind = \"perspective\"\nlens_distance_x_mm = {x:?}\nlens_distance_y_mm = {y:?}{axis}"
            ),
        };
        let origin = match self.origin {
            "center" | "corner" => format!("{:?}", self.origin),
            zero => format!("[{zero}]"),
        };
        format!(
            "[station]\nname = \"simulated\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n\
             [field]\nwidth_mm = 200\nheight_mm = 160\norigin = {origin}\n[optics]\n{lens}\n\
             [fixture]\nx_mm = {x:?}\ny_mm = {y:?}\nz_mm = {z:?}\nrotation_deg = {:?}\n\
             [part]\nfacing = \"{facing}\"\nunit = \"mm\"\nup = \"z\"\n",
            self.rotation_deg
        )
    }

    /// The middle of the field.
    fn middle(&self) -> Vector2<f64> {
        match self.origin {
            "center" => [0.0, 0.0].into(),
            "corner" => [100.0, 80.0].into(),
            zero => {
                let (x, y) = zero.split_once(", ").unwrap();
                Vector2::new(100.0 - x.parse::<f64>().unwrap(), 80.0 - y.parse::<f64>().unwrap())
            }
        }
    }

    fn axis(&self) -> Vector2<f64> {
        self.axis.map_or(self.middle(), Vector2::from)
    }

    /// The table of the lens: beams to 9 x 9 places of the field at three heights.
    fn lens_table(&self) -> String {
        let mut table = "x_mm,y_mm,z_mm,seen_x_mm,seen_y_mm\n".to_owned();
        for (z, i, j) in (0..243).map(|n| (f64::from(n / 81 - 1) * 20.0, n % 9 - 4, n / 9 % 9 - 4)) {
            let aim = Point2::from(self.middle() + Vector2::new(f64::from(i) * 25.0, f64::from(j) * 20.0));
            let seen = self.beam(aim, z);
            writeln!(table, "{},{},{z},{},{}", aim.x, aim.y, seen.x, seen.y).unwrap();
        }
        table
    }

    /// The rotation of the fixture.
    fn spin(&self) -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vector3::z_axis(), self.rotation_deg.to_radians())
    }

    /// A point of the field's frame in the view of the part.
    fn in_view(&self, field: Point3<f64>) -> Point3<f64> {
        self.spin().inverse() * (field - Vector3::from(self.fixture))
    }

    /// The point of the field that the beam to a point of the view passes: by similar triangles, then in small steps.
    fn aim(&self, view: Point3<f64>) -> Point2<f64> {
        let at = self.spin() * view + Vector3::from(self.fixture);
        let Some([x, y]) = self.lens else { return at.xy() };
        let axis = self.axis();
        let mut aim =
            Point2::new(axis.x + (at.x - axis.x) * x / (x - at.z), axis.y + (at.y - axis.y) * y / (y - at.z));
        for _ in 0..if self.bulge.is_some() { 60 } else { 0 } {
            aim += at.xy() - self.beam(aim, at.z).xy();
        }
        aim
    }

    /// The point at height `z` of the beam that passes `aim` at z = 0: it crosses the axis of each mirror at the
    /// distance of that mirror.
    fn beam(&self, aim: Point2<f64>, z: f64) -> Point3<f64> {
        let Some([x, y]) = self.lens else { return Point3::new(aim.x, aim.y, z) };
        let axis = self.axis();
        let beside = (aim.coords - axis) / 100.0;
        let (lean, untrue) = match self.bulge {
            Some(bulge) => {
                (1.0 + bulge * beside.norm_squared(), Vector2::new(0.3 * beside.y, 0.2 * beside.x.powi(2)))
            }
            None => (1.0, Vector2::zeros()),
        };
        let moved = Vector2::new((aim.x - axis.x) * z / x, (aim.y - axis.y) * z / y) * lean;
        Point3::from((aim.coords + untrue - moved).push(z))
    }

    /// The unit direction of that beam, downwards.
    fn direction(&self, aim: Point2<f64>) -> Vector3<f64> {
        (self.beam(aim, -1.0) - self.beam(aim, 1.0)).normalize()
    }

    /// The point of the part that the beam through `aim` meets, in the view: by bisection between heights above and
    /// below.
    fn cast(&self, aim: Point2<f64>, part: &Part) -> Point3<f64> {
        let (mut above, mut below) = (70.0, -50.0);
        for _ in 0..80 {
            let middle = (above + below) / 2.0;
            let at = self.in_view(self.beam(aim, middle));
            if at.z > (part.height)(at.x, at.y) { above = middle } else { below = middle }
        }
        self.in_view(self.beam(aim, (above + below) / 2.0))
    }
}

/// Crossing lines of three lengths, not centred and not all parallel to the axes.
const LINES: [[[f64; 2]; 2]; 6] = [
    [[-10.0, -4.0], [10.0, -4.0]],
    [[-10.0, 5.0], [10.0, 5.0]],
    [[-6.0, -9.0], [-6.0, 9.0]],
    [[7.0, -8.0], [7.0, 8.0]],
    [[-9.0, -7.0], [8.0, 6.0]],
    [[-3.0, 7.5], [5.0, -6.5]],
];

fn drawing() -> String {
    let mut text =
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    for [[x, y], [to_x, to_y]] in LINES {
        writeln!(text, "0\nLINE\n8\nMARK\n10\n{x}\n20\n{y}\n11\n{to_x}\n21\n{to_y}").unwrap();
    }
    text + "0\nENDSEC\n0\nEOF\n"
}

/// The polylines of a delivered drawing, mm of the field.
fn delivered(dxf: &[u8]) -> Vec<Vec<Point2<f64>>> {
    let point = |at: FlatPoint| Point2::from(at.coords());
    let reading = read(dxf, &PatternOptions::default().strictly(true)).unwrap();
    let path = |path: &isomark::geometry::pattern::Path| {
        let segments = path.shape.segments();
        let starts = segments.iter().map(|segment| point(segment.start()));
        starts.chain(segments.last().map(|segment| point(segment.end()))).collect()
    };
    reading.pattern.paths.iter().map(path).collect()
}

fn distance_to(line: &[Point2<f64>], at: Point2<f64>) -> f64 {
    let to_piece = |pair: &[Point2<f64>]| {
        let along = pair[1] - pair[0];
        let t = ((at - pair[0]).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (pair[0] + along * t - at).norm()
    };
    line.windows(2).map(to_piece).fold(f64::INFINITY, f64::min)
}

/// Calls `judge` for every station with every part, with alternating sides, after the files of the job are written. It
/// gets the desk, a name for messages, part and station, and the file name of the part.
fn each_job(mut judge: impl FnMut(&Desk, &str, &Part, &Station, &str)) {
    let desk = Desk::new();
    desk.write("drawing.dxf", drawing());
    for (turn, station) in STATIONS.iter().enumerate() {
        for (number, part) in PARTS.iter().enumerate() {
            let side = &SIDES[(turn + number) % SIDES.len()];
            let name = format!("{}{}.obj", part.name, side.facing);
            if !desk.path(&name).exists() {
                desk.write(&name, part.obj(side));
            }
            desk.write("station.toml", station.settings(side.facing));
            desk.write("lens.csv", station.lens_table());
            judge(&desk, &format!("{name} at station {turn}"), part, station, &name);
        }
    }
}

const OPTIONS: &str = "--station station.toml";

#[test]
fn the_beam_meets_every_projected_vertex_with_any_lens_and_fixture() {
    each_job(|desk, case, part, station, file| {
        let options = format!("{OPTIONS} --method none --vertices keep");
        let report = desk.correct(file, "drawing.dxf", &options);
        let marked = delivered(&desk.read("out.dxf"));
        assert_eq!(marked.len(), LINES.len(), "{case}");
        let mut steepest = 0.0f64;
        for (line, drawn) in marked.iter().zip(LINES) {
            assert_eq!(line.len(), 2, "{case}");
            for (aim, drawn) in line.iter().zip(drawn) {
                let landing = station.cast(*aim, part);
                let miss = (landing.xy() - Point2::from(drawn)).norm();
                assert!(miss <= AT_VERTICES, "{case}: {miss} mm off {drawn:?}");
                let normal = station.spin() * part.normal(landing.x, landing.y);
                steepest = steepest.max(normal.dot(&-station.direction(*aim)).acos());
            }
        }
        // Between their ends the lines may have larger incidence angles, so the reported one is at least as large.
        let reported = number(&report, "/exposure/incidence_deg");
        assert!(reported > steepest.to_degrees() - 0.02, "{case}: {reported} for {}", steepest.to_degrees());
        if part.name.contains("plane") || part.name == "plate" {
            assert_near(&[reported], &[steepest.to_degrees()], 0.02);
        }
    });
}

#[test]
fn chords_stay_within_their_tolerance_of_the_true_image() {
    each_job(|desk, case, part, station, file| {
        desk.correct(file, "drawing.dxf", &format!("{OPTIONS} --method none --tolerance {TOLERANCE}"));
        for (chords, [from, to]) in delivered(&desk.read("out.dxf")).iter().zip(LINES) {
            let [from, to] = [from, to].map(Point2::from);
            let image: Vec<_> = (0..=2000)
                .map(|step| station.aim(part.point(from + (to - from) * f64::from(step) / 2000.0)))
                .collect();
            let along = |pair: &[Point2<f64>]| {
                let [from, to] = [pair[0], pair[1]];
                (0..=20).map(move |step| from + (to - from) * f64::from(step) / 20.0).collect::<Vec<_>>()
            };
            let to_chords = image.iter().map(|at| distance_to(chords, *at));
            let to_image = chords.windows(2).flat_map(along).map(|at| distance_to(&image, at));
            let miss = to_chords.chain(to_image).fold(0.0, f64::max);
            // The error of the fitted surface is added to the tolerance.
            assert!(miss <= TOLERANCE + 2e-4, "{case}: {miss} mm");
        }
    });
}

#[test]
fn developable_parts_get_true_lengths_under_the_simulated_laser() {
    each_job(|desk, case, part, station, file| {
        let Some(unrolled) = part.unrolled else { return };
        desk.correct(file, "drawing.dxf", &format!("{OPTIONS} --vertices keep"));
        let marked = delivered(&desk.read("out.dxf"));
        let on_part: Vec<_> = marked.iter().flatten().map(|aim| unrolled(station.cast(*aim, part))).collect();
        let drawn: Vec<_> = LINES.iter().flatten().map(|at| Point2::from(*at)).collect();
        for (i, j) in (0..drawn.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
            let miss = (on_part[i] - on_part[j]).norm() - (drawn[i] - drawn[j]).norm();
            assert!(miss.abs() <= AT_VERTICES, "{case}: {miss} mm from {:?} to {:?}", drawn[i], drawn[j]);
        }
    });
}

#[test]
fn the_lens_does_not_move_marks_on_doubly_curved_parts() {
    let plain = Station {
        origin: "center",
        lens: None,
        axis: None,
        bulge: None,
        fixture: [0.0; 3],
        rotation_deg: 0.0,
    };
    each_job(|desk, case, part, station, file| {
        if part.unrolled.is_some() {
            return;
        }
        let options = format!("{OPTIONS} --vertices keep");
        desk.correct(file, "drawing.dxf", &options);
        let marked = delivered(&desk.read("out.dxf"));
        let facing = &file[file.len() - "+z.obj".len()..file.len() - ".obj".len()];
        desk.write("station.toml", plain.settings(facing));
        desk.correct(file, "drawing.dxf", &options);
        for (aim, view) in marked.iter().flatten().zip(delivered(&desk.read("out.dxf")).iter().flatten()) {
            let miss = (station.cast(*aim, part) - part.point(*view)).norm();
            assert!(miss <= AT_VERTICES, "{case}: {miss} mm off");
        }
    });
}

/// On a real part, the beams of all stations meet in the same points of the part: each on the vertical line through its place
/// in the view, near the triangles.
#[test]
fn the_beams_of_all_stations_meet_in_the_same_points_of_a_real_part() {
    let plain = Station {
        origin: "center",
        lens: None,
        axis: None,
        bulge: None,
        fixture: [0.0; 3],
        rotation_deg: 0.0,
    };
    let desk = Desk::new();
    let mouse = part("mouse/fc020-coarse-mesh.obj");
    let text = std::fs::read_to_string(&mouse).unwrap();
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace().skip(1).map(|word| word.split('/').next().unwrap().parse().unwrap()).collect()
    };
    let lines = |kind: &'static str| text.lines().filter(move |line| line.starts_with(kind)).map(numbers);
    let corners: Vec<Vec<f64>> = lines("v ").collect();
    let faces: Vec<[Point3<f64>; 3]> = lines("f ")
        .map(|face| [0, 1, 2].map(|corner| Point3::from_slice(&corners[face[corner] as usize - 1])))
        .collect();
    let height = |at: Point2<f64>| {
        let over = |face: &[Point3<f64>; 3]| {
            let normal = (face[1] - face[0]).cross(&(face[2] - face[0]));
            let inside = (0..3).all(|side| {
                let (from, to) = (face[side].xy(), face[(side + 1) % 3].xy());
                (to - from).perp(&(at - from)) * normal.z.signum() >= 0.0
            });
            let beside = (at - face[0].xy()).dot(&normal.xy());
            (inside && normal.z != 0.0).then(|| face[0].z - beside / normal.z)
        };
        faces.iter().filter_map(over).fold(f64::NEG_INFINITY, f64::max)
    };
    desk.write("drawing.dxf", drawing());
    let mark = |station: &Station| {
        desk.write("station.toml", station.settings("+z"));
        desk.write("lens.csv", station.lens_table());
        desk.correct(&mouse, "drawing.dxf", &format!("{OPTIONS} --vertices keep"));
        delivered(&desk.read("out.dxf")).concat()
    };
    let views = mark(&plain);
    // For every vertex, where the beams pass the vertical line through its place in the view, and how far they lean.
    let mut crossings = vec![Vec::new(); views.len()];
    for (turn, station) in STATIONS.iter().enumerate().filter(|(_, station)| station.lens.is_some()) {
        for ((aim, view), crossings) in mark(station).iter().zip(&views).zip(&mut crossings) {
            let z = height(*view);
            let at = station.in_view(station.beam(*aim, z + station.fixture[2]));
            let down = station.spin().inverse() * station.direction(*aim);
            let lean = down.xy() / down.z;
            let up = -(at.xy() - view).dot(&lean) / lean.norm_squared();
            let miss = (at.xy() + lean * up - view).norm();
            // Between its vertices the fitted surface is above the coarse triangles.
            assert!(
                miss <= AT_VERTICES && up.abs() < 0.6,
                "station {turn}: {miss} mm, {up} mm off at {view}"
            );
            crossings.push((z + up, lean.norm()));
        }
    }
    for (crossings, view) in crossings.iter().zip(&views) {
        let weights: f64 = crossings.iter().map(|(_, lean)| lean * lean).sum();
        let mean = crossings.iter().map(|(z, lean)| z * lean * lean).sum::<f64>() / weights;
        for (turn, (z, lean)) in crossings.iter().enumerate() {
            let miss = (z - mean).abs() * lean;
            assert!(miss <= AT_VERTICES, "beam {turn} is {miss} mm beside the point of the others at {view}");
        }
    }
}
