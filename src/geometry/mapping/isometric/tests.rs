use super::*;
use crate::geometry::ink::Piece;

/// z = f(x, y) over ±40 mm, interpolated to fourth order.
fn graph(height: impl Fn(f64, f64) -> f64) -> NurbsSurface {
    let knots = UniformKnots::new(-40.0, 0.5, 160);
    let count = knots.control_points();
    let mut heights = Vec::with_capacity(count * count);
    for index in 0..count * count {
        let (x, y) = (knots.greville(index % count), knots.greville(index / count));
        let round = height(x + 0.5, y) + height(x - 0.5, y) + height(x, y + 0.5) + height(x, y - 0.5);
        heights.push(height(x, y) - (round - 4.0 * height(x, y)) / 6.0);
    }
    NurbsSurface::new(knots, knots, heights).unwrap()
}

/// Lines along the sides of a rectangle centred on the origin.
fn frame(width: f64, height: f64) -> Ink {
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        .map(|[x, y]| FlatPoint::new(x * width, y * height));
    let side = |side: usize| {
        let (from, to) = (corners[side], corners[(side + 1) % 4]);
        (0..40).map(move |part| Piece {
            from: from.lerp(to, f64::from(part) / 40.0),
            to: from.lerp(to, f64::from(part + 1) / 40.0),
        })
    };
    let extents = Extents::of(corners.map(FlatPoint::coords));
    Ink {
        pieces: (0..4).flat_map(side).collect(),
        dots: Vec::new(),
        squares: Vec::new(),
        blocks: Vec::new(),
        side: 0.4,
        inked_area: 0.0,
        extents,
    }
}

const MIDDLE: FlatPoint = FlatPoint::new(0.0, 0.0);

fn energy(map: &IsometricMap, task: &Task) -> f64 {
    map.energy(task, &mut Strains::default(), &InTurn)
}

#[test]
fn derivatives_match_differences_of_the_energy() {
    let surface = graph(|x, y| (900.0 - x * x - y * y).max(0.0).sqrt());
    let ink = frame(30.0, 20.0);
    let mut map = IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::INK).unwrap();
    let samples = map.samples(&ink, &Weights::START, FINE);
    let task = Task { surface: &surface, samples: &samples, anchor: MIDDLE, cap: Cap(0.01) };
    // The slope of the energy along a random shift is −2 times the right-hand side times the shift.
    let (columns, rows) = (map.knots_s.control_points(), map.knots_t.control_points());
    let shift: Vec<[f64; 2]> =
        (0..columns * rows).map(|index| [(index as f64).sin(), (index as f64 * 1.7).cos()]).collect();
    let mut strains = Strains::default();
    map.energy(&task, &mut strains, &InTurn);
    let equations = equations(&map, MIDDLE, &samples, &strains, &task.cap, &InTurn);
    let expected = -2.0 * equations.gain(&shift);
    let start = map.control.clone();
    let mut energy_at = |length: f64| {
        for (point, (old, shift)) in map.control.iter_mut().zip(start.iter().zip(&shift)) {
            *point = old + Vector2::from(*shift) * length;
        }
        energy(&map, &task)
    };
    let found = (energy_at(1e-6) - energy_at(-1e-6)) / 2e-6;
    assert!((found / expected - 1.0).abs() < 1e-5, "{found} for {expected}");
}

#[test]
fn halving_the_cells_does_not_change_the_map() {
    let surface = graph(|x, y| (x * x - y * y) / 60.0);
    let mut map = IsometricMap::solve(&surface, &frame(30.0, 12.0), MIDDLE, &IsometricOptions::INK).unwrap();
    let places = [[-15.0, -6.0], [3.3, 1.7], [14.9, 5.9]].map(|[x, y]| FlatPoint::new(x, y));
    let before = places.map(|place| map.point(place));
    map.refine();
    for (place, before) in places.into_iter().zip(before) {
        assert!(map.point(place).distance(before) < 1e-12);
    }
}

#[test]
fn on_a_developable_surface_the_start_is_already_the_solution() {
    let surface = graph(|x, _| (900.0 - x * x).max(0.0).sqrt());
    let map = IsometricMap::solve(&surface, &frame(40.0, 12.0), MIDDLE, &IsometricOptions::UNIFORM).unwrap();
    assert!(map.iterations[0].energy < 1e-5 && map.iterations.len() <= 3, "{:?}", map.iterations);
    let end = map.point(FlatPoint::new(20.0, 0.0));
    assert!((end.x - 30.0 * (20.0f64 / 30.0).sin()).abs() < 1e-3, "{end:?}");
}

/// A barrel, which does not change when it is turned about the y axis. Its radius at y is 36 − y²/`bulge` + y³/4000 mm.
fn barrel(bulge: f64) -> NurbsSurface {
    let radius = |y: f64| 36.0 - y * y / bulge + y * y * y / 4000.0;
    graph(|x, y| (radius(y).powi(2) - x * x).max(0.0).sqrt())
}

