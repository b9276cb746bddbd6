use nalgebra::{Point3, Unit, Vector3};
use proptest::prelude::*;

use super::*;
use crate::geometry::mapping::cone::{Cone, ConeFit, ConeMap};
use crate::geometry::mapping::cylinder::{Cylinder, CylinderFit, CylinderMap};
use crate::geometry::pattern::{Color, Segment, Source};

const RADIUS: f64 = 30.0;

fn cylinder() -> Unrolled {
    let cylinder =
        Cylinder { center: Point3::new(0.0, 0.0, -RADIUS), axis: Vector3::y_axis(), radius: RADIUS };
    let map = CylinderMap::new(cylinder, FlatPoint::new(0.0, 0.0), 0.0).unwrap();
    Unrolled::of(&LengthTrueMap::Cylinder(map, CylinderFit { cylinder, residual: 0.0 })).unwrap()
}

/// A cone with the apex 100 mm below the anchor along its generator.
fn cone(half_angle: f64) -> (Unrolled, ConeMap) {
    let axis = Unit::new_normalize(Vector3::new(0.0, half_angle.cos(), -half_angle.sin()));
    let cone = Cone { apex: Point3::new(0.0, -100.0, 0.0), axis, half_angle };
    let map = ConeMap::new(cone, FlatPoint::new(0.0, 0.0), 0.0, 10.0).unwrap();
    (Unrolled::of(&LengthTrueMap::Cone(map, ConeFit { cone, residual: 0.0 })).unwrap(), map)
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
    let limits = Limits { widest: 60f64.to_radians(), overlap: 0.0, count: None };
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
        let limits = Limits { widest: 1.6, overlap: 0.01, count: Some(count) };
        let found = plan(&ring, &limits).unwrap();
        assert_eq!((found.tiles.len(), found.cuts.len()), (count, count - 1));
        assert!(found.tiles.iter().all(|[from, to]| to - from <= 1.6));
    }
    for (count, widest) in [(3, 1.6), (1, 5.0)] {
        assert_eq!(plan(&ring, &Limits { widest, overlap: 0.0, count: Some(count) }), None);
    }
    // Two letters are not three tiles with ink.
    let letters = [[0.0, 0.1], [1.0, 1.1]];
    let limits = Limits { widest: 0.5, overlap: 0.0, count: None };
    assert_eq!(plan(&letters, &limits).unwrap().tiles, letters.to_vec());
    assert_eq!(plan(&[], &limits), None);
    assert_eq!(plan(&[[0.0, 1.0]], &Limits { overlap: 0.6, ..limits }), None);
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
    fn every_plan_keeps_to_its_limits(
        spans in prop::collection::vec((0.0..6.0f64, 0.001..0.6f64), 1..40),
        widest in 0.2..2.0f64,
        overlap in 0.0..0.05f64,
    ) {
        let spans: Vec<[f64; 2]> = spans.into_iter().map(|(from, width)| [from, from + width]).collect();
        let found = plan(&spans, &Limits { widest, overlap, count: None }).unwrap();
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
