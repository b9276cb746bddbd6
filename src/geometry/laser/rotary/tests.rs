use nalgebra::{Point3, Unit, Vector3};
use proptest::prelude::*;

use super::*;
use crate::geometry::mapping::cone::{Cone, ConeFit, ConeMap};
use crate::geometry::mapping::cylinder::{Cylinder, CylinderFit, CylinderMap};
use crate::geometry::pattern::{Color, Segment, Source};

const RADIUS: f64 = 30.0;

/// Tiles as narrow as any laser makes them, divided into as few as possible.
const AUTO: Limits = Limits { widest: 2.0, overlap: 0.0, count: None, narrowest: 0.005, gentle: 0.0 };

fn cylinder() -> Unrolled {
    let cylinder =
        Cylinder { center: Point3::new(0.0, 0.0, -RADIUS), axis: Vector3::y_axis(), radius: RADIUS };
    let map = CylinderMap::new(cylinder, FlatPoint::new(0.0, 0.0), 0.0).unwrap();
    Unrolled::of(&LengthTrueMap::Cylinder(map, CylinderFit { cylinder, residual: 0.0, is_determined: true }))
        .unwrap()
}

/// A cone with the apex 100 mm below the anchor along its generator.
fn cone(half_angle: f64) -> (Unrolled, ConeMap) {
    let axis = Unit::new_normalize(Vector3::new(0.0, half_angle.cos(), -half_angle.sin()));
    let cone = Cone { apex: Point3::new(0.0, -100.0, 0.0), axis, half_angle };
    let map = ConeMap::new(cone, FlatPoint::new(0.0, 0.0), 0.0, 10.0).unwrap();
    (
        Unrolled::of(&LengthTrueMap::Cone(map, ConeFit { cone, residual: 0.0, is_determined: true }))
            .unwrap(),
        map,
    )
}

fn path(shape: Shape, region: Option<u32>) -> Path {
    Path { layer: 0, color: Color::ByLayer, shape, region, source: Source::default() }
}

fn polyline(points: &[[f64; 2]]) -> Vec<Segment> {
    let points: Vec<FlatPoint> = points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect();
    points.windows(2).map(|ends| Segment::Line { from: ends[0], to: ends[1] }).collect()
}

fn closed(points: &[[f64; 2]]) -> Shape {
    Shape::Closed(polyline(&[points, &points[..1]].concat()))
}

/// All pieces of all tiles with cuts at these positions, mm round the axis.
fn all_tiles(paths: &[Path], unrolled: &Unrolled, cuts: &[f64], overlap: f64) -> Vec<Vec<Path>> {
    let items = items(paths, unrolled);
    let cuts: Vec<Cut> = cuts.iter().map(|at| Cut { at: at / RADIUS, is_through_ink: true }).collect();
    let tile = |number| super::tile(paths, &items, unrolled, &cuts, number, overlap / RADIUS, RADIUS);
    (0..=cuts.len()).map(tile).collect()
}

fn length(paths: &[Path]) -> f64 {
    let chords = |path: &Path| {
        let mut points = path.shape.flattened(1e-6);
        if path.shape.is_closed() {
            points.push(points[0]);
        }
        points.windows(2).map(|ends| ends[0].distance(ends[1])).sum::<f64>()
    };
    paths.iter().map(chords).sum()
}

/// The area of closed contours by the shoelace formula, those inside others with the opposite sign.
fn area(paths: &[Path]) -> f64 {
    let one = |path: &Path| {
        let points = path.shape.flattened(1e-6);
        let next = points.iter().cycle().skip(1);
        points.iter().zip(next).map(|(a, b)| a.coords().perp(&b.coords())).sum::<f64>() / 2.0
    };
    let mut areas: Vec<f64> = paths.iter().map(|path| one(path).abs()).collect();
    areas.sort_by(f64::total_cmp);
    areas.iter().sum()
}

#[test]
fn a_turn_moves_points_by_its_angle_and_keeps_lengths() {
    for unrolled in [cylinder(), cone(0.2).0, cone(0.6).0] {
        let turn = unrolled.turn(0.4);
        for [x, y] in [[0.0, 0.0], [12.0, 7.0], [-20.0, -9.0]] {
            let at = FlatPoint::new(x, y);
            let moved = turn.point(at);
            assert!((unrolled.angle(moved) - unrolled.angle(at) - 0.4).abs() < 1e-12);
            assert!((unrolled.along(moved) - unrolled.along(at)).abs() < 1e-12);
            assert!(unrolled.point(unrolled.angle(at), unrolled.along(at)).distance(at) < 1e-12);
        }
    }
}

