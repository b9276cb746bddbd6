//! Parts drawn at random, whose surface is a closed form: turned and extruded profiles, lofts and ellipsoids, tessellated as CAD
//! and modelling programs do. The same seed gives the same parts.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write as _;

use nalgebra::{Point3, Vector3};

use super::profiles::{Piece, Profile};

/// Half the length that parts have along both directions at least, mm: the letters of the tests are 30 mm wide.
const HALF: f64 = 24.0;

/// Numbers that look random (Steele, Lea & Flood, Fast splittable pseudorandom number generators, 2014).
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    pub(super) fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * ((self.next() >> 11) as f64 / (1u64 << 53) as f64)
    }

    pub(super) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.next() % choices.len() as u64) as usize]
    }
}

/// The normals in the file of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Shading {
    /// None.
    Missing,
    /// Those of the surface.
    Exact,
    /// Averages of the facets round a vertex, weighted by their areas.
    ByArea,
    /// The same, weighted by their angles at the vertex.
    ByAngle,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Family {
    /// A profile of arcs and lines turned about an axis across the view.
    Turned,
    /// A smooth profile without arcs, turned.
    TurnedCurve,
    /// A profile of arcs and lines, extruded.
    Strip,
    /// A smooth profile without arcs, extruded.
    StripCurve,
    /// Between two arcs or curves, in one row of facets.
    LoftOfOneRow,
    /// The same in several rows, straight or smooth from one curve to the other.
    Loft,
    Ellipsoid,
}

/// A tessellated part.
pub(super) struct Part {
    pub(super) family: Family,
    pub(super) name: String,
    pub(super) shading: Shading,
    /// The largest angle between the normals of neighbouring vertices, degrees.
    pub(super) turn: f64,
    /// The exact height, mm.
    pub(super) height: Height,
    net: Net,
    is_merged: bool,
}

/// The height at a place, mm.
type Height = Box<dyn Fn(f64, f64) -> f64>;

/// Vertices with the normals of the surface, and triangles.
struct Net {
    points: Vec<(Point3<f64>, Vector3<f64>)>,
    triangles: Vec<[u32; 3]>,
}

impl Net {
    /// A net of rows of `width` vertices.
    fn of_rows(points: Vec<(Point3<f64>, Vector3<f64>)>, width: usize, is_mirrored: bool) -> Self {
        let mut triangles = Vec::new();
        for row in 1..points.len() / width {
            for column in 1..width {
                let [b, d] = [row - 1, row].map(|row| (row * width + column) as u32);
                let [a, c] = [b - 1, d - 1];
                let cell = if is_mirrored { [[a, b, c], [b, d, c]] } else { [[a, b, d], [a, d, c]] };
                triangles.extend(cell);
            }
        }
        // At a pole, triangles have no area.
        triangles.retain(|corners| {
            let [a, b, c] = corners.map(|index| points[index as usize].0);
            (b - a).cross(&(c - a)).norm() > 1e-9
        });
        Self { points, triangles }
    }

    fn turn(&self) -> f64 {
        let angle = |one: u32, other: u32| self.points[one as usize].1.angle(&self.points[other as usize].1);
        let sides = self.triangles.iter().flat_map(|[a, b, c]| [angle(*a, *b), angle(*b, *c)]);
        sides.fold(0.0, f64::max).to_degrees()
    }

    fn averages(&self, is_by_area: bool) -> Vec<Vector3<f64>> {
        let mut normals = vec![Vector3::zeros(); self.points.len()];
        for corners in &self.triangles {
            for turn in 0..3 {
                let [here, one, other] = [0, 1, 2].map(|step| corners[(turn + step) % 3] as usize);
                let [first, second] = [one, other].map(|end| self.points[end].0 - self.points[here].0);
                let across = first.cross(&second);
                let weight = if is_by_area { 1.0 } else { first.angle(&second) / across.norm() };
                normals[here] += across * weight;
            }
        }
        normals.into_iter().map(|normal| normal.normalize()).collect()
    }
}

