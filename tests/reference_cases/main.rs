//! The maps on the reference cases: surfaces given by formulas. Results are measured on the formula, not on our fit.
//!
//! The reference values come from independent computations (numpy, libigl, CGAL) on the same cases: letters of 39 ×
//! 13 mm, meshes with edges of 0.75 mm without normals, e_l over pieces of at most 0.25 mm, e_a over squares of 0.2
//! mm, the largest angular distortion over both. `cargo test --test reference_cases -- --nocapture --test-threads 1`
//! prints the table of all results.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]
#![allow(clippy::print_stdout, reason = "prints the table of results")]

mod developables;
mod drawings;
mod every_surface;
mod far_round;
mod floors;
mod springs;

use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::ink::Ink;
use isomark::geometry::mapping::isometric::{IsometricMap, IsometricOptions};
use isomark::geometry::mapping::quality::{self, Distortion};
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};

use self::drawings::{disc, filled_ring, letters, net, open_ring, open_rings, outline, rings, square};

/// Two or three steps on the coarse grid, and at most eight rounds on the fine one.
const MOST_STEPS: usize = 11;
/// Where large areas leave no gain below the limit of the angle errors, the rounds are tried three times.
const MOST_STEPS_OF_AREAS: usize = 27;
const UNIFORM: Method = Method::Isometric(IsometricOptions::UNIFORM);
const INK: Method = Method::Isometric(IsometricOptions::INK);
const AUTOMATIC: Method =
    Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };

/// A surface with the place of the drawing on it.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    height: fn(f64, f64) -> f64,
    place: [f64; 2],
}

const fn case(name: &'static str, height: fn(f64, f64) -> f64, place: [f64; 2]) -> Case {
    Case { name, height, place }
}

const SPHERE: Case = case("sphere", shapes::sphere, [0.0, 0.0]);
const MANDARIN: Case = case("mandarin", shapes::mandarin, [0.0, 3.0]);
const MOUSE: Case = case("mouse", shapes::mouse, [0.0, 8.0]);
const CYLINDER: Case = case("cylinder", shapes::cylinder, [0.0, 0.0]);
const CONE: Case = case("cone", shapes::cone, [0.0, 0.0]);

impl Case {
    fn anchor(&self) -> FlatPoint {
        FlatPoint::new(self.place[0], self.place[1])
    }

    /// The surface from a mesh with edges of 0.75 mm over a disc of `radius` mm.
    fn surface(&self, radius: f64) -> FittedSurface {
        fitted(&shapes::graph(radius, 0.75, self.height))
    }

    /// The drawing, centred on the origin, at its place.
    fn placed(&self, drawing: &Pattern) -> Pattern {
        drawing.transformed(&Affine::rigid(FlatPoint::new(0.0, 0.0), 0.0, self.anchor()))
    }

    /// The results for a drawing on the true surface, and the map.
    fn judged(&self, surface: &FittedSurface, drawing: &Pattern, method: &Method) -> Judged {
        let placed = self.placed(drawing);
        let map = LengthTrueMap::find(surface, &placed, |_| true, self.anchor(), method).unwrap();
        let figures = self.measured(&placed, |at| map.point(at));
        let squares = Ink { pieces: Vec::new(), ..fine_ink(&placed) };
        let over_squares = self.measure(&squares, |at| map.point(at)).max_angle_error.to_degrees();
        Judged { figures, over_squares, map }
    }

    /// The results for any map of the placed drawing.
    fn measured(&self, placed: &Pattern, map: impl Fn(FlatPoint) -> ViewPoint) -> Distortion {
        self.measure(&fine_ink(placed), map)
    }

    fn measure(&self, ink: &Ink, map: impl Fn(FlatPoint) -> ViewPoint) -> Distortion {
        quality::measure(ink, map, |at: ViewPoint| Some((self.height)(at.x, at.y))).unwrap()
    }
}

fn fitted(mesh: &TriMesh) -> FittedSurface {
    FittedSurface::of_part(&FacingPart::new(mesh, &View::top()), &FitOptions::default()).unwrap()
}

fn fine_ink(placed: &Pattern) -> Ink {
    quality::sample(placed, |_| true)
}

struct Judged {
    figures: Distortion,
    /// The largest angle error over only the inked squares, as in the reference values, degrees.
    over_squares: f64,
    map: LengthTrueMap,
}

impl std::fmt::Debug for Judged {
    /// The results without the hundreds of control points.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let steps = match &self.map {
            LengthTrueMap::Isometric(map) => map.iterations.clone(),
            _ => Vec::new(),
        };
        write!(out, "{:?}, over squares {:.3}°, {steps:?}", self.figures, self.over_squares)
    }
}

