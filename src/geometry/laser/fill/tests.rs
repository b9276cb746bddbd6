//! The spacing is measured against closed forms, and on the triangles of a part.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector2};

use super::*;
use crate::geometry::facing_part::FacingPart;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::isometric::IsometricOptions;
use crate::geometry::optics::{Fixture, Lens, ScanHead};
use crate::geometry::pattern::{Layer, Path, Segment, Source};
use crate::geometry::shapes;
use crate::geometry::space::View;
use crate::geometry::surface::fit::{FitOptions, FittedSurface};

const AUTO: Method =
    Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };

fn surface(height: impl Fn(f64, f64) -> f64) -> FittedSurface {
    let part = FacingPart::new(&shapes::graph(25.0, 0.75, height), &View::top());
    FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
}

fn contour(points: &[[f64; 2]]) -> Path {
    let points: Vec<FlatPoint> = points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect();
    let sides = points.iter().zip(points.iter().cycle().skip(1));
    path(Shape::Closed(sides.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect()))
}

fn rectangle(left: f64, bottom: f64, right: f64, top: f64) -> Path {
    contour(&[[left, bottom], [right, bottom], [right, top], [left, top]])
}

fn circle(x: f64, y: f64, radius: f64) -> Path {
    path(Shape::Closed(vec![Segment::Arc {
        center: FlatPoint::new(x, y),
        u: Vector2::new(radius, 0.0),
        v: Vector2::new(0.0, radius),
        start: 0.0,
        sweep: TAU,
    }]))
}

fn path(shape: Shape) -> Path {
    Path { layer: 0, color: Color::ByLayer, shape, region: None, source: Source::default() }
}

fn drawing(paths: Vec<Path>) -> Pattern {
    Pattern { layers: vec![Layer { name: "MARK".into(), color: Color::Aci(7) }], paths }
}

fn options(spacing: f64, degrees: &[f64]) -> FillOptions {
    let angles = degrees.iter().map(|angle| angle.to_radians()).collect();
    FillOptions { spacing, angles, border: 0.0, tolerance: 0.01 }
}

fn filled(surface: &FittedSurface, pattern: &Pattern, options: &FillOptions, method: Method) -> Filling {
    let map = LengthTrueMap::find(surface, pattern, |_| true, FlatPoint::new(0.0, 0.0), &method).unwrap();
    let projection =
        Projection { map: &map, surface, fixture: Fixture::default(), head: ScanHead::TELECENTRIC };
    fill(pattern, |_| true, &projection, options).unwrap().unwrap()
}

fn flat(pattern: &Pattern, options: &FillOptions) -> Filling {
    filled(&surface(|_, _| 0.0), pattern, options, AUTO)
}

/// The lengths of the lines as drawn, with their height above the x axis, for lines along x.
fn rows(filling: &Filling) -> Vec<(f64, f64)> {
    let length = |line: &FillLine| line.drawn.windows(2).map(|ends| ends[0].distance(ends[1])).sum::<f64>();
    filling.lines.iter().map(|line| (line.drawn[0].y, length(line))).collect()
}

/// Distances in space from points along every line to the next line of its family, as shares of the spacing; points whose
/// nearest neighbour is an end of a line are left out. `lift` gives the true point of the part.
fn spacings(filling: &Filling, spacing: f64, lift: impl Fn(FieldPoint) -> Point3<f64>) -> Vec<f64> {
    // Dense polylines in space.
    let dense = |line: &FillLine| {
        let mut points = Vec::new();
        for ends in line.marked.windows(2) {
            let steps = (ends[0].distance(ends[1]) / 0.05).ceil().max(1.0) as usize;
            points.extend((0..steps).map(|step| lift(ends[0].lerp(ends[1], step as f64 / steps as f64))));
        }
        points.extend(line.marked.last().map(|end| lift(*end)));
        points
    };
    let lines: Vec<Vec<Point3<f64>>> = filling.lines.iter().map(dense).collect();
    let mut shares = Vec::new();
    for (index, line) in lines.iter().enumerate() {
        for point in line.iter().step_by(7) {
            let mut nearest: Option<(f64, bool)> = None;
            for other in lines.iter().skip(index + 1).take(3) {
                for (at, ends) in other.windows(2).enumerate() {
                    let (along, offset) = (ends[1] - ends[0], point - ends[0]);
                    let t = offset.dot(&along) / along.norm_squared();
                    let is_end = (at == 0 && t <= 0.0) || (at + 2 == other.len() && t >= 1.0);
                    let distance = (offset - along * t.clamp(0.0, 1.0)).norm();
                    if nearest.is_none_or(|(least, _)| distance < least) {
                        nearest = Some((distance, is_end));
                    }
                }
            }
            if let Some((distance, false)) = nearest.filter(|(distance, _)| *distance < 1.9 * spacing) {
                shares.push(distance / spacing - 1.0);
            }
        }
    }
    shares
}