fn frame_at(width: f64, height: f64, center: FlatPoint) -> Ink {
    let mut ink = frame(width, height);
    for piece in &mut ink.pieces {
        (piece.from, piece.to) = (piece.from + center.coords(), piece.to + center.coords());
    }
    ink.extents = Extents::of(ink.pieces.iter().map(|piece| piece.from.coords()));
    ink
}

/// Paper holds a drawing far from its anchor so weakly that a step turns it by more than the linearised strains bear.
#[test]
fn lines_far_from_the_anchor_are_as_true_as_near_it() {
    let surface = barrel(160.0);
    for aside in [-14.0, -17.0, -20.0] {
        let center = FlatPoint::new(aside, -18.0);
        let ink = frame_at(14.0, 30.0, center);
        let errors = [MIDDLE, center].map(|anchor| {
            let map = IsometricMap::solve(&surface, &ink, anchor, &IsometricOptions::INK).unwrap();
            assert!(map.settled, "{aside}");
            map.left(Figure::Lengths, &surface, &ink)
        });
        assert!(errors[0] < 1.5 * errors[1], "{errors:?}");
    }
}

/// Even strains hardly determine how a drawing beside its anchor turns, or a step that gains next to nothing.
#[test]
fn even_maps_of_drawings_beside_their_anchor_are_found() {
    for (bulge, height, center) in
        [(160.0, 25.0, [-17.0, -20.0]), (160.0, 33.0, [-17.0, -20.0]), (4000.0, 33.0, [14.0, 20.0])]
    {
        let ink = frame_at(14.0, height, FlatPoint::new(center[0], center[1]));
        let map = IsometricMap::solve(&barrel(bulge), &ink, MIDDLE, &IsometricOptions::UNIFORM).unwrap();
        assert!(map.settled, "{bulge} {height}: {:?}", map.iterations);
    }
}

#[test]
fn a_fold_is_detected_only_where_there_is_ink() {
    let surface = graph(|_, _| 0.0);
    let ink = frame(30.0, 12.0);
    let mut map = IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::UNIFORM).unwrap();
    assert_eq!(map.fold(&surface, &ink), None);
    // Swap the middle control points.
    let columns = map.knots_s.control_points();
    let middle = (map.knots_t.control_points() / 2) * columns + columns / 2;
    map.control.swap(middle, middle + 2);
    assert!(map.fold(&surface, &ink).is_some());
    // A drawing without ink at the fold is accepted.
    let aside = Ink { pieces: ink.pieces.into_iter().filter(|piece| piece.to.x < -10.0).collect(), ..ink };
    assert_eq!(map.fold(&surface, &aside), None);
}

#[test]
fn a_spike_under_the_drawing_gives_a_valid_map_or_an_error() {
    for (height, width) in [(4.0, 2.0), (10.0, 1.5), (30.0, 3.0), (-20.0, 1.0)] {
        let surface = graph(|x, y| height * (-((x - 4.0).powi(2) + y * y) / (width * width)).exp());
        let ink = frame(30.0, 12.0);
        match IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::INK) {
            Ok(map) => assert_eq!(map.fold(&surface, &ink), None),
            Err(error) => {
                assert!(matches!(error, IsometricError::Folded { .. } | IsometricError::NotConverged { .. }));
            }
        }
    }
}

#[test]
fn a_drawing_beyond_the_horizon_terminates_with_a_finite_map_or_an_error() {
    // A line of 200 mm would reach once round a sphere of radius 30 mm; the surface is flat beyond 28 mm.
    let surface = graph(|x, y| (900.0 - x * x - y * y).max(100.0).sqrt());
    for width in [80.0, 200.0] {
        let found = IsometricMap::solve(&surface, &frame(width, 12.0), MIDDLE, &IsometricOptions::INK);
        if let Ok(map) = found {
            let end = map.point(FlatPoint::new(width / 2.0, 0.0));
            assert!(end.is_finite() && end.x.abs() < width);
        }
    }
}

/// Wavy circles about the origin, in many pieces.
fn circles(pieces: usize) -> Ink {
    let circle = |circle: usize| {
        let point = move |step: usize| {
            let angle = std::f64::consts::TAU * step as f64 / pieces as f64;
            let radius = (2.0 + 0.9 * circle as f64) * (1.0 + 0.1 * (7.0 * angle).sin());
            FlatPoint::new(radius * angle.cos(), 0.6 * radius * angle.sin())
        };
        (0..pieces).map(move |step| Piece { from: point(step), to: point(step + 1) })
    };
    let pieces: Vec<Piece> = (0..15).flat_map(circle).collect();
    let extents = Extents::of(pieces.iter().map(|piece| piece.from.coords()));
    Ink {
        pieces,
        dots: Vec::new(),
        squares: Vec::new(),
        blocks: Vec::new(),
        side: 0.4,
        inked_area: 0.0,
        extents,
    }
}

