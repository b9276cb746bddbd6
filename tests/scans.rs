//! Scans of surfaces with a known formula: the errors of the marked drawing on the true surface, not on the noisy one.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use std::f64::consts::TAU;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::height_field::Node;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::quality::{self, Distortion};
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::point_cloud::PointCloud;
use isomark::geometry::shapes;
use isomark::geometry::solid::round::RoundForm;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::FittedSurface;
use isomark::geometry::surface::scan::{ScanError, ScanQuality, SmoothedScan, Smoothing};
use nalgebra::{Point3, Vector2, Vector3};

/// Random numbers that are the same on every system.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Box & Muller.
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// Points of the surface `height` over a disc of radius 28.5 mm, `step` mm apart.
fn grid(step: f64, height: fn(f64, f64) -> f64) -> Vec<Point3<f64>> {
    let count = (28.5 / step) as i32;
    let places = (-count..=count).flat_map(|row| (-count..=count).map(move |column| (column, row)));
    let points = places.map(|(column, row)| (f64::from(column) * step, f64::from(row) * step));
    points.filter(|(x, y)| x.hypot(*y) <= 28.5).map(|(x, y)| Point3::new(x, y, height(x, y))).collect()
}

fn noisy(mut points: Vec<Point3<f64>>, noise: f64, random: &mut Random) -> Vec<Point3<f64>> {
    points.iter_mut().for_each(|point| point.z += noise * random.normal());
    points
}

fn smoothed(points: Vec<Point3<f64>>, smoothing: Smoothing) -> (FittedSurface, ScanQuality) {
    let scan = SmoothedScan::new(&PointCloud::new(points, Vec::new()), &View::top(), smoothing).unwrap();
    (FittedSurface::of_field(scan.field).unwrap(), scan.quality)
}

fn letters(at: FlatPoint) -> Pattern {
    let bytes = include_bytes!("../examples/patterns/letters.dxf");
    let pattern = read(bytes, &PatternOptions::default()).unwrap().pattern;
    pattern.transformed(&Affine::rigid(pattern.extents().center().into(), 0.0, at))
}

/// The distortion on the true surface.
fn judged(surface: &FittedSurface, height: fn(f64, f64) -> f64, at: [f64; 2]) -> Distortion {
    let anchor = FlatPoint::new(at[0], at[1]);
    let pattern = letters(anchor);
    let method = Method::Isometric(IsometricOptions::INK);
    let map = LengthTrueMap::find(surface, &pattern, |_| true, anchor, &method).unwrap();
    let ink = quality::sample(&pattern, |_| true);
    quality::measure(&ink, |at| map.point(at), |at: ViewPoint| Some(height(at.x, at.y))).unwrap()
}

const MANDARIN_AT: [f64; 2] = [0.0, 3.0];
const NOISE: f64 = 0.05;

/// e_l of the letters on the mandarin, mm, and the quality of the scan.
fn on_the_mandarin(points: Vec<Point3<f64>>) -> (f64, ScanQuality) {
    let (surface, quality) = smoothed(points, Smoothing::Auto);
    (judged(&surface, shapes::mandarin, MANDARIN_AT).length_error, quality)
}

#[test]
fn scanner_noise_has_little_effect_on_lengths() {
    for seed in 0..8 {
        let points = noisy(grid(1.0, shapes::mandarin), NOISE, &mut Random(seed));
        let (length_error, quality) = on_the_mandarin(points);
        assert!(length_error < 0.25, "seed {seed}: e_l {length_error} mm");
        let [region] = &quality.regions[..] else { panic!("{quality:?}") };
        assert!((region.noise / NOISE - 1.0).abs() < 0.06, "{region:?}");
        assert!(quality.dropped <= 5 && quality.hidden <= 5 && region.departure == 0.0, "{quality:?}");
    }
}

#[test]
fn automatic_smoothing_is_close_to_the_best_one() {
    for seed in 0..2 {
        let points = noisy(grid(1.0, shapes::mandarin), NOISE, &mut Random(seed));
        let found = on_the_mandarin(points.clone()).0;
        let best = [5.0, 6.0, 7.0, 8.0, 10.0, 16.0].map(|wavelength| {
            let (surface, _) = smoothed(points.clone(), Smoothing::LowPass { wavelength });
            judged(&surface, shapes::mandarin, MANDARIN_AT).length_error
        });
        let best = best.into_iter().fold(f64::INFINITY, f64::min);
        assert!(found < 1.1 * best, "{found} mm, best {best} mm");
        // Without smoothing, the reference has 1.18 mm.
        let (rough, _) = smoothed(points, Smoothing::None);
        assert!(judged(&rough, shapes::mandarin, MANDARIN_AT).length_error > 3.0 * found);
    }
}