/// The share of the deviations above 1 %, in percent, and the largest.
fn uneven(shares: &[f64]) -> (f64, f64) {
    assert!(shares.len() > 300, "only {} places were measured", shares.len());
    let over = shares.iter().filter(|share| share.abs() > 0.01).count();
    (100.0 * over as f64 / shares.len() as f64, shares.iter().fold(0.0, |most, share| share.abs().max(most)))
}

#[test]
fn on_a_plane_a_square_has_lines_from_side_to_side() {
    let filling = flat(&drawing(vec![rectangle(-5.0, -5.0, 5.0, 5.0)]), &options(0.5, &[0.0]));
    let rows = rows(&filling);
    assert_eq!(rows.len(), 20);
    for (index, (y, length)) in rows.iter().enumerate() {
        assert!(
            (y - (-4.75 + 0.5 * index as f64)).abs() < 1e-6 && (length - 10.0).abs() < 1e-6,
            "{y} {length}"
        );
    }
    // Two points each, every second line in the opposite direction.
    assert!(filling.lines.iter().all(|line| line.drawn.len() == 2));
    let direction = |line: &FillLine| line.drawn[1].x > line.drawn[0].x;
    assert!(filling.lines.windows(2).all(|pair| direction(&pair[0]) != direction(&pair[1])));
    assert!((filling.length - 200.0).abs() < 1e-5 && (filling.area - 100.0).abs() < 1.0);
    assert!(filling.uneven == 0.0 && (filling.spot_spacing[1] - 1.0).abs() < 1e-9);
}

#[test]
fn islands_overlaps_and_regions_follow_the_even_odd_rule() {
    let whole = rectangle(-8.0, -8.0, 8.0, 8.0);
    let region = |path: Path, region| Path { region: Some(region), ..path };
    for (paths, area) in [
        (
            vec![whole.clone(), circle(0.0, 0.0, 5.0), circle(0.0, 0.0, 2.0)],
            256.0 - 25.0 * TAU / 2.0 + 4.0 * TAU / 2.0,
        ),
        // An outline with its fill, and two fills that overlap, are filled once.
        (vec![whole.clone(), region(whole.clone(), 1)], 256.0),
        (vec![region(whole.clone(), 1), region(rectangle(-4.0, -4.0, 4.0, 4.0), 2)], 256.0),
        // A contour that crosses itself.
        (vec![contour(&[[-8.0, -8.0], [8.0, 8.0], [8.0, -8.0], [-8.0, 8.0]])], 128.0),
    ] {
        let filling = flat(&drawing(paths), &options(0.05, &[30.0]));
        assert!((filling.length * 0.05 - area).abs() < 0.002 * area, "{} of {area}", filling.length * 0.05);
    }
}

#[test]
fn lines_through_corners_and_along_sides_end_at_the_contour() {
    // The lines are at odd multiples of 0.5 mm from the middle: along sides, and through corners.
    let paths = vec![
        contour(&[[-5.0, -4.5], [5.0, -4.5], [5.0, 4.5], [0.0, 0.5], [-5.0, 4.5]]),
        contour(&[[-1.0, -3.5], [1.0, -2.5], [-1.0, -1.5]]),
    ];
    let filling = flat(&drawing(paths), &options(1.0, &[0.0]));
    assert!(filling.lines.iter().all(|line| line.drawn.len() == 2));
    let at = |row: f64| -> Vec<f64> {
        let mut ends: Vec<f64> = filling
            .lines
            .iter()
            .filter(|line| (line.drawn[0].y - row).abs() < 1e-6)
            .flat_map(|line| [line.drawn[0].x, line.drawn[1].x])
            .collect();
        ends.sort_by(f64::total_cmp);
        ends
    };
    let is_near = |found: Vec<f64>, expected: &[f64]| {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    };
    is_near(at(-2.5), &[-5.0, -1.0, 1.0, 5.0]);
    is_near(at(1.5), &[-5.0, -1.25, 1.25, 5.0]);
    // Through the notch's corner: one line, or two that meet there.
    let through = at(0.5);
    assert!((through[0] + 5.0).abs() < 1e-6 && (through[through.len() - 1] - 5.0).abs() < 1e-6);
}