impl Part {
    pub(super) fn draw(random: &mut Random, shading: Shading) -> Self {
        let (deviation, turn) = if random.next().is_multiple_of(2) {
            (random.one_of(&[0.02, 0.05, 0.1, 0.2, 0.5, 1.0]), 28.65)
        } else {
            (1.0, random.one_of(&[7.5, 10.0, 15.0, 20.0, 22.5, 28.6]))
        };
        let family = random.one_of(&[
            Family::Turned,
            Family::Turned,
            Family::TurnedCurve,
            Family::Strip,
            Family::Strip,
            Family::StripCurve,
            Family::LoftOfOneRow,
            Family::Loft,
            Family::Ellipsoid,
        ]);
        let is_mirrored = random.next().is_multiple_of(2);
        let is_merged = random.next().is_multiple_of(2);
        let (name, net, height): (String, Net, Height) = match family {
            Family::Turned | Family::TurnedCurve => {
                let profile = profile(random, family == Family::TurnedCurve);
                let radius = random.between(26.0, 80.0);
                let net = turned(&profile, radius, deviation, turn, is_mirrored);
                let name = format!("radius {radius:.1}, {}", profile.name);
                (name, net, Box::new(move |x, y| profile.revolved_height(radius, x, y)))
            }
            Family::Strip | Family::StripCurve => {
                let profile = profile(random, family == Family::StripCurve);
                let rows = random.one_of(&[1, 1, 2, 3, 6]);
                let net = strip(&profile, rows, deviation, turn, is_mirrored);
                (format!("{rows} rows, {}", profile.name), net, Box::new(move |x, _| profile.height(x)))
            }
            Family::LoftOfOneRow | Family::Loft => {
                let is_smooth = family == Family::Loft && random.next().is_multiple_of(2);
                let rows = if family == Family::Loft { random.one_of(&[2, 3, 5, 8, 12]) } else { 1 };
                let [one, other] = [(); 2].map(|()| Bow::draw(random));
                let net = loft([one, other], rows, is_smooth, deviation, turn, is_mirrored);
                let name = format!("{rows} rows, smooth {is_smooth}, {one:?} to {other:?}");
                (name, net, Box::new(move |x, y| lofted([one, other], is_smooth, x, y)))
            }
            Family::Ellipsoid => {
                let axes = [30.0, 30.0, 15.0].map(|least| random.between(least, 2.0 * least));
                let is_along_view = random.next().is_multiple_of(2);
                let net = ellipsoid(axes, is_along_view, deviation, turn, is_mirrored);
                let [a, b, c] = axes;
                let name = format!("axes {a:.1} {b:.1} {c:.1}, poles along the view {is_along_view}");
                let height =
                    move |x: f64, y: f64| c * (1.0 - (x / a).powi(2) - (y / b).powi(2)).max(0.0).sqrt() - c;
                (name, net, Box::new(height))
            }
        };
        let name = format!("{name}; sag {deviation}, {turn} deg, {shading:?}, merged {is_merged}");
        Self { family, name, shading, turn: net.turn(), height, net, is_merged }
    }

    /// The part as an OBJ file in mm, z up.
    pub(super) fn obj(&self) -> String {
        let Net { points, triangles } = &self.net;
        let normals = match self.shading {
            Shading::Missing => Vec::new(),
            Shading::Exact => points.iter().map(|(_, normal)| *normal).collect(),
            Shading::ByArea => self.net.averages(true),
            Shading::ByAngle => self.net.averages(false),
        };
        let order: Vec<u32> = if self.is_merged {
            (0..points.len() as u32).collect()
        } else {
            triangles.iter().flatten().copied().collect()
        };
        let mut text = String::new();
        for index in order.into_iter().map(|index| index as usize) {
            let at = points[index].0;
            writeln!(text, "v {:.6} {:.6} {:.6}", at.x, at.y, at.z).unwrap();
            if let Some(normal) = normals.get(index) {
                writeln!(text, "vn {:.6} {:.6} {:.6}", normal.x, normal.y, normal.z).unwrap();
            }
        }
        for (number, corners) in triangles.iter().enumerate() {
            let first = 3 * number as u32 + 1;
            let corners =
                if self.is_merged { corners.map(|corner| corner + 1) } else { [first, first + 1, first + 2] };
            let corner = |at: u32| if normals.is_empty() { at.to_string() } else { format!("{at}//{at}") };
            writeln!(text, "f {}", corners.map(corner).join(" ")).unwrap();
        }
        text
    }
}