/// Points of a surface at random places of a square with a side of 40 mm.
fn at_random(count: usize, height: fn(f64, f64) -> f64) -> Vec<Point3<f64>> {
    let mut random = Random(count as u64);
    let mut along = move || 40.0 * random.uniform() - 20.0;
    (0..count).map(|_| (along(), along())).map(|(x, y)| Point3::new(x, y, height(x, y))).collect()
}

/// The root mean squares of the error of the slope in the middle of a scan, and of what is reported as unknown of it.
fn slope_errors(points: Vec<Point3<f64>>, height: fn(f64, f64) -> f64) -> [f64; 2] {
    let scan =
        SmoothedScan::new(&PointCloud::new(points, Vec::new()), &View::top(), Smoothing::Auto).unwrap();
    let surface = FittedSurface::of_field(scan.field.clone()).unwrap();
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (column, row, _) in scan.field.surface_nodes() {
        let at = scan.field.position(column, row);
        if at.x.abs() > 8.0 || at.y.abs() > 5.0 {
            continue;
        }
        let difference = |x: f64, y: f64| (height(at.x + x, at.y + y) - height(at.x - x, at.y - y)) / 2e-5;
        let slope = Vector2::new(difference(1e-5, 0.0), difference(0.0, 1e-5));
        let unknown = f64::from(scan.uncertainties[row * scan.field.size().0 + column].slope);
        let errors = [(surface.nurbs.gradient(at) - slope).norm(), unknown];
        sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
        count += 1.0;
    }
    sums.map(|sum| (sum / count).sqrt())
}

/// A tube with a radius of 12 mm round a ring, on a plate.
fn tube(x: f64, y: f64) -> f64 {
    (144.0 - (x.hypot(y - 40.0) - 40.0).powi(2)).max(0.0).sqrt()
}

/// Two slopes that meet within about 1 mm.
fn ridge(x: f64, _: f64) -> f64 {
    8.0 - 0.5 * x.hypot(1.0)
}

/// Waves 9.4 mm long and 0.6 mm high.
fn waves(x: f64, y: f64) -> f64 {
    0.3 * (x / 1.5).cos() * (y / 1.5).cos()
}

#[test]
fn what_sparse_points_leave_open_is_reported() {
    for (name, height) in
        [("tube", tube as fn(f64, f64) -> f64), ("ridge", ridge), ("waves", waves), ("mouse", shapes::mouse)]
    {
        for count in [150, 300, 600, 1_500] {
            // With fewer points, the waves look like noise.
            if name == "waves" && count < 600 {
                continue;
            }
            let [error, unknown] = slope_errors(at_random(count, height), height);
            assert!(unknown > 0.5 * error, "{name}, {count} points: {error}, reported {unknown}");
            assert!(unknown < 4.0 * error + 0.1, "{name}, {count} points: {error}, reported {unknown}");
        }
    }
}

/// The largest error of the height, mm, where the surface with the formula is tilted by less than about 55°, and how many of its nodes
/// there have no surface.
fn worst_height(scan: &SmoothedScan, height: impl Fn(f64, f64) -> Option<f64>) -> (f64, usize, usize) {
    let (columns, rows) = scan.field.size();
    let (mut worst, mut open, mut all) = (0.0f64, 0, 0);
    for (column, row) in (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row))) {
        let at = scan.field.position(column, row);
        let Some(height) = height(at.x, at.y) else { continue };
        all += 1;
        match scan.field.nodes()[row * columns + column] {
            Node::Surface(found) => worst = worst.max((found - height).abs()),
            _ => open += 1,
        }
    }
    (worst, open, all)
}