#[test]
fn each_part_of_a_fill_has_the_colour_of_the_contour_round_it() {
    let colored = |path: Path, index| Path { color: Color::Aci(index), ..path };
    let paths = vec![
        colored(rectangle(-9.0, -2.0, -1.0, 2.0), 1),
        colored(rectangle(-6.0, -1.0, -4.0, 1.0), 2),
        colored(rectangle(1.0, -2.0, 9.0, 2.0), 3),
    ];
    let filling = flat(&drawing(paths), &options(0.5, &[0.0]));
    for line in &filling.lines {
        let expected = if line.drawn[0].x < 0.0 { 1 } else { 3 };
        assert_eq!(line.color, Color::Aci(expected), "{line:?}");
    }
}

#[test]
fn the_border_is_kept_on_the_part_round_corners_and_islands() {
    let paths = vec![rectangle(-8.0, -6.0, 8.0, 6.0), circle(0.0, 0.0, 2.0)];
    for degrees in [0.0, 37.0] {
        let fill = FillOptions { border: 0.7, ..options(0.1, &[degrees]) };
        let filling = flat(&drawing(paths.clone()), &fill);
        let ring = 14.6 * 10.6 - 2.7f64.powi(2) * TAU / 2.0;
        assert!((filling.length * 0.1 - ring).abs() < 0.004 * ring, "{} of {ring}", filling.length * 0.1);
        for at in filling.lines.iter().flat_map(|line| [line.drawn[0], line.drawn[line.drawn.len() - 1]]) {
            let inside = (8.0 - at.x.abs()).min(6.0 - at.y.abs()).min(at.coords().norm() - 2.0);
            assert!((inside - 0.7).abs() < 2e-3, "{at:?} is {inside} mm inside");
        }
    }
}

#[test]
fn on_a_sphere_the_lines_are_evenly_spaced_and_end_on_the_contour() {
    let surface = surface(shapes::sphere);
    let lift = |at: FieldPoint| Point3::new(at.x, at.y, shapes::sphere(at.x, at.y));
    let pattern = drawing(vec![rectangle(-18.0, -12.0, 18.0, 12.0), circle(3.0, 1.0, 4.0)]);
    for degrees in [0.0, 40.0] {
        for method in [AUTO, Method::Plain] {
            let filling = filled(&surface, &pattern, &options(0.4, &[degrees]), method);
            let (percent, worst) = uneven(&spacings(&filling, 0.4, lift));
            assert!(percent <= 1.0, "{percent} % of the lines at {degrees} deg are uneven, by up to {worst}");
            assert!(filling.uneven <= 0.01, "{filling:?}");
            for at in filling.lines.iter().flat_map(|line| [line.drawn[0], line.drawn[line.drawn.len() - 1]])
            {
                let side = (18.0 - at.x.abs()).abs().min((12.0 - at.y.abs()).abs());
                let round = ((at - FlatPoint::new(3.0, 1.0)).norm() - 4.0).abs();
                assert!(side.min(round) < 1e-3, "{at:?}");
            }
        }
    }
}