/// A profile along ±24 mm or more, near z = 0 in the middle.
fn profile(random: &mut Random, is_curve: bool) -> Profile {
    if is_curve {
        let half = random.between(26.0, 34.0);
        let piece = match random.one_of(&[0, 1, 2]) {
            0 => Piece::Lame(
                [random.between(half + 6.0, 70.0), random.between(8.0, 25.0)],
                random.one_of(&[2.0, 2.5, 4.0]),
                [-half, half],
            ),
            _ => {
                let bend = random.between(-0.012, 0.012);
                let skew = random.between(-1.5e-4, 1.5e-4);
                let fourth = random.between(-6e-6, 6e-6);
                Piece::Quartic([0.0, random.between(-0.1, 0.1), bend, skew, fourth], [-half, half])
            }
        };
        return Profile::new(format!("{piece:.4?}"), vec![piece]).levelled();
    }
    match random.one_of(&[0, 1, 2, 3, 4, 5, 5, 5]) {
        0 => Profile::oval(
            random.between(40.0, 150.0),
            random.between(12.0, 35.0),
            random.between(4.0, 16.0),
            HALF,
        ),
        1 => Profile::waist(
            random.between(20.0, 100.0),
            random.between(12.0, 35.0),
            random.between(5.0, 20.0),
            HALF,
        ),
        2 => Profile::bottle(random.between(12.0, 35.0), random.between(8.0, 25.0), HALF),
        3 => Profile::filleted(
            random.between(3.0, 9.0),
            random.between(3.0, 20.0),
            random.between(15.0, 35.0),
            HALF,
        ),
        4 => Profile::stadium(random.between(2.0, 9.0), random.between(14.0, 30.0), HALF),
        _ => walk(random),
    }
}

/// Arcs and lines that continue one another.
fn walk(random: &mut Random) -> Profile {
    let steepest = 40f64.to_radians();
    let has_lines = random.next().is_multiple_of(2);
    let (mut at, mut tilt) = ([-random.between(25.0, 30.0), 0.0], random.between(-0.5, 0.5));
    let (mut pieces, mut name) = (Vec::new(), String::from("walk"));
    let mut was_line = true;
    while at[0] < HALF + 2.0 {
        if has_lines && !was_line && random.next().is_multiple_of(2) {
            let length = random.between(2.0, 15.0);
            let end = [at[0] + length * tilt.cos(), at[1] - length * tilt.sin()];
            pieces.push(Piece::Line([at, end]));
            write!(name, " line {length:.1}").unwrap();
            (at, was_line) = (end, true);
            continue;
        }
        let radius = random.between(2.3, 5.0).exp();
        let length = random.between(4.0, 25.0);
        let is_convex = !random.next().is_multiple_of(3);
        let turn = (length / radius).min(1.0) * if is_convex { 1.0 } else { -1.0 };
        let to = (tilt + turn).clamp(-steepest, steepest);
        if (to - tilt).abs() < 0.03 {
            continue;
        }
        let signed = if to > tilt { radius } else { -radius };
        let center = [at[0] - signed * tilt.sin(), at[1] - signed * tilt.cos()];
        pieces.push(Piece::Arc(center, signed, [tilt, to]));
        at = [center[0] + signed * to.sin(), center[1] + signed * to.cos()];
        write!(name, " arc {signed:.1} {:.1} deg", (to - tilt).to_degrees()).unwrap();
        (tilt, was_line) = (to, false);
    }
    Profile::new(name, pieces).levelled()
}

/// The strip from y = -25 to 25 mm.
fn strip(profile: &Profile, rows: u32, deviation: f64, turn: f64, is_mirrored: bool) -> Net {
    let points = profile.cut(deviation, turn.to_radians());
    let row = |row: u32| {
        let y = 50.0 * (f64::from(row) / f64::from(rows) - 0.5);
        points
            .iter()
            .map(move |[at, normal]| (Point3::new(at.x, y, at.y), Vector3::new(normal.x, 0.0, normal.y)))
    };
    Net::of_rows((0..=rows).flat_map(row).collect(), points.len(), is_mirrored)
}

/// 150 degrees of the profile along y turned about an axis `radius` mm below z = 0.
fn turned(profile: &Profile, radius: f64, deviation: f64, turn: f64, is_mirrored: bool) -> Net {
    let points = profile.cut(deviation, turn.to_radians());
    let reach = 75f64.to_radians();
    let sector = turn.to_radians().min(2.0 * (1.0 - deviation / radius).acos());
    let sectors = (2.0 * reach / sector).ceil() as u32;
    let ring = points.iter().flat_map(|[at, normal]| {
        (0..=sectors).map(move |column| {
            let angle = reach * (2.0 * f64::from(column) / f64::from(sectors) - 1.0);
            let (sin, cos) = angle.sin_cos();
            let out = radius + at.y;
            (
                Point3::new(out * sin, at.x, out * cos - radius),
                Vector3::new(normal.y * sin, normal.x, normal.y * cos),
            )
        })
    });
    Net::of_rows(ring.collect(), sectors as usize + 1, is_mirrored)
}

/// A curve along x: z = -bend·x² + skew·x³, or an arc, mm.
#[derive(Debug, Clone, Copy)]
enum Bow {
    Arc(f64),
    Curve(f64, f64),
}