#[test]
fn angles_on_a_cone_are_those_about_its_axis() {
    let (unrolled, map) = cone(0.3);
    let radial = |at: FlatPoint| {
        let from_apex = map.point_on_part(at) - map.cone.apex;
        (from_apex - *map.cone.axis * from_apex.dot(&map.cone.axis)).normalize()
    };
    let start = radial(FlatPoint::new(0.0, 0.0));
    for [x, y] in [[10.0, 3.0], [40.0, -20.0], [-25.0, 8.0]] {
        let at = FlatPoint::new(x, y);
        let angle = radial(at).angle(&start);
        assert!((unrolled.angle(at).abs() - angle).abs() < 1e-9, "{angle} for {:?}", unrolled.angle(at));
        assert!(unrolled.angle(at) * x > 0.0);
    }
}

#[test]
fn letters_are_never_cut_and_rings_are_cut_in_equal_tiles() {
    let limits = Limits { widest: 60f64.to_radians(), ..AUTO };
    // 36 letters of 6° with gaps of 4°.
    let letters: Vec<[f64; 2]> = (0..36)
        .map(|letter| [f64::from(10 * letter), f64::from(10 * letter + 6)].map(f64::to_radians))
        .collect();
    let found = plan(&letters, &limits).unwrap();
    assert_eq!(found.tiles.len(), 6);
    assert!(found.cuts.iter().all(|cut| !cut.is_through_ink));
    for letter in &letters {
        assert!(found.tiles.iter().any(|tile| tile[0] <= letter[0] && letter[1] <= tile[1]));
    }
    let ring = [[0.0, std::f64::consts::TAU]];
    let found = plan(&ring, &limits).unwrap();
    assert_eq!(found.tiles.len(), 7, "the sixth part of a turn leaves no room for rounding");
    for tile in &found.tiles {
        assert!((tile[1] - tile[0] - std::f64::consts::TAU / 7.0).abs() < 1e-9);
    }
    // With a ring round the letters, the cuts are still between the letters.
    let both: Vec<[f64; 2]> = letters.iter().copied().chain(ring).collect();
    let found = plan(&both, &limits).unwrap();
    assert!(found.cuts.iter().all(|cut| cut.is_through_ink));
    for cut in &found.cuts {
        assert!(letters.iter().all(|letter| cut.at <= letter[0] || cut.at >= letter[1]), "{cut:?}");
    }
}

#[test]
fn the_number_of_tiles_may_be_given() {
    let ring = [[-1.0, 5.0]];
    for count in [4, 5, 9, 40] {
        let limits = Limits { widest: 1.6, overlap: 0.01, count: Some(count), ..AUTO };
        let found = plan(&ring, &limits).unwrap();
        assert_eq!((found.tiles.len(), found.cuts.len()), (count, count - 1));
        assert!(found.tiles.iter().all(|[from, to]| to - from <= 1.6));
    }
    for (count, widest) in [(3, 1.6), (1, 5.0)] {
        assert_eq!(plan(&ring, &Limits { widest, count: Some(count), ..AUTO }), None);
    }
    // Two letters are not three tiles with ink.
    let letters = [[0.0, 0.1], [1.0, 1.1]];
    let limits = Limits { widest: 0.5, ..AUTO };
    assert_eq!(plan(&letters, &limits).unwrap().tiles, letters.to_vec());
    assert_eq!(plan(&[], &limits), None);
    assert_eq!(plan(&[[0.0, 1.0]], &Limits { overlap: 0.6, ..limits }), None);
}

fn widths(tiling: &Tiling) -> Vec<f64> {
    tiling.tiles.iter().map(|[from, to]| (to - from).to_degrees()).collect()
}

fn degrees(spans: &[[f64; 2]]) -> Vec<[f64; 2]> {
    spans.iter().map(|span| span.map(f64::to_radians)).collect()
}