#[test]
fn on_a_cylinder_the_lines_are_those_of_the_unrolled_drawing() {
    let surface = surface(shapes::cylinder);
    let lift = |at: FieldPoint| Point3::new(at.x, at.y, shapes::cylinder(at.x, at.y));
    let pattern = drawing(vec![rectangle(-20.0, -10.0, 20.0, 10.0)]);
    let filling = filled(&surface, &pattern, &options(0.3, &[90.0]), AUTO);
    // Each line is at one angle about the axis.
    for line in &filling.lines {
        let angle = |at: &FieldPoint| (at.x / 30.0).asin() * 30.0;
        let (first, last) = (angle(&line.marked[0]), angle(&line.marked[line.marked.len() - 1]));
        let number = first / 0.3 - 0.5;
        assert!((first - last).abs() < 1e-3 && (number - number.round()).abs() < 5e-3, "{first} {last}");
    }
    let (percent, _) = uneven(&spacings(&filling, 0.3, lift));
    assert!(percent == 0.0, "{percent} %");
    // Round the part, the last 2 mm before 20 mm are seen as the difference of two sines.
    let last = 2.0 / (30.0 * ((20f64 / 30.0).sin() - (18f64 / 30.0).sin()));
    let around = filled(&surface, &pattern, &options(0.3, &[0.0]), AUTO);
    assert!((around.spot_spacing[1] - last).abs() < 2e-3, "{:?}", around.spot_spacing);
    assert!((filling.spot_spacing[1] - 1.0).abs() < 1e-3, "{:?}", filling.spot_spacing);
}

#[test]
fn free_form_parts_are_filled_evenly_in_any_direction() {
    for (name, height) in [
        ("mandarin", shapes::mandarin as fn(f64, f64) -> f64),
        ("mouse", shapes::mouse),
        ("saddle", shapes::saddle),
        ("torus", shapes::torus),
    ] {
        let surface = surface(height);
        let lift = |at: FieldPoint| Point3::new(at.x, at.y, height(at.x, at.y));
        let pattern = drawing(vec![rectangle(-14.0, -9.0, 14.0, 9.0), circle(-3.0, 0.0, 3.0)]);
        for degrees in [0.0, 90.0, 45.0] {
            let filling = filled(&surface, &pattern, &options(0.3, &[degrees]), AUTO);
            let (percent, worst) = uneven(&spacings(&filling, 0.3, lift));
            assert!(percent <= 1.0, "{name}, {degrees} deg: {percent} % are uneven, by up to {worst}");
        }
    }
}

#[test]
fn through_a_lens_the_lines_are_even_on_the_part_and_not_in_the_field() {
    let surface = surface(shapes::sphere);
    let pattern = drawing(vec![rectangle(-15.0, -10.0, 15.0, 10.0)]);
    let map = LengthTrueMap::find(&surface, &pattern, |_| true, FlatPoint::new(0.0, 0.0), &AUTO).unwrap();
    let head = ScanHead { lens: Lens::Perspective { x: 160.0, y: 150.0 }, axis: FieldPoint::new(0.0, 0.0) };
    let projection = Projection { map: &map, surface: &surface, fixture: Fixture::default(), head };
    let filling = fill(&pattern, |_| true, &projection, &options(0.4, &[20.0])).unwrap().unwrap();
    // The beam from (0, ·, 160) in x and from (·, 0, 150) in y meets the sphere.
    let lift = |at: FieldPoint| {
        let mut z = 30.0;
        let mut landing = Point3::origin();
        for _ in 0..50 {
            landing = Point3::new(at.x * (160.0 - z) / 160.0, at.y * (150.0 - z) / 150.0, z);
            z = shapes::sphere(landing.x, landing.y);
        }
        landing
    };
    let (percent, _) = uneven(&spacings(&filling, 0.4, lift));
    assert!(percent <= 1.0, "{percent} %");
}

#[test]
fn two_families_cross_and_keep_the_order_of_the_layers() {
    let mut pattern = drawing(vec![rectangle(-5.0, -5.0, 0.0, 5.0), rectangle(1.0, -5.0, 5.0, 5.0)]);
    pattern.layers.push(Layer { name: "SECOND".into(), color: Color::Aci(1) });
    pattern.paths[0].layer = 1;
    let filling = flat(&pattern, &options(0.5, &[45.0, 135.0]));
    let layers: Vec<usize> = filling.lines.iter().map(|line| line.layer).collect();
    assert!(layers.windows(2).all(|pair| pair[0] <= pair[1]) && layers.contains(&1));
    let rises = |line: &FillLine| {
        let along = line.drawn[line.drawn.len() - 1] - line.drawn[0];
        along.x * along.y > 0.0
    };
    assert!(filling.lines.iter().any(rises) && !filling.lines.iter().all(rises));
    assert!((filling.length * 0.5 - 2.0 * 90.0).abs() < 1.0);
}