impl Judged {
    fn length_error(&self) -> f64 {
        self.figures.length_error
    }

    fn area_error(&self) -> f64 {
        self.figures.area_error
    }

    /// The largest angle error over squares and along lines, degrees.
    fn angle(&self) -> f64 {
        self.figures.max_angle_error.to_degrees()
    }

    fn isometric(&self) -> &IsometricMap {
        let LengthTrueMap::Isometric(map) = &self.map else { panic!("an isometric map") };
        map
    }

    fn print(&self, case: &str, drawing: &str, method: &str) {
        let steps = match &self.map {
            LengthTrueMap::Isometric(map) => format!("{} steps", map.iterations.len()),
            _ => String::new(),
        };
        println!(
            "{case:14} {drawing:8} {method:9} e_l {:8.4} mm  e_a {:8.4} mm²  angle {:6.3}° (squares {:6.3}°)  {steps}",
            self.length_error(),
            self.area_error(),
            self.angle(),
            self.over_squares,
        );
    }
}

/// The letters on a case, with a mesh that ends where the surface becomes steep.
fn letters_on(case: Case, method: &Method) -> Judged {
    case.judged(&case.surface(28.5), &letters(), method)
}

#[test]
fn the_measurement_of_plain_projection_matches_the_reference() {
    // e_l, e_a and angle of the uncorrected letters.
    for (case, [length, area, angle]) in
        [(SPHERE, [9.03, 13.3, f64::NAN]), (MANDARIN, [5.45, 8.21, 12.5]), (MOUSE, [6.83, 10.0, 17.2])]
    {
        let found = letters_on(case, &Method::Plain);
        assert!((found.length_error() / length - 1.0).abs() < 0.005, "{found:?}");
        assert!((found.area_error() / area - 1.0).abs() < 0.005, "{found:?}");
        assert!(angle.is_nan() || (found.over_squares / angle - 1.0).abs() < 0.005, "{found:?}");
    }
}

#[test]
fn uniform_weighting_reaches_the_reference_within_five_percent() {
    for (case, [length, area, angle]) in
        [(SPHERE, [0.56, 0.40, 1.05]), (MANDARIN, [0.35, 0.24, 0.66]), (MOUSE, [0.111, 0.079, 0.20])]
    {
        let found = letters_on(case, &UNIFORM);
        assert!(found.length_error() < length * 1.05, "{found:?}");
        assert!(found.area_error() < area * 1.05, "{found:?}");
        assert!(found.over_squares < angle * 1.05, "{found:?}");
    }
}

#[test]
fn ink_weighting_beats_all_known_results_in_lengths_areas_and_angles() {
    // For each case, the best map of an ink-weighted fit with cells of 2 mm and shape weight 1, then LSCM, ARAP and
    // SLIM on the pattern's neighbourhood (their angles on the sphere are not known): e_l, e_a, angle over squares.
    const UNKNOWN: f64 = f64::INFINITY;
    let rows = [
        (SPHERE, [[0.198, 0.065, 0.79], [1.21, 1.59, UNKNOWN], [0.70, 1.29, UNKNOWN], [0.69, 1.25, UNKNOWN]]),
        (MANDARIN, [[0.125, 0.040, 0.51], [0.91, 1.18, 0.6], [0.48, 0.84, 0.85], [0.48, 0.83, 0.84]]),
        (MOUSE, [[0.041, 0.013, 0.17], [0.50, 0.64, 0.7], [0.25, 0.38, 0.9], [0.26, 0.38, 0.9]]),
    ];
    for (case, rows) in rows {
        let found = letters_on(case, &INK);
        for [length, area, angle] in rows {
            assert!(found.length_error() < 0.75 * length, "{found:?}");
            assert!(found.area_error() < 0.5 * area, "{found:?}");
            // The reference values do not include the angle along the lines; here it is included.
            assert!(found.angle() < 0.7 * angle && found.over_squares < 0.7 * angle, "{found:?}");
        }
        let image = found.map.point(case.anchor()).coords();
        assert!((image - case.anchor().coords()).norm() < 1e-6, "the anchor keeps its place");
        assert!(found.isometric().settled && found.isometric().iterations.len() <= MOST_STEPS);
    }
}