/// Random points, as many on every area, of a whole ball with a radius of 30 mm, and of a whole tube, 80 mm long, with a hole in
/// its upper side through which its lower side is seen.
#[test]
fn random_points_all_round_a_part_are_not_seen_through() {
    let (radius, half) = (30.0f64, 40.0);
    for seed in 0..2 {
        for (count, noise) in [(3_000, 0.0), (20_000, 0.03), (40_000, 0.0)] {
            let random = &mut Random(seed);
            let ball = (0..count).map(|_| {
                let along = Vector3::from_fn(|_, _| random.normal()).normalize();
                Point3::from(along * (radius + noise * random.normal()))
            });
            let cloud = PointCloud::new(ball.collect(), Vec::new());
            let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
            let height = |x: f64, y: f64| {
                let from_axis = x.hypot(y);
                (from_axis < 0.8 * radius).then(|| (radius * radius - from_axis * from_axis).sqrt())
            };
            let (worst, open, all) = worst_height(&scan, height);
            let within = 3.0 * noise + if count < 10_000 { 0.3 } else { 0.05 };
            // Between few random points, some gaps stay open.
            let most = if count < 10_000 { all / 40 } else { all / 100 };
            assert!(worst < within && open <= most, "seed {seed}, {count}: {worst} mm, {open} of {all}");
            let hidden = scan.quality.hidden as f64 / f64::from(count);
            assert!((hidden - 0.5).abs() < 0.06, "{:?}", scan.quality);
        }
        let random = &mut Random(seed);
        let tube = (0..40_000).map(|_| {
            let (angle, along) = (TAU * random.uniform(), half * (2.0 * random.uniform() - 1.0));
            Point3::new(radius * angle.sin(), along, radius * angle.cos())
        });
        let in_hole = |x: f64, y: f64| (x - 6.0).hypot(y - 3.0);
        let tube = tube.filter(|point| point.z < 0.0 || in_hole(point.x, point.y) > 5.0);
        let cloud = PointCloud::new(tube.collect(), Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let upper = |x: f64| (radius * radius - x * x).sqrt();
        let beside = |x: f64, y: f64| {
            (x.abs() < 0.8 * radius && y.abs() < half - 1.0 && in_hole(x, y) > 7.0).then(|| upper(x))
        };
        let (worst, open, all) = worst_height(&scan, beside);
        assert!(worst < 0.05 && open * 100 < all, "seed {seed}: {worst} mm, {open} of {all}");
        let (worst, open, all) = worst_height(&scan, |x, y| (in_hole(x, y) < 3.5).then(|| -upper(x)));
        assert!(worst < 0.3 && open * 3 < all, "seed {seed}, in the hole: {worst} mm, {open} of {all}");
    }
}

/// A cylinder along y with a radius of 33 mm and 80 mm long, up to 74° to both sides of its crest, and what its radius deviates by at an
/// angle and a place along the axis, mm.
struct Round<'d> {
    deviation: &'d dyn Fn(f64, f64) -> f64,
}

impl Round<'_> {
    fn points(&self, count: usize, noise: f64, random: &mut Random) -> Vec<Point3<f64>> {
        let mut between = |most: f64| most * (2.0 * random.uniform() - 1.0);
        let places: Vec<[f64; 2]> = (0..count).map(|_| [between(1.3), between(40.0)]).collect();
        let point = |&[angle, along]: &[f64; 2]| {
            let radius = 33.0 + (self.deviation)(angle, along) + noise * random.normal();
            Point3::new(radius * angle.sin(), along, radius * angle.cos())
        };
        places.iter().map(point).collect()
    }

    fn height(&self, x: f64, y: f64) -> f64 {
        let angle = (0..20).fold(0.0, |angle, _| (x / (33.0 + (self.deviation)(angle, y))).asin());
        (33.0 + (self.deviation)(angle, y)) * angle.cos()
    }

    /// Whether a scan is taken for a cylinder or cone, and the root mean squares of the error of its slope, as an angle, and of what is
    /// reported as unknown of it.
    fn judged(&self, points: Vec<Point3<f64>>) -> (bool, [f64; 2]) {
        let cloud = PointCloud::new(points, Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let surface = FittedSurface::of_field(scan.field.clone()).unwrap();
        let (mut sums, mut count) = ([0.0; 2], 0.0);
        for (column, row, _) in scan.field.surface_nodes() {
            let at = scan.field.position(column, row);
            if at.x.abs() > 26.0 || at.y.abs() > 36.0 {
                continue;
            }
            let difference =
                |x: f64, y: f64| (self.height(at.x + x, at.y + y) - self.height(at.x - x, at.y - y)) / 2e-4;
            let slope = Vector2::new(difference(1e-4, 0.0), difference(0.0, 1e-4));
            let off = (surface.nurbs.gradient(at) - slope).norm() / (1.0 + slope.norm_squared());
            let unknown = f64::from(scan.uncertainties[row * scan.field.size().0 + column].slope);
            sums.iter_mut().zip([off, unknown]).for_each(|(sum, error)| *sum += error * error);
            count += 1.0;
        }
        (!scan.known.is_empty(), sums.map(|sum| (sum / count).sqrt()))
    }
}