#[test]
fn a_given_number_of_tiles_of_a_ring_is_even() {
    let ring = [[0.0, 360.0]];
    // Lines that end elsewhere leave no gap.
    let lines = [[0.0, 360.0], [0.5, 359.0], [17.0, 250.0], [111.0, 302.0]];
    for spans in [&ring[..], &lines] {
        for count in (4..=40).chain([100, 360]) {
            let found = plan(&degrees(spans), &Limits { count: Some(count), ..AUTO }).unwrap();
            assert_eq!(found.tiles.len(), count);
            for width in widths(&found) {
                assert!((width - 360.0 / count as f64).abs() < 0.3 / count as f64, "{count}: {width}");
            }
            assert_eq!(found.enough, None);
        }
    }
    // Three quarters of a turn, exactly at the limit of the laser.
    for count in [3, 4, 7, 11] {
        let widest = (270.0 / count as f64).to_radians();
        let limits = Limits { widest, count: Some(count), ..AUTO };
        let found = plan(&degrees(&[[20.0, 290.0]]), &limits).unwrap();
        assert!(widths(&found).iter().all(|width| (width - 270.0 / count as f64).abs() < 1e-6));
    }
}

#[test]
fn a_given_number_of_tiles_ends_in_gaps_near_the_even_borders() {
    // Twelve letters of 14° with gaps of 16°, with and without lines round the part.
    let letters: Vec<[f64; 2]> =
        (0..12).map(|number| [8.0 + 30.0 * f64::from(number), 22.0 + 30.0 * f64::from(number)]).collect();
    let lines = [[0.0, 360.0], [35.0, 209.0], [226.0, 313.0]];
    let with_lines: Vec<[f64; 2]> = letters.iter().copied().chain(lines).collect();
    let is_whole = |found: &Tiling| {
        found.cuts.iter().all(|cut| {
            letters.iter().all(|[from, to]| cut.at.to_degrees() <= *from || cut.at.to_degrees() >= *to)
        })
    };
    for count in 4..=12 {
        let limits = Limits { count: Some(count), gentle: 60f64.to_radians(), ..AUTO };
        let even = 360.0 / count as f64;
        let found = plan(&degrees(&with_lines), &limits).unwrap();
        let widths = widths(&found);
        assert!(is_whole(&found), "{count}: {found:?}");
        // In eleven tiles, one has two letters, which are 44° wide.
        let widest = (even * 4.0 / 3.0).max(if count < 12 { 44.001 } else { 0.0 });
        assert!(widths.iter().all(|width| *width >= 0.4 * even && *width <= widest), "{widths:?}");
        if 12 % count == 0 {
            assert!(widths.iter().all(|width| (width - even).abs() < 1e-6), "{widths:?}");
        }
        // Every tile has whole letters: as many as the most even division of twelve has.
        let found = plan(&degrees(&letters), &limits).unwrap();
        let most = 12usize.div_ceil(count);
        let widest = self::widths(&found).into_iter().fold(0.0, f64::max);
        assert!((widest - (30.0 * most as f64 - 16.0)).abs() < 1e-6, "{count}: {found:?}");
        assert_eq!(found.cuts.iter().filter(|cut| cut.is_through_ink).count(), 0);
    }
    // Halves of letters are narrower tiles, and a thirteenth tile is not.
    let given = |count| plan(&degrees(&letters), &Limits { count: Some(count), ..AUTO }).unwrap();
    assert!(widths(&given(24)).iter().all(|width| (width - 7.0).abs() < 1e-6));
    assert_eq!((given(24).enough, given(13).enough), (None, Some(12)));
}

#[test]
fn short_strokes_without_gaps_are_divided_evenly() {
    // Multiples of two irrational numbers spread 6000 strokes of up to 2° over the turn: about 17 at every angle.
    let strokes: Vec<[f64; 2]> = (0..6000)
        .map(|number| {
            let share = |step: f64| (f64::from(number) * step).fract();
            let from = 358.0 * share(0.618_033_988_749_895);
            [from, from + 2.0 * share(0.754_877_666_246_693)]
        })
        .collect();
    for count in [4, 9, 16] {
        let found = plan(&degrees(&strokes), &Limits { count: Some(count), ..AUTO }).unwrap();
        let even = 360.0 / count as f64;
        assert!(widths(&found).iter().all(|width| (width / even - 1.0).abs() < 0.02), "{:?}", widths(&found));
    }
}

