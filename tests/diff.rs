//! The differences between two drawings, as text and as entries.

use std::time::{Duration, Instant};

use isomark::diff::{Change, DiffKind, DiffPath, Direction, DrawingDiff, TOLERANCE, compare, paths_of};
use isomark::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
use isomark::geometry::space::FlatPoint;
use proptest::prelude::*;

fn contour(layer: &str, points: &[[f64; 2]]) -> DiffPath {
    DiffPath { layer: layer.into(), color: "7".into(), kind: DiffKind::Closed, points: points.into() }
}

fn rectangle(layer: &str, [x, y]: [f64; 2], [width, height]: [f64; 2]) -> DiffPath {
    contour(layer, &[[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
}

fn moved(path: &DiffPath, by: [f64; 2]) -> DiffPath {
    let points = path.points.iter().map(|[x, y]| [x + by[0], y + by[1]]).collect();
    DiffPath { points, ..path.clone() }
}

fn dot(x: f64, y: f64) -> DiffPath {
    DiffPath { layer: "DOTS".into(), color: "1".into(), kind: DiffKind::Dot, points: vec![[x, y]] }
}

/// Three paths of different shape on two layers.
fn drawing() -> Vec<DiffPath> {
    vec![
        rectangle("OUTLINE", [0.0, 0.0], [6.0, 8.0]),
        rectangle("OUTLINE", [20.0, 0.0], [5.0, 3.0]),
        contour("LOGO", &[[40.0, 0.0], [44.0, 0.0], [42.0, 3.0]]),
    ]
}

fn difference(old: &[DiffPath], new: &[DiffPath]) -> DrawingDiff {
    compare(old, new, TOLERANCE)
}

#[test]
fn the_same_drawing_has_no_difference() {
    let diff = difference(&drawing(), &drawing());
    assert!(diff.entries.is_empty());
    assert_eq!(diff.to_string(), "no difference: 3 paths unchanged");
    assert_eq!(difference(&[], &[]).to_string(), "no difference: 0 paths unchanged");
}

#[test]
fn start_direction_and_noise_below_the_tolerance_are_ignored() {
    let mut new = drawing();
    new[0].points.rotate_left(2);
    new[1].points.reverse();
    // On the border between two quanta, where rounding separates close points.
    new[2].points[0][0] += 0.0008;
    let diff = difference(&drawing(), &new);
    assert_eq!((diff.entries.len(), diff.unchanged), (0, 3), "{diff}");
}

#[test]
fn a_moved_path_is_described_with_length_and_direction() {
    let mut new = drawing();
    new[0] = moved(&new[0], [0.42, 0.0]);
    let diff = difference(&drawing(), &new);
    let expected =
        "layer OUTLINE: closed path of 4 vertices near (3.0, 4.0) mm moved by 0.42 mm to the right";
    assert_eq!(diff.to_string(), format!("{expected}\n2 paths unchanged"));
    let [Change::Moved { from, to, by, distance, direction, .. }] = diff.entries.as_slice() else {
        panic!("{diff:?}");
    };
    assert_eq!((*from, *direction), ([3.0, 4.0], Direction::Right));
    assert!((to[0] - 3.42).abs() < 1e-12 && (by[0] - 0.42).abs() < 1e-12 && (distance - 0.42).abs() < 1e-12);
}

#[test]
fn directions_are_those_of_the_drawing() {
    let cases = [([0.0, -2.0], "down"), ([-1.0, 0.05], "to the left"), ([-3.0, 3.0], "up and to the left")];
    for (step, words) in cases {
        assert_eq!(Direction::of(step).to_string(), words);
    }
}

#[test]
fn a_global_move_is_one_line_even_for_equal_dots_in_a_grid() {
    let old: Vec<DiffPath> =
        (0..5000).map(|i| dot(f64::from(i % 100) * 0.5, f64::from(i / 100) * 0.5)).collect();
    for by in [[0.1, -0.2], [3.7, 1.25], [0.5, 0.0]] {
        let new: Vec<DiffPath> = old.iter().map(|path| moved(path, by)).collect();
        let diff = difference(&old, &new);
        // A grid that moved by its own pitch differs from the old one in only one column on each side.
        if by != [0.5, 0.0] {
            assert_eq!(diff.entries.len(), 5000);
            let words = format!("all 5,000 paths moved by ({:.2}, {:.2}) mm", by[0], by[1]);
            assert_eq!(diff.to_string(), words);
        } else {
            assert!(diff.lines().len() <= 3, "{diff}");
        }
    }
}

#[test]
fn two_groups_with_different_moves_are_two_lines() {
    let old: Vec<DiffPath> = (0..40)
        .map(|i| rectangle("TEXT", [f64::from(i) * 3.0, 0.0], [2.0, 1.0 + 0.01 * f64::from(i % 7)]))
        .collect();
    let new: Vec<DiffPath> = old
        .iter()
        .enumerate()
        .map(|(index, path)| moved(path, if index < 20 { [-1.0, 0.0] } else { [0.0, 2.5] }))
        .collect();
    let lines = difference(&old, &new).lines();
    assert_eq!(
        lines,
        ["layer TEXT: 20 paths moved by 1.00 mm to the left", "layer TEXT: 20 paths moved by 2.50 mm up"]
    );
}

#[test]
fn added_and_removed_paths_are_listed() {
    let mut new = drawing();
    new.remove(1);
    new.push(dot(100.0, 50.0));
    let text = difference(&drawing(), &new).to_string();
    assert_eq!(
        text,
        "layer DOTS: dot near (100.0, 50.0) mm added\n\
         layer OUTLINE: closed path of 4 vertices near (22.5, 1.5) mm removed\n\
         2 paths unchanged"
    );
}

#[test]
fn another_order_colour_or_layer_is_described_as_such() {
    let mut new = drawing();
    new.swap(0, 2);
    new[1].color = "1".into();
    let diff = difference(&drawing(), &new);
    assert!(diff.to_string().contains("near (22.5, 1.5) mm recoloured from 7 to 1"), "{diff}");
    assert!(diff.to_string().contains("drawn"), "{diff}");
    new[1].color = "7".into();
    new.swap(0, 2);
    new[2].layer = "CUT".into();
    assert_eq!(
        difference(&drawing(), &new).lines(),
        ["layer LOGO: closed path of 3 vertices near (42.0, 1.5) mm moved to layer CUT"]
    );
}

#[test]
fn another_size_is_distinguished_from_another_shape() {
    let mut new = drawing();
    new[0] = rectangle("OUTLINE", [0.0, 0.0], [6.0, 9.0]);
    new[2].points.insert(1, [42.0, -0.034]);
    let diff = difference(&drawing(), &new);
    let text = diff.to_string();
    assert!(text.contains("resized from 6.00 × 8.00 mm to 6.00 × 9.00 mm"), "{text}");
    assert!(text.contains("closed path of 3 vertices near (42.0, 1.5) mm reshaped by up to 0.034"), "{text}");
}

#[test]
fn a_finer_subdivision_of_the_same_line_is_not_a_change() {
    let coarse = DiffPath { kind: DiffKind::Open, ..contour("A", &[[0.0, 0.0], [10.0, 5.0]]) };
    let fine = DiffPath { points: vec![[0.0, 0.0], [2.0, 1.0], [6.0, 3.0], [10.0, 5.0]], ..coarse.clone() };
    assert_eq!(difference(&[coarse], &[fine]).unchanged, 1);
}

#[test]
fn entries_survive_json() {
    let mut new = drawing();
    new[0] = moved(&new[0], [0.1, 0.1]);
    new.pop();
    let diff = difference(&drawing(), &new);
    let json = serde_json::to_string(&diff).unwrap();
    assert!(json.contains("\"change\":\"moved\"") && json.contains("\"direction\":\"up-right\""), "{json}");
    assert_eq!(serde_json::from_str::<DrawingDiff>(&json).unwrap(), diff);
}

#[test]
fn a_pattern_is_flattened_and_its_colours_resolved() {
    let circle = Segment::Arc {
        center: FlatPoint::new(0.0, 0.0),
        u: [5.0, 0.0].into(),
        v: [0.0, 5.0].into(),
        start: 0.0,
        sweep: std::f64::consts::TAU,
    };
    let pattern = Pattern {
        layers: vec![Layer { name: "ART".into(), color: Color::Aci(3) }],
        paths: vec![Path {
            layer: 0,
            color: Color::ByLayer,
            shape: Shape::Closed(vec![circle]),
            region: None,
            source: Source::default(),
        }],
    };
    let paths = paths_of(&pattern);
    assert_eq!(
        (paths[0].layer.as_str(), paths[0].color.as_str(), paths[0].kind),
        ("ART", "3", DiffKind::Closed)
    );
    assert!(paths[0].points.len() > 64);
}

#[test]
fn many_paths_take_seconds_at_most() {
    // Reproducible pseudorandom coordinates, so that no two shapes are equal.
    let scattered = |seed: u64| {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1u64 << 31) as f64
        }
    };
    let mut next = scattered(1);
    let old: Vec<DiffPath> = (0..100_000)
        .map(|_| rectangle("A", [next() * 300.0, next() * 300.0], [next() + 0.1, next() + 0.1]))
        .collect();
    let dots: Vec<DiffPath> = old.iter().map(|path| dot(path.points[0][0], path.points[0][1])).collect();
    let mut jitter = scattered(2);
    let jittered = |paths: &[DiffPath], next: &mut dyn FnMut() -> f64| -> Vec<DiffPath> {
        paths.iter().map(|path| moved(path, [next() * 0.05, next() * 0.05])).collect()
    };
    let shuffled = |paths: &[DiffPath]| -> Vec<DiffPath> {
        (0..paths.len()).map(|index| paths[index * 61_813 % paths.len()].clone()).collect()
    };
    let reshaped: Vec<DiffPath> = old
        .iter()
        .map(|path| {
            let mut path = path.clone();
            path.points[0][0] -= 0.03;
            path
        })
        .collect();
    let cases = [
        ("all moved equally", &old, old.iter().map(|path| moved(path, [0.3, 0.2])).collect()),
        ("each moved differently", &old, jittered(&old, &mut jitter)),
        ("dots, each moved differently", &dots, jittered(&dots, &mut jitter)),
        ("shuffled", &old, shuffled(&old)),
        ("shuffled and moved", &dots, shuffled(&jittered(&dots, &mut jitter))),
        ("reshaped", &old, reshaped),
        ("nothing in common", &old, dots.clone()),
    ];
    // Without compiler optimisation, everything takes several times as long.
    let limit = Duration::from_secs(if cfg!(debug_assertions) { 20 } else { 2 });
    for (name, old, new) in cases {
        let start = Instant::now();
        let diff = difference(old, &new);
        let words = diff.to_string();
        let taken = start.elapsed();
        println!("{name}: {taken:.2?}: {}", words.replace('\n', " | "));
        assert!(taken < limit, "{name}: {taken:.2?}");
        assert!(words.lines().count() < 20, "{name}: {words}");
    }
}

fn any_drawing() -> impl Strategy<Value = Vec<DiffPath>> {
    let coordinate = || (-40i32..40).prop_map(|value| f64::from(value) * 0.25);
    let path =
        (0usize..2, 0usize..2, prop::collection::vec([coordinate(), coordinate()], 1..5), any::<bool>());
    let path = path.prop_map(|(layer, color, points, is_closed)| DiffPath {
        layer: ["A", "B"][layer].into(),
        color: ["1", "2"][color].into(),
        kind: match points.len() {
            1 => DiffKind::Dot,
            _ if is_closed => DiffKind::Closed,
            _ => DiffKind::Open,
        },
        points,
    });
    prop::collection::vec(path, 0..12)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_drawing_does_not_differ_from_itself(drawing in any_drawing()) {
        let diff = difference(&drawing, &drawing);
        prop_assert!(diff.entries.is_empty(), "{diff}");
        prop_assert_eq!(diff.unchanged, drawing.len());
    }

    #[test]
    fn swapping_the_drawings_swaps_added_and_removed(old in any_drawing(), new in any_drawing()) {
        let (forth, back) = (difference(&old, &new), difference(&new, &old));
        let added = |diff: &DrawingDiff| diff.entries.iter().filter_map(|change| match change {
            Change::Added { what } => Some(format!("{what:?}")),
            _ => None,
        }).collect::<Vec<_>>();
        let removed = |diff: &DrawingDiff| diff.entries.iter().filter_map(|change| match change {
            Change::Removed { what } => Some(format!("{what:?}")),
            _ => None,
        }).collect::<Vec<_>>();
        prop_assert_eq!(added(&forth), removed(&back));
        prop_assert_eq!(removed(&forth), added(&back));
        prop_assert_eq!(forth.unchanged, back.unchanged);
        prop_assert_eq!(old.len() - removed(&forth).len(), new.len() - added(&forth).len());
    }

    #[test]
    fn a_common_move_is_found(drawing in any_drawing(), x in -900i32..900, y in 1i32..900) {
        let by = [f64::from(x) * 0.013, f64::from(y) * 0.013];
        let new: Vec<DiffPath> = drawing.iter().map(|path| moved(path, by)).collect();
        let diff = difference(&drawing, &new);
        let is_explained = |change: &Change| matches!(change, Change::Moved { .. } | Change::Reordered { .. });
        prop_assert!(diff.entries.iter().all(is_explained), "{diff}");
    }
}