#[test]
fn more_lines_than_can_be_marked_are_refused_before_they_are_made() {
    let pattern = drawing(vec![rectangle(-20.0, -20.0, 20.0, 20.0)]);
    let surface = surface(|_, _| 0.0);
    let map = LengthTrueMap::Plain;
    let projection =
        Projection { map: &map, surface: &surface, fixture: Fixture::default(), head: ScanHead::TELECENTRIC };
    let error = fill(&pattern, |_| true, &projection, &options(1e-4, &[0.0])).unwrap_err();
    assert!(matches!(error, FillError::TooMuch { length, .. } if length > 1e7), "{error:?}");
    let error = fill(&pattern, |_| true, &projection, &options(1e-9, &[0.0])).unwrap_err();
    assert!(matches!(error, FillError::TooMuch { .. }), "{error:?}");
}

#[test]
fn open_lines_and_contours_without_area_are_not_filled() {
    let open = |points: &[[f64; 2]]| match contour(points).shape {
        Shape::Closed(mut sides) => {
            sides.pop();
            path(Shape::Open(sides))
        }
        other => path(other),
    };
    let lines = drawing(vec![
        open(&[[0.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 0.3]]),
        open(&[[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]]),
        contour(&[[0.0, 0.0], [3.0, 0.0]]),
        path(Shape::Dot(FlatPoint::new(1.0, 1.0))),
    ]);
    let surface = surface(|_, _| 0.0);
    let map = LengthTrueMap::Plain;
    let projection =
        Projection { map: &map, surface: &surface, fixture: Fixture::default(), head: ScanHead::TELECENTRIC };
    assert_eq!(fill(&lines, |_| true, &projection, &options(0.1, &[0.0])), Ok(None));
    let found = open_lines(&lines, |_| true);
    assert_eq!(found.len(), 2);
    assert!((found[0].gap - 0.3).abs() < 1e-12);
    assert!(open_lines(&lines, |_| false).is_empty());
}

fn of_region(path: Path, region: u32) -> Path {
    Path { region: Some(region), ..path }
}

#[test]
fn letters_in_a_filled_frame_stay_unfilled() {
    let frame = rectangle(-10.0, -5.0, 10.0, 5.0);
    let (letter, hole) = (circle(0.0, 0.0, 4.0), circle(0.0, 0.0, 2.0));
    let pattern = drawing(vec![frame, of_region(letter, 3), of_region(hole, 3)]);
    let found = flat(&pattern, &options(0.1, &[0.0]));
    let expected = 200.0 - TAU / 2.0 * (16.0 - 4.0);
    assert!((found.area - expected).abs() < 0.0002 * expected, "{} of {expected} mm²", found.area);
    let lines: f64 = rows(&found).iter().map(|(_, length)| length).sum();
    assert!((lines * 0.1 - expected).abs() < 0.002 * expected, "{lines} mm of lines");
    assert_eq!(regions_in_outlines(&pattern, |_| true), [FlatPoint::new(4.0, 0.0)]);
    // Beside the frame, and inside two frames of which the inner one is a hole.
    let beside = drawing(vec![rectangle(-10.0, -5.0, 10.0, 5.0), of_region(circle(0.0, 8.0, 2.0), 3)]);
    assert!(regions_in_outlines(&beside, |_| true).is_empty());
    let twice = [rectangle(-10.0, -6.0, 10.0, 6.0), rectangle(-9.0, -5.0, 9.0, 5.0)];
    let in_hole = drawing([twice.to_vec(), vec![of_region(circle(0.0, 0.0, 2.0), 3)]].concat());
    assert!(regions_in_outlines(&in_hole, |_| true).is_empty());
}

#[test]
fn an_outline_that_repeats_the_boundary_of_a_region_changes_nothing() {
    let (outer, inner) = (circle(1.0, 2.0, 8.0), circle(1.0, 2.0, 3.0));
    let ring = [of_region(outer.clone(), 1), of_region(inner.clone(), 1)];
    let alone = flat(&drawing(ring.to_vec()), &options(0.1, &[0.0]));
    for outlines in [vec![inner.clone()], vec![outer.clone()], vec![outer, inner]] {
        let found = flat(&drawing([ring.to_vec(), outlines].concat()), &options(0.1, &[0.0]));
        assert!((found.area - alone.area).abs() < 1e-9, "{} and {} mm²", found.area, alone.area);
        let pairs = rows(&found).into_iter().zip(rows(&alone));
        assert!(found.lines.len() == alone.lines.len());
        assert!(pairs.into_iter().all(|((_, one), (_, other))| (one - other).abs() < 1e-6));
    }
}