#[test]
fn tiles_are_not_much_wider_for_the_sake_of_whole_letters() {
    // Eight letters of 40° with gaps of 4°: in seven tiles, two of them are 84° wide.
    let letters: Vec<[f64; 2]> =
        (0..8).map(|number| [0.0, 40.0].map(|at| at + 44.0 * f64::from(number))).collect();
    let given = |gentle: f64| {
        let limits = Limits { count: Some(7), gentle: gentle.to_radians(), ..AUTO };
        let found = plan(&degrees(&letters), &limits).unwrap();
        (
            widths(&found).into_iter().fold(0.0, f64::max),
            found.cuts.iter().filter(|cut| cut.is_through_ink).count(),
        )
    };
    let (widest, cut) = given(60.0);
    assert!(widest <= 352.0 / 7.0 * 4.0 / 3.0 && cut > 0, "{widest}");
    let (widest, cut) = given(90.0);
    assert!((widest - 84.0).abs() < 1e-6 && cut == 0, "{widest}");
}

#[test]
fn the_possible_numbers_of_tiles_have_both_ends() {
    let ring = degrees(&[[0.0, 90.0]]);
    let limits = Limits { widest: 50f64.to_radians(), narrowest: 0.5f64.to_radians(), ..AUTO };
    assert_eq!(counts(&ring, &limits), Some(2..=180));
    // Neighbours of a tile do not overlap in it.
    let overlapping = Limits { overlap: 5f64.to_radians(), ..limits };
    assert_eq!(counts(&ring, &overlapping), Some(2..=9));
    let dots = [[0.0, 0.0], [0.3, 0.3], [0.31, 0.31]];
    assert_eq!(counts(&dots, &limits), Some(1..=3));
    assert_eq!(counts(&[], &limits), None);
    for (spans, limits) in [(&ring[..], limits), (&ring, overlapping), (&dots, limits)] {
        let possible = counts(spans, &limits).unwrap();
        for count in 1..=possible.end() + 2 {
            let found = plan(spans, &Limits { count: Some(count), ..limits });
            assert_eq!(found.map(|found| found.tiles.len()), possible.contains(&count).then_some(count));
        }
    }
}

#[test]
fn as_few_tiles_as_possible_are_no_slivers() {
    // The second line is 1° shorter at both ends: borders there cut one line instead of two.
    let lines = degrees(&[[0.0, 360.0], [1.0, 359.0]]);
    let found = plan(&lines, &Limits { widest: 60f64.to_radians(), ..AUTO }).unwrap();
    assert!(widths(&found).iter().all(|width| (width - 360.0 / 7.0).abs() < 1e-6), "{found:?}");
}

#[test]
fn cut_lines_join_to_the_same_point() {
    let arc = Segment::Arc {
        center: FlatPoint::new(0.0, 0.0),
        u: Vector2::new(12.0, 0.0),
        v: Vector2::new(0.0, 7.0),
        start: 0.4,
        sweep: std::f64::consts::TAU,
    };
    let curve = Segment::Bezier {
        points: [[-15.0, 0.0], [40.0, 12.0], [-40.0, -12.0], [16.0, 2.0]].map(|[x, y]| FlatPoint::new(x, y)),
        weights: [1.0, 0.7, 1.6, 1.0],
    };
    let unrolled = cylinder();
    for shape in [
        Shape::Open(polyline(&[[-20.0, 3.0], [20.0, -4.0]])),
        Shape::Open(polyline(&[[-20.0, 3.0], [3.0, -4.0], [1.0, 5.0], [20.0, 6.0]])),
        Shape::Closed(vec![arc]),
        Shape::Open(vec![curve]),
        closed(&[[-10.0, -5.0], [10.0, -5.0], [2.0, 0.0], [10.0, 5.0], [-10.0, 5.0]]),
    ] {
        let paths = [path(shape, None)];
        let tiles = all_tiles(&paths, &unrolled, &[-4.0, 2.0], 0.0);
        let pieces = tiles.concat();
        assert!(pieces.iter().all(|piece| !piece.shape.is_closed()));
        assert!((length(&pieces) - length(&paths)).abs() < 1e-4, "{pieces:?}");
        // Every end at a cut is the end of another piece.
        let ends: Vec<FlatPoint> = pieces
            .iter()
            .flat_map(|piece| {
                [piece.shape.segments()[0].start(), piece.shape.segments().last().unwrap().end()]
            })
            .collect();
        let original =
            [paths[0].shape.segments()[0].start(), paths[0].shape.segments().last().unwrap().end()];
        for end in &ends {
            let near = ends.iter().filter(|other| other.distance(*end) < 1e-9).count();
            assert!(near == 2 || original.iter().any(|at| at.distance(*end) < 1e-9), "{end:?} of {ends:?}");
        }
        for (tile, [from, to]) in tiles.iter().zip([[-1e3, -4.0], [-4.0, 2.0], [2.0, 1e3]]) {
            let points = tile.iter().flat_map(|piece| piece.shape.flattened(1e-3));
            for at in points {
                assert!(at.x > from - 1e-4 && at.x < to + 1e-4, "{at:?} in {from} to {to}: {tile:?}");
            }
        }
        // The overlap is marked twice.
        let overlapping = all_tiles(&paths, &unrolled, &[-4.0, 2.0], 0.5).concat();
        assert!(length(&overlapping) > length(&paths) + 0.9);
    }
}