#[test]
fn letters_are_as_true_as_the_best_known_fit() {
    // A prototype in numpy with the same kind of weights, in at most 50 rounds: e_l, e_a, largest angle error.
    let rows =
        [(SPHERE, [0.112, 0.012, 0.40]), (MANDARIN, [0.068, 0.008, 0.24]), (MOUSE, [0.023, 0.003, 0.075])];
    for (case, [length, area, angle]) in rows {
        let found = letters_on(case, &INK);
        assert!(found.length_error() < length, "{found:?}");
        assert!(found.area_error() < area, "{found:?}");
        assert!(found.angle() < angle && found.over_squares < angle, "{found:?}");
    }
}

/// What a map must leave on a small cap of a ball grows with the third power of its size.
#[test]
fn small_drawings_are_as_true_as_large_ones() {
    let surface = SPHERE.surface(28.5);
    for parts in [4, 12] {
        let left = |side: f64| {
            let found = SPHERE.judged(&surface, &net(side, parts), &INK);
            (found.length_error() / side.powi(3), found)
        };
        let (large, _) = left(15.0);
        for side in [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0] {
            let (small, found) = left(side);
            assert!(small < 1.2 * large, "{side} mm in {parts} parts: {small} instead of {large}, {found:?}");
        }
    }
}

/// Between the samples of a report, lines can be strained both ways; their sum must not hide it.
#[test]
fn small_drawings_are_reported_as_they_are_marked() {
    let surface = SPHERE.surface(28.5);
    for side in [1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0] {
        for parts in [4, 12] {
            let drawing = net(side, parts);
            let found = SPHERE.judged(&surface, &drawing, &INK);
            let closely = Ink::sample(&drawing, |_| true, side / 500.0, side / 500.0);
            let marked = SPHERE.measure(&closely, |at| found.map.point(at));
            let lowest = 0.99 * marked.length_error;
            assert!(
                found.length_error() > lowest,
                "{side} mm in {parts} parts: {marked:?} is reported as {found:?}"
            );
        }
    }
}

#[test]
fn each_aim_is_best_at_what_it_names() {
    let with = |options| Method::Isometric(options);
    for case in [SPHERE, MANDARIN, MOUSE] {
        let surface = case.surface(28.5);
        for drawing in [letters(), square()] {
            let judged = |options| case.judged(&surface, &drawing, &with(options));
            let balanced = judged(IsometricOptions::INK);
            let lengths = judged(IsometricOptions::LENGTHS);
            let areas = judged(IsometricOptions::AREAS);
            let shapes = judged(IsometricOptions::SHAPES);
            assert!(lengths.length_error() <= balanced.length_error(), "{lengths:?}, balanced {balanced:?}");
            assert!(areas.area_error() <= balanced.area_error(), "{areas:?}, balanced {balanced:?}");
            assert!(shapes.angle() <= 0.6 * balanced.angle(), "{shapes:?}, balanced {balanced:?}");
        }
    }
}

#[test]
fn outlines_that_nothing_fills_keep_their_lengths_with_the_aim_of_lengths() {
    let surface = SPHERE.surface(28.5);
    for drawing in [square(), disc()] {
        let judged = |drawing, options| SPHERE.judged(&surface, drawing, &Method::Isometric(options));
        let lines = outline(drawing.clone());
        let outline = judged(&lines, IsometricOptions::LENGTHS);
        let filled = judged(&drawing, IsometricOptions::LENGTHS);
        // The lines of a ring or a square can be true: areas and lengths together cannot.
        assert!(outline.length_error() < 3e-4 * outline.figures.length, "{outline:?}");
        assert!(filled.length_error() > 5e-3 * filled.figures.length, "{filled:?}");
    }
}

#[test]
fn an_open_ring_is_not_folded_at_its_gap() {
    // As it is drawn, the ring has its length on the sphere: a map without error exists.
    let surface = SPHERE.surface(28.5);
    for [radius, gap] in [[21.0f64, 10.0], [20.0, 20.0], [21.0, 30.0], [22.5, 10.0]] {
        let ring = open_ring(radius, gap.to_radians());
        for options in [IsometricOptions::INK, IsometricOptions::LENGTHS, IsometricOptions::SHAPES] {
            let found = SPHERE.judged(&surface, &ring, &Method::Isometric(options));
            assert!(
                found.length_error() < 0.01 * found.figures.length,
                "{radius} mm, {gap} degrees: {found:?}"
            );
        }
    }
}