impl Bow {
    fn draw(random: &mut Random) -> Self {
        if random.next().is_multiple_of(2) {
            Self::Arc(random.between(30.0, 150.0))
        } else {
            Self::Curve(random.between(-0.004, 0.012), random.between(-1e-4, 1e-4))
        }
    }

    fn height(self, x: f64) -> f64 {
        match self {
            Self::Arc(radius) => (radius * radius - x * x).sqrt() - radius,
            Self::Curve(bend, skew) => -bend * x * x + skew * x * x * x,
        }
    }
}

fn lofted([one, other]: [Bow; 2], is_smooth: bool, x: f64, y: f64) -> f64 {
    let way = ((y + 25.0) / 50.0).clamp(0.0, 1.0);
    let share = if is_smooth { way * way * (3.0 - 2.0 * way) } else { way };
    one.height(x) * (1.0 - share) + other.height(x) * share
}

fn loft(bows: [Bow; 2], rows: u32, is_smooth: bool, deviation: f64, turn: f64, is_mirrored: bool) -> Net {
    let height = |x: f64, y: f64| lofted(bows, is_smooth, x, y);
    let slope = |x: f64, y: f64| (height(x + 1e-5, y) - height(x - 1e-5, y)) / 2e-5;
    let is_fine = |count: u32| {
        (0..count).all(|step| {
            let at = |part: f64| 25.0 * (2.0 * (f64::from(step) + part) / f64::from(count) - 1.0);
            [-25.0, 25.0].into_iter().all(|y| {
                let [from, to] = [0.0, 1.0].map(|part| height(at(part), y));
                [0.25, 0.5, 0.75, 1.0].into_iter().all(|part| {
                    let apart = (slope(at(0.0), y).atan() - slope(at(part), y).atan()).abs();
                    (height(at(part), y) - from - (to - from) * part).abs() <= deviation
                        && apart <= turn.to_radians()
                })
            })
        })
    };
    let count = (1..1000).find(|&count| is_fine(count)).unwrap();
    let point = |column: u32, row: u32| {
        let along = |index: u32, count: u32| 25.0 * (2.0 * f64::from(index) / f64::from(count) - 1.0);
        let (x, y) = (along(column, count), along(row, rows));
        // One-sided at the ends of the part.
        let [low, high] = [(y - 1e-5).max(-25.0), (y + 1e-5).min(25.0)];
        let along_y = (height(x, high) - height(x, low)) / (high - low);
        (Point3::new(x, y, height(x, y)), Vector3::new(-slope(x, y), -along_y, 1.0).normalize())
    };
    let points = (0..=rows).flat_map(|row| (0..=count).map(move |column| (column, row)));
    let points = points.map(|(column, row)| point(column, row)).collect();
    Net::of_rows(points, count as usize + 1, is_mirrored)
}

/// Half an ellipsoid with its top at z = 0, with meridians and parallels round poles along y or along the view.
fn ellipsoid(axes: [f64; 3], is_along_view: bool, deviation: f64, turn: f64, is_mirrored: bool) -> Net {
    let step = |axis: f64| turn.to_radians().min(2.0 * (1.0 - deviation / axis).acos());
    let on_unit = |longitude: f64, latitude: f64| {
        let (out, up) = (latitude.cos(), latitude.sin());
        let round = [out * longitude.sin(), out * longitude.cos()];
        if is_along_view {
            Vector3::new(round[0], -round[1], up)
        } else {
            Vector3::new(round[0], up, round[1])
        }
    };
    let point = |longitude: f64, latitude: f64| {
        let unit = on_unit(longitude, latitude);
        let [a, b, c] = axes;
        let at = Point3::new(a * unit.x, b * unit.y, c * unit.z - c);
        (at, Vector3::new(unit.x / a, unit.y / b, unit.z / c).normalize())
    };
    let ([from, to], [south, north]) = if is_along_view {
        ([-TAU / 2.0, TAU / 2.0], [0.0, FRAC_PI_2])
    } else {
        ([-FRAC_PI_2, FRAC_PI_2], [-FRAC_PI_2, FRAC_PI_2])
    };
    let columns = ((to - from) / step(axes[0].max(axes[2]))).ceil() as u32;
    let rows = ((north - south) / step(axes[1].max(axes[2]))).ceil() as u32;
    let along = |[from, to]: [f64; 2], index: u32, count: u32| {
        from + (to - from) * f64::from(index) / f64::from(count)
    };
    let nodes = (0..=rows).flat_map(|row| (0..=columns).map(move |column| (column, row)));
    let points = nodes
        .map(|(column, row)| point(along([from, to], column, columns), along([south, north], row, rows)));
    Net::of_rows(points.collect(), columns as usize + 1, is_mirrored)
}