#[test]
fn a_cut_through_a_corner_loses_nothing() {
    let unrolled = cylinder();
    let square =
        path(closed(&[[-5.0, -5.0], [0.0, -7.0], [5.0, -5.0], [5.0, 5.0], [0.0, 5.0], [-5.0, 5.0]]), None);
    let along = path(Shape::Open(polyline(&[[0.0, -9.0], [0.0, 9.0]])), None);
    let dot = path(Shape::Dot(FlatPoint::new(0.0, 1.0)), None);
    let paths = [square, along, dot];
    let tiles = all_tiles(&paths, &unrolled, &[0.0], 0.0);
    assert!((length(&tiles.concat()) - length(&paths)).abs() < 1e-4);
    assert_eq!(tiles.concat().iter().filter(|path| matches!(path.shape, Shape::Dot(_))).count(), 1);
}

#[test]
fn cut_fills_stay_closed_and_keep_their_area() {
    let unrolled = cylinder();
    // A ring with a square hole, a comb whose teeth cross the cut, and an island in a tile.
    let outer = closed(&[[-12.0, -6.0], [12.0, -6.0], [12.0, 6.0], [-12.0, 6.0]]);
    let hole = closed(&[[-3.0, -3.0], [-3.0, 3.0], [4.0, 3.0], [4.0, -3.0]]);
    let comb = closed(&[
        [-9.0, 10.0],
        [8.0, 10.0],
        [8.0, 12.0],
        [-8.0, 12.0],
        [-8.0, 14.0],
        [8.0, 14.0],
        [8.0, 16.0],
        [-9.0, 16.0],
    ]);
    let fill = |shape, region| path(shape, Some(region));
    let paths = [fill(outer, 1), fill(hole, 1), fill(comb, 2)];
    let tiles = all_tiles(&paths, &unrolled, &[0.0, 5.0], 0.0);
    assert!(tiles.concat().iter().all(|path| path.shape.is_closed()));
    // Between the cuts the hole is open to the border: two or one contours, no contour inside another.
    let areas: Vec<f64> = tiles.iter().map(|tile| area(tile)).collect();
    let ring = [12.0 * 12.0 - 3.0 * 6.0, 5.0 * 12.0 - 4.0 * 6.0, 7.0 * 12.0];
    let teeth = [9.0 * 4.0 + 2.0, 5.0 * 4.0, 3.0 * 4.0];
    for ((found, ring), teeth) in areas.iter().zip(ring).zip(teeth) {
        assert!((found - ring - teeth).abs() < 1e-3, "{areas:?}");
    }
    let contours: Vec<usize> = tiles.iter().map(Vec::len).collect();
    assert_eq!(contours, [2, 3, 3]);
}