/// The projection of a ring round the top of a sphere has its length: as they are drawn, rings are true.
#[test]
fn rings_are_as_true_with_the_aim_of_lengths_as_they_are_without_a_correction() {
    let surface = SPHERE.surface(28.5);
    let radii = |first: f64, apart: f64| (0..8u32).map(move |ring| first + apart * f64::from(ring));
    for (first, apart) in [(1.0, 1.0), (1.5, 1.5), (2.0, 2.0), (8.0, 0.5), (12.0, 0.5)] {
        let all = || radii(first, apart);
        for drawing in [rings(all()), open_rings(all(), 0.7, 0.0), open_rings(all(), 0.35, 2.0)] {
            let found = SPHERE.judged(&surface, &drawing, &Method::Isometric(IsometricOptions::LENGTHS));
            let length = found.figures.length;
            assert!(found.length_error() < 1.1e-4 * length, "{first}, {apart}: {length} mm, {found:?}");
            assert!(found.isometric().instead.is_some());
        }
    }
    // An area keeps its size as well.
    let drawing = filled_ring(14.0, 16.0);
    let found = SPHERE.judged(&surface, &drawing, &Method::Isometric(IsometricOptions::LENGTHS));
    let as_drawn = SPHERE.judged(&surface, &drawing, &Method::Plain);
    assert!(found.area_error() < 0.5 * as_drawn.area_error(), "{found:?}, as drawn {as_drawn:?}");
}

#[test]
fn the_usual_map_is_taken_where_it_is_truer_than_the_drawing_as_it_is() {
    let options =
        [IsometricOptions::INK, IsometricOptions::LENGTHS, IsometricOptions::AREAS, IsometricOptions::SHAPES];
    for case in [SPHERE, MANDARIN, MOUSE] {
        for options in options {
            assert_eq!(letters_on(case, &Method::Isometric(options)).isometric().instead, None);
        }
    }
}

#[test]
fn open_rings_close_together_are_not_treated_as_areas() {
    let surface = SPHERE.surface(28.5);
    let radii = (0..8u32).map(|ring| 12.0 + 0.5 * f64::from(ring));
    let drawing = open_rings(radii, 0.35, 2.0);
    let [ink, uniform] = [INK, UNIFORM].map(|method| SPHERE.judged(&surface, &drawing, &method));
    assert!(ink.length_error() < 0.5 * uniform.length_error(), "{ink:?}, uniform {uniform:?}");
}

#[test]
fn filled_squares_gain_as_much_as_with_weights_on_lines_and_areas_alone() {
    // Lines and areas alone, in an independent fit: e_a 3.58 mm² with an angle error of 5.91°.
    let found = SPHERE.judged(&SPHERE.surface(28.5), &square(), &INK);
    assert!(found.length_error() < 1.6 && found.area_error() < 1.0 && found.angle() < 4.16, "{found:?}");
}

#[test]
fn extra_weights_improve_lengths_or_angles() {
    for case in [SPHERE, MANDARIN, MOUSE] {
        let emphasised = |lengths, angles| {
            letters_on(case, &Method::Isometric(IsometricOptions::INK.emphasised(lengths, angles)))
        };
        let (ink, uniform) = (letters_on(case, &INK), letters_on(case, &UNIFORM));
        let (lengths, angles) = (emphasised(10.0, 1.0), emphasised(1.0, 10.0));
        assert!(lengths.length_error() < 0.8 * ink.length_error(), "{lengths:?}");
        assert!(angles.over_squares < 0.8 * ink.over_squares, "{angles:?}");
        for found in [lengths, angles, emphasised(0.1, 1.0), emphasised(1.0, 0.1), emphasised(10.0, 0.1)] {
            assert!(found.over_squares < uniform.over_squares + 0.1, "{found:?}");
            assert!(found.length_error() < uniform.length_error(), "{found:?}");
            assert!(found.isometric().settled, "{found:?}");
        }
    }
}

#[test]
fn on_a_cylinder_the_exact_map_is_chosen_and_is_exact() {
    let found = letters_on(CYLINDER, &AUTOMATIC);
    assert!(matches!(found.map, LengthTrueMap::Cylinder(..)));
    assert!(found.length_error() <= 0.001 && found.area_error() <= 0.001, "{found:?}");
}

#[test]
fn on_a_cone_the_exact_map_is_chosen_and_is_exact() {
    // Letters of 39 mm on a radius of 19 mm extend to ±58°; the mesh ends a little beyond.
    let found = letters_on(CONE, &AUTOMATIC);
    let LengthTrueMap::Cone(map, _) = &found.map else { panic!("a cone") };
    assert!((map.cone.half_angle - 0.3).abs() < 1e-4, "{:?}", map.cone);
    assert!(found.length_error() <= 0.005 && found.area_error() <= 0.005, "{found:?}");
}

#[test]
fn free_forms_are_not_treated_as_cylinders() {
    for case in [SPHERE, MANDARIN, MOUSE] {
        assert!(matches!(letters_on(case, &AUTOMATIC).map, LengthTrueMap::Isometric(_)));
    }
}