#[test]
fn gathered_lines_have_the_energy_of_their_pieces() {
    let surface = graph(|x, y| (900.0 - x * x - y * y).max(0.0).sqrt());
    let ink = circles(600);
    assert!(ink.pieces.len() > FINE.most_places);
    let map = IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::INK).unwrap();
    let energy = |most_places: usize| {
        let samples = map.samples(&ink, &Weights::START, Fineness { most_places, ..FINE });
        let task = Task { surface: &surface, samples: &samples, anchor: MIDDLE, cap: Cap(0.01) };
        energy(&map, &task)
    };
    let (gathered, each) = (energy(FINE.most_places), energy(usize::MAX));
    assert!((gathered / each - 1.0).abs() < 0.01, "{gathered} for {each}");
}

#[test]
fn a_line_has_the_same_weight_in_any_number_of_pieces() {
    let surface = graph(|x, y| (900.0 - x * x - y * y).max(0.0).sqrt());
    let [few, many] = [180, 1200].map(|pieces| {
        IsometricMap::solve(&surface, &circles(pieces), MIDDLE, &IsometricOptions::INK).unwrap()
    });
    for at in [[0.0, 8.0], [-12.0, 3.0], [9.0, -5.0]].map(|[x, y]| FlatPoint::new(x, y)) {
        let apart = few.point(at).distance(many.point(at));
        // The cells between the lines are found in squares of 0.4 mm, which the ends of pieces move a little.
        assert!(apart < 0.02, "{apart} mm at {at:?}");
    }
}

/// The places at which paper is sampled must see every pattern of control points, also the one that changes its sign from each
/// point to the next.
#[test]
fn paper_resists_every_pattern_of_control_points() {
    let surface = graph(|_, _| 0.0);
    let ink = frame(30.0, 20.0);
    let mut map = IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::INK).unwrap();
    let samples = map.samples(&ink, &Weights::EVEN, FINE);
    let task = Task { surface: &surface, samples: &samples, anchor: MIDDLE, cap: Cap::NONE };
    let (columns, start) = (map.knots_s.control_points(), map.control.clone());
    let flat = energy(&map, &task);
    let patterns: [fn(usize, usize) -> bool; 5] = [
        |column, row| (column + row) % 2 == 0,
        |column, _| column % 2 == 0,
        |_, row| row % 2 == 0,
        |column, row| (column / 2 + row / 2) % 2 == 0,
        |column, row| column % 2 == 0 && row % 2 == 0,
    ];
    for pattern in patterns {
        for axis in [Vector2::x(), Vector2::y()] {
            for (index, (point, start)) in map.control.iter_mut().zip(&start).enumerate() {
                let sign = if pattern(index % columns, index / columns) { 1.0 } else { -1.0 };
                *point = start + axis * (0.1 * sign);
            }
            let energy = energy(&map, &task);
            // A strain of 0.1 mm over a cell of 1.5 mm, weakened by the spline.
            assert!(energy > flat + 1e-5, "{energy:.2e} beside {flat:.2e}");
        }
    }
}

#[test]
fn the_bound_for_the_area_of_a_cell_is_below_all_areas_in_it() {
    let surface = graph(|x, y| (900.0 - x * x - y * y).max(0.0).sqrt());
    let ink = frame(34.0, 20.0);
    let mut map = IsometricMap::solve(&surface, &ink, MIDDLE, &IsometricOptions::INK).unwrap();
    // Also for a map that is the less even the farther up, and folded there.
    let count = map.control.len() as f64;
    for (index, point) in map.control.iter_mut().enumerate() {
        let index = index as f64;
        *point += Vector2::new((index * 1.3).sin(), (index * 0.7).cos()) * (1.5 * index / count);
    }
    let (mut passed, mut folded) = (0, 0);
    for row in 0..map.knots_t.spans() {
        for column in 0..map.knots_s.spans() {
            let bound = map.smallest_area(row, column);
            passed += usize::from(bound > 0.05);
            for (u, v) in (0..100).map(|place| (f64::from(place % 10) / 9.0, f64::from(place / 10) / 9.0)) {
                let s =
                    map.knots_s.start() + map.knots_s.step() * (column as f64 + u.clamp(1e-9, 1.0 - 1e-9));
                let t = map.knots_t.start() + map.knots_t.step() * (row as f64 + v.clamp(1e-9, 1.0 - 1e-9));
                let sample = Sample::at(map.knots_s.basis(s), map.knots_t.basis(t));
                let [_, by_s, by_t] = map.image(&sample);
                let area = by_s.perp(&by_t);
                folded += usize::from(area < 0.0);
                assert!(area >= bound - 1e-12, "{area} in a cell that keeps {bound}");
                assert!(map.strain_only(&surface, &sample).area() >= area || area < 0.0);
            }
        }
    }
    assert!(passed > 0 && folded > 0, "{passed} cells cannot fold, {folded} places are folded");
}