proptest! {
    #[test]
    fn sections_of_a_segment_are_on_it(from in 0.0..0.45f64, to in 0.55..1.0f64, weight in 0.3..3.0f64) {
        let segments = [
            Segment::Line { from: FlatPoint::new(0.0, 1.0), to: FlatPoint::new(5.0, -2.0) },
            Segment::Arc {
                center: FlatPoint::new(1.0, 2.0),
                u: Vector2::new(3.0, 1.0),
                v: Vector2::new(0.0, 2.0),
                start: 0.3,
                sweep: -4.0,
            },
            Segment::Bezier {
                points: [[0.0, 0.0], [1.0, 4.0], [6.0, -4.0], [7.0, 1.0]].map(|[x, y]| FlatPoint::new(x, y)),
                weights: [1.0, weight, 1.0, 2.0],
            },
        ];
        for segment in segments {
            let section = segment.section(from, to);
            prop_assert!(section.start().distance(segment.point(from)) < 1e-12);
            prop_assert!(section.end().distance(segment.point(to)) < 1e-12);
            for step in 0..=8 {
                let t = f64::from(step) / 8.0;
                prop_assert!(section.point(t).distance(segment.point(from + (to - from) * t)) < 1e-12);
            }
        }
    }

    #[test]
    fn a_given_number_of_tiles_is_about_even(
        spans in prop::collection::vec((0.0..5.5f64, 0.0..1.0f64), 1..40),
        is_round in any::<bool>(),
        count in 1..40usize,
        overlap in 0.0..0.02f64,
    ) {
        let mut spans: Vec<[f64; 2]> =
            spans.into_iter().map(|(from, width)| [from, from + width.powi(3) * 0.7]).collect();
        if is_round {
            spans.push([0.0, std::f64::consts::TAU]);
        }
        let limits = Limits { overlap, count: Some(count), ..AUTO };
        let possible = counts(&spans, &limits).unwrap();
        let found = plan(&spans, &limits);
        prop_assert_eq!(found.is_some(), possible.contains(&count));
        let Some(found) = found else { return Ok(()) };
        prop_assert_eq!((found.tiles.len(), found.cuts.len()), (count, count - 1));
        prop_assert!(found.cuts.windows(2).all(|pair| pair[0].at < pair[1].at));
        for span in &spans {
            for at in [span[0], f64::midpoint(span[0], span[1]), span[1]] {
                prop_assert!(found.tiles.iter().any(|[from, to]| (from - 1e-9..=to + 1e-9).contains(&at)));
            }
        }
        // Equal steps over the whole drawing are an even division that ignores gaps, and no division of the ink has tiles
        // that are all narrower than its share of it.
        let start = spans.iter().map(|span| span[0]).fold(f64::INFINITY, f64::min);
        let end = spans.iter().map(|span| span[1]).fold(f64::NEG_INFINITY, f64::max);
        let step = (end - start) / count as f64;
        let is_inked = |at: f64| spans.iter().any(|span| span[0] <= at && at <= span[1]);
        let samples = 20_000;
        let sampled = (0..samples).filter(|index| is_inked(start + (end - start) * f64::from(*index) / f64::from(samples)));
        let share = (end - start) * sampled.count() as f64 / f64::from(samples) / count as f64;
        for (number, [from, to]) in found.tiles.iter().enumerate() {
            prop_assert!(to - from - overlap <= (step * 4.0 / 3.0).max(limits.narrowest) + 1e-8);
            let borders = [number.checked_sub(1).and_then(|index| found.cuts.get(index)), found.cuts.get(number)];
            if borders.into_iter().flatten().any(|cut| cut.is_through_ink) {
                prop_assert!(to - from >= 0.39 * share, "{} of {share}", to - from);
            }
        }
    }

    #[test]
    fn every_plan_keeps_to_its_limits(
        spans in prop::collection::vec((0.0..6.0f64, 0.001..0.6f64), 1..40),
        widest in 0.2..2.0f64,
        overlap in 0.0..0.05f64,
    ) {
        let spans: Vec<[f64; 2]> = spans.into_iter().map(|(from, width)| [from, from + width]).collect();
        let found = plan(&spans, &Limits { widest, overlap, ..AUTO }).unwrap();
        prop_assert_eq!(found.cuts.len() + 1, found.tiles.len());
        for [from, to] in &found.tiles {
            prop_assert!(to - from <= widest + 1e-9 && to > from);
        }
        prop_assert!(found.cuts.windows(2).all(|pair| pair[0].at < pair[1].at));
        for span in &spans {
            for at in [span[0], f64::midpoint(span[0], span[1]), span[1]] {
                prop_assert!(found.tiles.iter().any(|[from, to]| (from - 1e-9..=to + 1e-9).contains(&at)));
            }
        }
    }
}