#[test]
fn a_cylinder_or_cone_is_recognised_at_any_noise() {
    let dense = [(0, 20_000, 0.02), (1, 20_000, 0.1)];
    for (seed, count, noise) in dense.into_iter().chain((0..3).map(|seed| (seed, 5_000, 0.05))) {
        for slope in [0.0, 0.1] {
            let round = Round { deviation: &|_, along| slope * along };
            let points = round.points(count, noise, &mut Random(seed));
            let (is_recognised, [off, unknown]) = round.judged(points);
            let what = format!("seed {seed}, {count}, {noise}, {slope}: {off} of {unknown}");
            assert!(is_recognised && off < 0.02 * noise.max(0.02) && off < unknown, "{what}");
        }
    }
}

#[test]
fn the_radius_of_a_recognised_cylinder_is_known_as_well_as_is_stated() {
    let round = Round { deviation: &|_, _| 0.0 };
    for seed in 0..8 {
        let cloud = PointCloud::new(round.points(5_000, 0.05, &mut Random(seed)), Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let [known] = &scan.known[..] else { panic!("seed {seed}: {:?}", scan.known) };
        let RoundForm::Cylinder { radius, .. } = known.form else { panic!("seed {seed}: {known:?}") };
        let off = (radius - 33.0).abs();
        // Of eight values, hardly one is more than three standard deviations off.
        assert!(
            off < 1.2 * known.size_off && known.size_off < 0.02,
            "seed {seed}: {off} of {}",
            known.size_off
        );
    }
}

/// None is taken for a cylinder or cone if that would make slopes worse than is reported.
#[test]
fn what_is_not_round_is_not_taken_for_it_or_hidden_in_what_is_unknown() {
    let (count, noise) = (10_000, 0.05);
    let mut recognised = 0;
    for (number, share) in [0.1, 0.3, 1.0, 3.0].into_iter().enumerate() {
        let size = share * noise;
        let oval = |angle: f64, _: f64| 3.0 * size * (3.0 * angle).cos();
        let barrel = |_: f64, along: f64| size * (1.0 - (along / 40.0).powi(2));
        let bent = |angle: f64, along: f64| size * (along / 40.0).powi(2) * angle.cos();
        let waves = |angle: f64, _: f64| size * (TAU * 33.0 * angle / 8.0).sin();
        let dent = |angle: f64, along: f64| {
            -3.0 * size * (-((33.0 * angle - 9.0).powi(2) + (along - 4.0).powi(2)) / 50.0).exp()
        };
        let deviations: [&dyn Fn(f64, f64) -> f64; 5] = [&oval, &barrel, &bent, &waves, &dent];
        for (kind, deviation) in deviations.into_iter().enumerate() {
            let round = Round { deviation };
            let points = round.points(count, noise, &mut Random((number * 5 + kind) as u64));
            let (is_recognised, [off, unknown]) = round.judged(points);
            assert!(off < unknown, "deviation {kind} of {size}: {off} of {unknown}, {is_recognised}");
            assert!(!is_recognised || share < 1.0, "deviation {kind} of {size} is not seen");
            recognised += usize::from(is_recognised);
        }
    }
    assert!(recognised >= 3, "only {recognised} of ten deviations below the noise are taken for a cylinder");
}

/// The smoothing of a gentle form is long, and may follow a wave that the noise hides from the form.
#[test]
fn a_long_wave_on_a_gentle_cylinder_is_within_what_is_unknown() {
    for (seed, radius) in [(1, 80.0), (2, 80.0), (3, 80.0), (4, 200.0), (5, 200.0), (6, 200.0)] {
        let random = &mut Random(seed);
        let (half, wave) = (0.5 * 80.0 / radius, 40.0);
        let off = |angle: f64| 0.025 * (TAU * radius * angle / wave).sin();
        let points = (0..3_000).map(|_| {
            let (angle, along) = (half * (2.0 * random.uniform() - 1.0), 80.0 * (random.uniform() - 0.5));
            let out = radius + off(angle) + 0.1 * random.normal();
            Point3::new(out * angle.sin(), along, out * angle.cos() - radius)
        });
        let cloud = PointCloud::new(points.collect(), Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let columns = scan.field.size().0;
        let (mut sums, mut count) = ([0.0; 2], 0.0);
        // A smoothed surface follows the wave.
        if scan.known.is_empty() {
            continue;
        }
        for (column, row, _) in scan.field.surface_nodes() {
            let at = scan.field.position(column, row);
            let angle = (at.x / radius).asin();
            let wave = 0.025 * TAU / wave * (TAU * radius * angle / wave).cos();
            sums[0] += wave * wave;
            sums[1] += f64::from(scan.uncertainties[row * columns + column].slope).powi(2);
            count += 1.0;
        }
        let [off, unknown] = sums.map(|sum: f64| (sum / count).sqrt());
        assert!(off < unknown, "R {radius}, seed {seed}: {off} of {unknown}");
    }
}

/// Random points 0.42 mm apart, and a hole that is wider than the gaps that they leave by chance.
#[test]
fn a_hole_between_random_points_remains_a_hole() {
    for seed in 0..12 {
        let random = &mut Random(seed);
        let mut along = || 30.0 * (random.uniform() - 0.5);
        let places: Vec<[f64; 2]> = (0..5_000).map(|_| [along(), along()]).collect();
        let from_hole = |x: f64, y: f64| (x - 3.0).hypot(y - 1.0);
        let beside = places.into_iter().filter(|[x, y]| from_hole(*x, *y) > 2.0);
        let points = beside.map(|[x, y]| Point3::new(x, y, 0.02 * x * y + 0.02 * random.normal())).collect();
        let cloud = PointCloud::new(points, Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        for (column, row, _) in scan.field.surface_nodes() {
            let at = scan.field.position(column, row);
            assert!(from_hole(at.x, at.y) > 0.6, "seed {seed}: {at:?}");
        }
    }
}

/// One half of a plate is a lattice of points that are farther apart than in the other half, and has a hole.
#[test]
fn a_hole_between_sparse_points_of_a_lattice_remains_a_hole() {
    for (number, apart) in [0.52, 0.64, 0.8, 1.0, 1.2].into_iter().enumerate() {
        let random = &mut Random(number as u64);
        let lattice = |first: f64, last: f64, apart: f64| {
            let columns = ((last - first) / apart) as u32;
            let rows = (50.0 / apart) as u32;
            (0..columns).flat_map(move |column| {
                (0..rows).map(move |row| [first + f64::from(column) * apart, f64::from(row) * apart - 25.0])
            })
        };
        let from_hole = |x: f64, y: f64| (x + 15.0).hypot(y);
        let places = lattice(-30.0, 0.0, apart).chain(lattice(0.0, 30.0, 0.4));
        let beside = places.filter(|[x, y]| from_hole(*x, *y) > 5.0);
        let points = beside.map(|[x, y]| Point3::new(x, y, 0.01 * random.normal())).collect();
        let cloud = PointCloud::new(points, Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let (mut beside, mut all) = (0, 0);
        for (column, row, _) in scan.field.surface_nodes() {
            let at = scan.field.position(column, row);
            assert!(from_hole(at.x, at.y) > 0.5, "{apart} mm apart: {at:?}");
            all += 1;
            beside += usize::from(at.x < 0.0);
        }
        assert!(beside * 10 > 4 * all, "{apart} mm apart: {beside} of {all}");
    }
}

/// Half of a dome has fewer points. Where they are, there is a surface, known as well as is reported.
#[test]
fn points_that_are_sparse_in_one_half_are_a_surface_there() {
    let dome = |x: f64, y: f64| -x * x / 90.0 - y * y / 160.0 + 1.2 * (x / 9.0).sin() * (y / 11.0).cos();
    let noise = 0.03;
    for (seed, sparse) in [(0, 3.0), (1, 3.0), (2, 5.0), (3, 5.0), (4, 10.0), (5, 10.0)] {
        let random = &mut Random(seed);
        let places = (0..30_000).map(|_| [60.0, 50.0].map(|side| side * (random.uniform() - 0.5)));
        let places: Vec<[f64; 2]> = places.collect();
        let mut points = Vec::new();
        for [x, y] in places {
            if x < 0.0 || random.uniform() * sparse < 1.0 {
                points.push(Point3::new(x, y, dome(x, y) + noise * random.normal()));
            }
        }
        let cloud = PointCloud::new(points, Vec::new());
        let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
        let what = format!("{sparse} times fewer, seed {seed}: {:?}", scan.quality);
        assert!(scan.quality.dropped * 300 < scan.quality.points, "{what}");
        let inside = |x: f64, y: f64| (x.abs() < 27.0 && y.abs() < 22.0).then(|| dome(x, y));
        let (worst, open, all) = worst_height(&scan, inside);
        assert!(worst < 2.0 * noise && open * 100 < all, "{worst} mm, {open} of {all}, {what}");
        let surface = FittedSurface::of_field(scan.field.clone()).unwrap();
        let (mut sums, mut count) = ([0.0; 2], 0.0);
        for (column, row, _) in scan.field.surface_nodes() {
            let at = scan.field.position(column, row);
            if !(3.0..27.0).contains(&at.x) || at.y.abs() > 22.0 {
                continue;
            }
            let difference = |x: f64, y: f64| (dome(at.x + x, at.y + y) - dome(at.x - x, at.y - y)) / 2e-4;
            let slope = Vector2::new(difference(1e-4, 0.0), difference(0.0, 1e-4));
            let off = (surface.nurbs.gradient(at) - slope).norm() / (1.0 + slope.norm_squared());
            let unknown = f64::from(scan.uncertainties[row * scan.field.size().0 + column].slope);
            sums.iter_mut().zip([off, unknown]).for_each(|(sum, error)| *sum += error * error);
            count += 1.0;
        }
        let [off, unknown] = sums.map(|sum: f64| (sum / count).sqrt());
        assert!(off < unknown, "{off} of {unknown}, {what}");
    }
}

#[test]
fn points_that_are_there_twice_count_once() {
    for height in [shapes::sphere as fn(f64, f64) -> f64, tube] {
        let once = at_random(3_000, height);
        let twice: Vec<Point3<f64>> = once.iter().chain(&once).copied().collect();
        let scan = |points| {
            SmoothedScan::new(&PointCloud::new(points, Vec::new()), &View::top(), Smoothing::Auto).unwrap()
        };
        assert!(scan(twice) == scan(once));
    }
}

#[test]
fn points_without_noise_are_followed() {
    for (shape, at) in [(shapes::mandarin as fn(f64, f64) -> f64, MANDARIN_AT), (shapes::sphere, [0.0; 2])] {
        let (surface, quality) = smoothed(grid(1.0, shape), Smoothing::Auto);
        let between = grid(0.37, shape).into_iter().filter(|point| point.coords.xy().norm() < 25.0);
        let worst = between.map(|point| {
            let height = surface.nurbs.height(ViewPoint::new(point.x, point.y));
            (height - point.z).abs()
        });
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 0.001, "{worst} mm");
        assert!(quality.dropped == 0 && quality.regions[0].noise < 1e-4, "{quality:?}");
        assert!(judged(&surface, shape, at).length_error < 0.2);
    }
}

#[test]
fn outliers_gaps_and_irregular_points_have_little_effect() {
    let mut random = Random(7);
    let clean = || grid(1.0, shapes::mandarin);
    let off = |points: &mut Vec<Point3<f64>>, share: f64, random: &mut Random| {
        for point in points.iter_mut() {
            if random.uniform() < share {
                point.z += 16.0 * random.uniform() - 8.0;
            }
        }
    };
    let anywhere = |x: f64, y: f64, random: &mut Random| {
        Point3::new(x, y, shapes::mandarin(x, y) + NOISE * random.normal())
    };
    let mut few_off = noisy(clean(), NOISE, &mut random);
    off(&mut few_off, 0.02, &mut random);
    let mut many_off = noisy(clean(), NOISE, &mut random);
    off(&mut many_off, 0.10, &mut random);
    let mut gaps = noisy(clean(), NOISE, &mut random);
    gaps.retain(|_| random.uniform() > 0.1);
    let jittered = clean().into_iter().map(|point| {
        let [x, y] = [point.x, point.y].map(|place| place + 0.6 * random.uniform() - 0.3);
        anywhere(x, y, &mut random)
    });
    let jittered: Vec<_> = jittered.collect();
    let scattered: Vec<_> = (0..2500)
        .map(|_| {
            let (r, angle) = (28.5 * random.uniform().sqrt(), TAU * random.uniform());
            anywhere(r * angle.cos(), r * angle.sin(), &mut random)
        })
        .collect();
    // A line scanner: points 0.1 mm apart on lines 1 mm apart.
    let lines = (-28..=28).flat_map(|row| (-280..=280).map(move |column| (column, row)));
    let lines = lines.map(|(column, row)| (f64::from(column) * 0.1, f64::from(row)));
    let lines: Vec<_> =
        lines.filter(|(x, y)| x.hypot(*y) < 28.0).map(|(x, y)| anywhere(x, y, &mut random)).collect();
    // The whole fruit with its underside.
    let mut whole = noisy(clean(), NOISE, &mut random);
    whole.extend(
        clean().iter().map(|point| Point3::new(point.x + 0.3, point.y, 0.05 * random.normal() - point.z)),
    );
    for (what, points, lost) in [
        ("2 % outliers", few_off, 2..90),
        ("10 % outliers", many_off, 100..350),
        ("10 % missing", gaps, 0..5),
        ("jittered", jittered, 0..5),
        ("scattered", scattered, 0..5),
        ("lines", lines, 0..20),
        ("both sides", whole, 2500..2700),
    ] {
        let (length_error, quality) = on_the_mandarin(points);
        assert!(length_error < 0.35, "{what}: e_l {length_error} mm, {quality:?}");
        assert!(lost.contains(&(quality.dropped + quality.hidden)), "{what}: {quality:?}");
        assert!((quality.regions[0].noise / NOISE - 1.0).abs() < 0.08, "{what}: {quality:?}");
    }
}

#[test]
fn fruit_and_table_in_a_camera_image_are_separated_by_a_cliff() {
    let mut random = Random(11);
    let mut points = Vec::new();
    for row in 0..172 {
        for column in 0..224 {
            let (x, y) = (f64::from(column - 112) * 0.6, f64::from(row - 86) * 0.6);
            let height = if x.hypot(y) < 29.0 { shapes::mandarin(x, y) } else { -30.0 };
            let stray = if random.uniform() < 0.02 { 16.0 * random.uniform() - 8.0 } else { 0.0 };
            if random.uniform() > 0.1 {
                points.push(Point3::new(x, y, height + stray + 0.3 * random.normal()));
            }
        }
    }
    let (surface, quality) = smoothed(points, Smoothing::Auto);
    let [table, fruit] = &quality.regions[..] else { panic!("{quality:?}") };
    assert!((table.noise - 0.3).abs() < 0.02 && (fruit.noise - 0.3).abs() < 0.02, "{quality:?}");
    assert!(table.heights[0] > -30.1 && table.heights[1] < -29.9, "a flat table: {table:?}");
    assert!(surface.field.is_surface(ViewPoint::new(0.0, 0.0)));
    assert!(surface.field.is_surface(ViewPoint::new(50.0, 0.0)));
    for angle in 0..24 {
        let (sin, cos) = (f64::from(angle) * 0.2618).sin_cos();
        let mut crossed = (0..40).map(|step| 28.0 + 0.05 * f64::from(step));
        let is_surface = |r: f64| surface.field.is_surface(ViewPoint::new(r * cos, r * sin));
        assert!(!crossed.all(is_surface), "no cliff at {angle}");
    }
    // The spline falls 36 mm at the cliff; 9 mm inside, this has no effect on the fruit.
    for step in 0..=400 {
        let at = ViewPoint::new(20.0 * (f64::from(step) / 400.0), f64::from(step % 7) * 0.5);
        let misfit = surface.difference(at);
        assert!(misfit.abs() < 0.02, "{misfit} mm at {at:?}");
    }
    // The noise is six times that of a laser scanner, with points 0.6 mm apart.
    let length_error = judged(&surface, shapes::mandarin, MANDARIN_AT).length_error;
    assert!(length_error < 0.6, "{length_error} mm");
}

#[test]
fn a_low_pass_halves_waves_of_its_length() {
    let wave = |length: f64| {
        let place = |index: i32| f64::from(index) * 0.5;
        let points = (-80..=80).flat_map(|row| (-80..=80).map(move |column| (place(column), place(row))));
        let height = |x: f64| (TAU * x / length).cos();
        points.map(|(x, y)| Point3::new(x, y, height(x))).collect::<Vec<_>>()
    };
    // 1 / (1 + (L/l)^6): the squared response of a third-order Butterworth filter.
    for (length, left) in [(8.0, 0.0154), (16.0, 0.5), (20.0, 0.792), (32.0, 0.985)] {
        let wavelength = Smoothing::THESIS_WAVELENGTH;
        let (surface, _) = smoothed(wave(length), Smoothing::LowPass { wavelength });
        let height = surface.nurbs.height(ViewPoint::new(0.0, 0.0));
        assert!((height - left).abs() < 0.02, "{length} mm: {height} for {left}");
    }
}

#[test]
fn a_rounded_edge_is_reported_as_departure() {
    let roof = |x: f64, _: f64| 10.0 - 0.4 * x.abs();
    let (_, quality) =
        smoothed(noisy(grid(1.0, roof), NOISE, &mut Random(3)), Smoothing::LowPass { wavelength: 16.0 });
    let region = &quality.regions[0];
    assert!(region.departure > 0.2 && region.departure_at.x.abs() < 2.0, "{region:?}");
}

#[test]
fn points_that_face_away_from_the_laser_are_hidden() {
    let up = grid(1.0, shapes::mandarin);
    let lid: Vec<_> = up.iter().map(|point| Point3::new(point.x, point.y, point.z + 5.0)).collect();
    let normals = up.iter().map(|_| Vector3::z()).chain(lid.iter().map(|_| -Vector3::z())).collect();
    let count = lid.len();
    let cloud = PointCloud::new(up.into_iter().chain(lid).collect(), normals);
    let scan = SmoothedScan::new(&cloud, &View::top(), Smoothing::Auto).unwrap();
    assert_eq!((scan.quality.hidden, scan.quality.used), (count, count));
    assert!((scan.quality.regions[0].heights[1] - 22.5).abs() < 0.01);
}

#[test]
fn points_that_form_no_surface_are_refused_with_the_reason() {
    let mut random = Random(1);
    let refused = |points: Vec<Point3<f64>>| {
        SmoothedScan::new(&PointCloud::new(points, Vec::new()), &View::top(), Smoothing::Auto).unwrap_err()
    };
    let line =
        |count: i32| (0..count).map(|at| Point3::new(f64::from(at), 2.0 * f64::from(at), 0.0)).collect();
    assert!(matches!(refused(Vec::new()), ScanError::TooFewPoints { points: 0, .. }));
    assert!(matches!(refused(vec![Point3::origin()]), ScanError::TooFewPoints { points: 1, .. }));
    assert!(matches!(refused(line(20)), ScanError::TooFewPoints { points: 20, .. }));
    assert!(matches!(refused(line(500)), ScanError::NoArea { .. }));
    assert!(matches!(
        refused(vec![Point3::new(1.0, 2.0, 3.0); 500]),
        ScanError::TooFewPoints { points: 1, .. }
    ));
    let cloud = (0..2000).map(|_| Point3::from([(); 3].map(|()| 1e4 * random.uniform())));
    let error = refused(cloud.collect());
    assert!(matches!(error, ScanError::NoSurface { .. }), "{error}");
}

#[test]
fn unusual_clouds_give_a_surface_or_an_error() {
    let mut random = Random(5);
    let square = |step: f64| grid(step, |_, _| 1.0);
    let mut twice = square(1.0);
    twice.extend(square(1.0));
    let mut far = square(1.0);
    far.push(Point3::new(1e5, -1e5, 1e5));
    far.push(Point3::new(f64::NAN, 1e30, 0.0));
    let mut two = square(1.0);
    two.extend(square(1.0).iter().map(|point| point + Vector3::new(5000.0, 0.0, 0.0)));
    let mut ragged = square(1.0);
    ragged.iter_mut().for_each(|point| point.z = 500.0 * random.uniform());
    let huge: Vec<_> = square(1.0).iter().map(|point| point * 3000.0).collect();
    let tiny: Vec<_> = square(1.0).iter().map(|point| point * 1e-3).collect();
    let off_center: Vec<_> = square(1.0).iter().map(|point| point + Vector3::new(9e4, 9e4, 9e4)).collect();
    for points in [twice, far, two, ragged, huge, tiny, off_center] {
        let Ok(scan) = SmoothedScan::new(&PointCloud::new(points, Vec::new()), &View::top(), Smoothing::Auto)
        else {
            continue;
        };
        let quality = &scan.quality;
        assert_eq!(quality.points, quality.used + quality.hidden + quality.dropped);
        assert!(scan.field.nodes().len() < 1_000_000 && quality.regions[0].noise.is_finite());
        let _ = FittedSurface::of_field(scan.field);
    }
}