#[test]
fn outlines_round_regions_that_nearly_fill_them_are_lines() {
    // Two adjoining hatches in a frame, a hatch a little smaller than its outline, and one of a ring.
    let half = |left: f64, right: f64, region| of_region(rectangle(left, -5.0, right, 5.0), region);
    let halves = vec![rectangle(-10.0, -5.0, 10.0, 5.0), half(-10.0, 0.0, 1), half(0.0, 10.0, 2)];
    let inset = vec![rectangle(-10.0, -5.0, 10.0, 5.0), of_region(rectangle(-9.8, -4.8, 9.8, 4.8), 1)];
    let ring = vec![
        circle(0.0, 0.0, 8.0),
        circle(0.0, 0.0, 6.0),
        of_region(circle(0.0, 0.0, 7.9), 1),
        of_region(circle(0.0, 0.0, 6.1), 1),
    ];
    for (paths, expected) in
        [(halves, 200.0), (inset, 19.6 * 9.6), (ring, TAU / 2.0 * (7.9f64.powi(2) - 6.1f64.powi(2)))]
    {
        let pattern = drawing(paths);
        let found = flat(&pattern, &options(0.1, &[0.0]));
        assert!((found.area - expected).abs() < 0.002 * expected, "{} of {expected} mm²", found.area);
        let lines: f64 = rows(&found).iter().map(|(_, length)| length).sum();
        assert!((lines * 0.1 - expected).abs() < 0.01 * expected, "{lines} mm of lines for {expected} mm²");
        assert!(regions_in_outlines(&pattern, |_| true).is_empty());
    }
}

#[test]
fn outlines_in_the_holes_of_hatches_are_filled_whatever_frames_the_hatch() {
    let round = |radius| circle(0.0, 0.0, radius);
    let hatch = vec![of_region(round(8.0), 1), of_region(round(6.0), 1)];
    let ring = 64.0 - 36.0;
    for frame in [vec![], vec![round(8.0)], vec![round(8.2)], vec![round(8.2), round(5.9)]] {
        // An outline; a ring of two outlines; an outline that frames a hatch in the hole.
        let framed = vec![round(4.1), of_region(round(4.0), 2)];
        for (in_hole, squares) in
            [(vec![round(4.0)], 16.0), (vec![round(4.0), round(2.0)], 12.0), (framed, 16.0), (vec![], 0.0)]
        {
            let pattern = drawing([frame.clone(), hatch.clone(), in_hole].concat());
            let found = flat(&pattern, &options(0.1, &[0.0]));
            let expected = TAU / 2.0 * (ring + squares);
            assert!((found.area - expected).abs() < 0.002 * expected, "{} of {expected} mm²", found.area);
            assert!(regions_in_outlines(&pattern, |_| true).is_empty());
        }
    }
}

#[test]
fn ten_thousand_framed_hatches_are_filled() {
    let at = |index: u32| [f64::from(index % 100), f64::from(index / 100)];
    let pair = |index: u32| {
        let [x, y] = at(index);
        [
            rectangle(x, y, x + 0.8, y + 0.8),
            of_region(rectangle(x + 0.02, y + 0.02, x + 0.78, y + 0.78), index),
        ]
    };
    let mut layers = layers_of(&drawing((0..10_000).flat_map(pair).collect()), |_| true);
    let (_, outlines) = layers.remove(0);
    assert_eq!(outlines.len(), 10_000);
    assert!(outlines.iter().all(|outline| outline.region.is_some()));
}

#[test]
fn the_area_of_a_periodic_drawing_is_right() {
    // Lines of 3 µm, 20 µm apart, and a bar: in step with evenly spaced rows.
    let strips = (0..1024).map(|index| {
        let low = f64::from(index) * 0.02;
        rectangle(-5.0, low, 5.0, low + 0.003)
    });
    let pattern = drawing(strips.chain([rectangle(6.0, 0.0, 7.0, 20.48)]).collect());
    let found = flat(&pattern, &options(0.5, &[90.0]));
    let expected = 1024.0 * 10.0 * 0.003 + 20.48;
    assert!((found.area / expected - 1.0).abs() < 0.001, "{} of {expected} mm²", found.area);
}
