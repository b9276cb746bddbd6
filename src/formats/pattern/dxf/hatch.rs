//! HATCH and MPOLYGON: the boundary paths as closed contours of one filled region, or the lines of the hatch pattern.

use nalgebra::Vector3;

use super::budget::Budget;
use super::curves::{
    BulgeVertex, Curve, Placement, SpaceSegment, bridge, bulged, closing_sweep_between, is_full_turn,
    sweep_between,
};
use super::groups::Groups;
use super::hatch_lines::{Family, Style, filled_part, lines};
use super::items::Item;
use super::splines::{ControlSpline, by_control_points, through_fit_points};

/// What a hatch draws, from its numbers with their group codes: a filled region, or the lines of its pattern inside it.
/// Splines of high degree and the ends of pattern lines are approximated within `tolerance`.
pub(super) fn hatch(numbers: &[(i32, f64)], tolerance: f64, budget: &mut Budget) -> Item {
    let first_path = numbers.iter().position(|(code, _)| *code == 92).unwrap_or(numbers.len());
    let (head, paths) = numbers.split_at(first_path);
    let head = Groups(head.to_vec());
    let height = head.or(30, 0.0);
    let is_solid = head.or(70, 1.0) != 0.0;

    let mut cursor = Cursor { rest: paths };
    let (mut contours, mut has_paths) = (Vec::new(), false);
    while let Some(flags) = cursor.skip_to(92) {
        has_paths = true;
        let contour = if flags as i64 & 2 != 0 {
            polyline_path(&mut cursor, height, budget)
        } else {
            edge_path(&mut cursor, height, tolerance, budget)
        };
        let contour = match contour {
            Ok(contour) => contour,
            Err(why) => return Item::Skipped(format!("a boundary cannot be read: {why}").into()),
        };
        let bounds = match contour.segments.as_slice() {
            [] => false,
            [SpaceSegment::Line { from, to }] => from == to,
            _ => true,
        };
        if bounds {
            contours.push(contour);
        }
    }
    if contours.is_empty() {
        return Item::DrawsNothing(if has_paths {
            "its boundary encloses nothing"
        } else {
            "it has no boundary"
        });
    }
    let style = match cursor.skip_to(75).unwrap_or(0.0) as i64 {
        1 => Style::Outermost,
        2 => Style::IgnoreIslands,
        _ => Style::EvenOdd,
    };
    let contours = match filled_part(contours, style, tolerance, budget) {
        Ok(contours) => contours,
        Err(why) => return Item::Skipped(why.into()),
    };
    let plane = head.plane();
    if is_solid {
        return Item::Fill(contours.into_iter().map(|contour| contour.placed(&plane)).collect());
    }
    let families = families(&mut cursor);
    if families.is_empty() {
        return Item::Skipped(
            "the lines of its pattern are not in the file: explode it in the drawing program".into(),
        );
    }
    match lines(&contours, &families, height, tolerance, budget) {
        Ok(drawn) if drawn.is_empty() => {
            Item::DrawsNothing("none of its pattern lines is inside its boundary")
        }
        Ok(drawn) => Item::Several(drawn.into_iter().map(|item| (None, item.placed(&plane))).collect()),
        Err(why) => Item::Skipped(why.into()),
    }
}

/// The families of lines of the hatch pattern.
fn families(cursor: &mut Cursor<'_>) -> Vec<Family> {
    let mut families = Vec::new();
    while let Some(angle) = cursor.skip_to(53) {
        let mut next = |code| cursor.take(code).unwrap_or(0.0);
        let mut family = Family {
            angle: angle.to_radians(),
            base: [next(43), next(44)].into(),
            offset: [next(45), next(46)].into(),
            dashes: Vec::new(),
        };
        let _dash_count = cursor.take(79);
        while let Some(dash) = cursor.take(49) {
            family.dashes.push(dash);
        }
        families.push(family);
    }
    families
}

/// The groups that are not read yet.
struct Cursor<'g> {
    rest: &'g [(i32, f64)],
}

impl Cursor<'_> {
    /// The next group, if it has this code.
    fn take(&mut self, code: i32) -> Option<f64> {
        match self.rest {
            [(found, value), rest @ ..] if *found == code => {
                self.rest = rest;
                Some(*value)
            }
            _ => None,
        }
    }

    /// The next group with this code; groups before it are skipped.
    fn skip_to(&mut self, code: i32) -> Option<f64> {
        let at = self.rest.iter().position(|group| group.0 == code)?;
        let value = self.rest[at].1;
        self.rest = &self.rest[at + 1..];
        Some(value)
    }

    /// A point with the codes `code` and `code + 10`.
    fn point(&mut self, code: i32) -> Option<[f64; 2]> {
        let x = self.take(code)?;
        Some([x, self.take(code + 10)?])
    }
}

fn polyline_path(cursor: &mut Cursor<'_>, height: f64, budget: &mut Budget) -> Result<Curve, String> {
    // "Has bulges", "is closed" and the number of vertices: their order differs between HATCH and MPOLYGON, and none is
    // needed.
    while [72, 73, 93].iter().any(|code| cursor.take(*code).is_some()) {}
    let mut vertices = Vec::new();
    while let Some([x, y]) = cursor.point(10) {
        let bulge = cursor.take(42).unwrap_or(0.0);
        budget.hold(1)?;
        vertices.push(BulgeVertex { x, y, bulge });
    }
    if vertices.len() < 2 {
        return Ok(Curve { segments: Vec::new(), closed: true });
    }
    Ok(bulged(&vertices, true, &Placement::scaling(1.0), height))
}

/// A path of edges, each continued from the end of the last one; gaps become lines.
fn edge_path(
    cursor: &mut Cursor<'_>,
    height: f64,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Curve, String> {
    let count = cursor.take(93).unwrap_or(0.0);
    let mut segments: Vec<SpaceSegment> = Vec::new();
    let mut done = 0.0;
    while done < count {
        let Some(kind) = cursor.take(72) else { return Err(format!("it has {done} edges of {count}")) };
        budget.hold(1)?;
        // A single edge must return to its start.
        let turn_between = if count == 1.0 { closing_sweep_between } else { sweep_between };
        let mut edge = edge(cursor, kind as i64, turn_between, height, tolerance, budget)?;
        done += 1.0;
        // Some programs write an edge against the direction of the path; for the first edge, the second one shows this.
        let gap = |segments: &[SpaceSegment], edge: &[SpaceSegment]| match (segments.last(), edge.first()) {
            (Some(last), Some(first)) => (first.start() - last.end()).norm(),
            _ => f64::INFINITY,
        };
        let turned = reversed(&edge);
        if done == 2.0 {
            let begun = reversed(&segments);
            let nearest = |segments: &[SpaceSegment]| gap(segments, &edge).min(gap(segments, &turned));
            // The difference must exceed rounding, because a path of two edges closes in both directions.
            let rounding = 1e-9 * edge.first().map_or(0.0, |edge| edge.reach());
            if nearest(&begun) + rounding < nearest(&segments) {
                segments = begun;
            }
        }
        if gap(&segments, &turned) < gap(&segments, &edge) {
            edge = turned;
        }
        for segment in edge {
            bridge(&mut segments, segment.start(), budget)?;
            segments.push(segment);
        }
    }
    if let Some(start) = segments.first().map(SpaceSegment::start) {
        bridge(&mut segments, start, budget)?;
    }
    Ok(Curve { segments, closed: true })
}

fn reversed(segments: &[SpaceSegment]) -> Vec<SpaceSegment> {
    segments.iter().rev().cloned().map(SpaceSegment::reversed).collect()
}

fn edge(
    cursor: &mut Cursor<'_>,
    kind: i64,
    turn_between: fn(f64, f64) -> f64,
    height: f64,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, String> {
    let missing = |what: &str| format!("{what} is missing");
    let lift = |[x, y]: [f64; 2]| Vector3::new(x, y, height);
    match kind {
        1 => {
            let from = cursor.point(10).ok_or_else(|| missing("the start of a line"))?;
            let to = cursor.point(11).ok_or_else(|| missing("the end of a line"))?;
            Ok(vec![SpaceSegment::Line { from: lift(from), to: lift(to) }])
        }
        2 | 3 => {
            let center = cursor.point(10).ok_or_else(|| missing("the centre of an arc"))?;
            let major = if kind == 3 { cursor.point(11) } else { None };
            let size = cursor.take(40).ok_or_else(|| missing("the radius of an arc"))?;
            let start = cursor.take(50).unwrap_or(0.0).to_radians();
            let end = cursor.take(51).unwrap_or(360.0).to_radians();
            let counter_clockwise = cursor.take(73).unwrap_or(1.0) != 0.0;
            let (u, v) = match (kind, major) {
                (3, None) => return Err(missing("the axis of an ellipse")),
                (_, Some([x, y])) => (Vector3::new(x, y, 0.0), Vector3::new(-y, x, 0.0) * size),
                _ => (Vector3::x() * size, Vector3::y() * size),
            };
            // The angles of clockwise edges are measured clockwise; for ellipses they are angles, not parameters.
            let sign = if counter_clockwise { 1.0 } else { -1.0 };
            let turn = turn_between(start, end);
            let is_full = is_full_turn(turn);
            let parameter = |angle: f64| match kind {
                3 if !is_full => {
                    let parameter = (angle.sin() / size).atan2(angle.cos());
                    // In the same turn as the angle; otherwise a short arc across the end of a turn would become a full
                    // one.
                    let turn = std::f64::consts::TAU;
                    parameter + turn * ((angle - parameter) / turn).round()
                }
                _ => angle,
            };
            let sweep = if is_full { turn } else { sweep_between(parameter(start), parameter(end)) };
            let sweep = sweep * sign;
            let start = parameter(start) * sign;
            Ok(vec![SpaceSegment::Arc { center: lift(center), u, v, start, sweep }])
        }
        4 => spline_edge(cursor, height, tolerance, budget),
        other => Err(format!("edge type {other} is unknown")),
    }
}

fn spline_edge(
    cursor: &mut Cursor<'_>,
    height: f64,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, String> {
    let degree = cursor.take(94).unwrap_or(3.0);
    let _is_rational = cursor.take(73);
    let closed = cursor.take(74).unwrap_or(0.0) != 0.0;
    let _knot_count = cursor.take(95);
    let _point_count = cursor.take(96);
    let mut knots = Vec::new();
    while let Some(knot) = cursor.take(40) {
        knots.push(knot);
    }
    let (mut points, mut weights) = (Vec::new(), Vec::new());
    while let Some([x, y]) = cursor.point(10) {
        points.push(Vector3::new(x, y, height));
        weights.push(cursor.take(42).unwrap_or(1.0));
    }
    let fit_count = cursor.take(97).unwrap_or(0.0);
    let mut fit_points = Vec::new();
    while let Some([x, y]) = cursor.point(11).filter(|_| fit_count > 0.0) {
        fit_points.push(Vector3::new(x, y, height));
    }
    let mut tangent = |code| cursor.point(code).map(|[x, y]| Vector3::new(x, y, 0.0));
    let tangents = [tangent(12), tangent(13)];
    let curve = if points.is_empty() {
        through_fit_points(&fit_points, closed, tangents, budget)?
    } else {
        let degree = if (0.0..100.0).contains(&degree) { degree as usize } else { 0 };
        let spline = ControlSpline { degree, knots: &knots, points: &points, weights: &weights, closed };
        by_control_points(&spline, tolerance, budget)?
    };
    Ok(curve.segments)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reversed_edges_and_clockwise_arcs_make_one_contour() {
        // A half disc: the line is written backwards, the arc clockwise from (5, 0) over (0, -5) to (-5, 0).
        let numbers = [
            (92, 1.0),
            (93, 2.0),
            (72, 2.0),
            (10, 0.0),
            (20, 0.0),
            (40, 5.0),
            (50, 0.0),
            (51, 180.0),
            (73, 0.0),
            (72, 1.0),
            (10, 5.0),
            (20, 0.0),
            (11, -5.0),
            (21, 0.0),
            (97, 0.0),
            (75, 0.0),
        ];
        let Item::Fill(contours) = hatch(&numbers, 1e-4, &mut Budget::default()) else { panic!() };
        let [SpaceSegment::Arc { sweep, .. }, line] = contours[0].segments.as_slice() else { panic!() };
        assert!((sweep + std::f64::consts::PI).abs() < 1e-12);
        assert!((line.start() - Vector3::new(-5.0, 0.0, 0.0)).norm() < 1e-12);
        assert!((line.end() - Vector3::new(5.0, 0.0, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn a_hatch_without_boundary_draws_nothing_and_an_incomplete_one_is_a_loss() {
        let read = |numbers: &[(i32, f64)]| hatch(numbers, 1e-4, &mut Budget::default());
        assert!(matches!(read(&[(70, 1.0), (91, 0.0)]), Item::DrawsNothing(_)));
        let one_of_two = [
            (92, 1.0),
            (93, 2.0),
            (72, 1.0),
            (10, 0.0),
            (20, 0.0),
            (11, 1.0),
            (21, 0.0),
            (97, 0.0),
            (75, 0.0),
        ];
        assert!(matches!(read(&one_of_two), Item::Skipped(_)));
        // A pattern whose lines are not in the file.
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let square = square.iter().flat_map(|(x, y)| [(10, *x), (20, *y)]);
        let numbers: Vec<(i32, f64)> = [(70, 0.0), (91, 1.0), (92, 2.0), (72, 0.0), (73, 1.0), (93, 4.0)]
            .into_iter()
            .chain(square)
            .chain([(97, 0.0), (75, 0.0), (78, 0.0)])
            .collect();
        assert!(matches!(read(&numbers), Item::Skipped(_)));
    }

    #[test]
    fn edges_a_little_more_than_a_turn_are_full_turns_in_both_directions() {
        let turn = |kind: f64, start: f64, end: f64, counter_clockwise: f64| {
            let shape: &[(i32, f64)] =
                if kind == 3.0 { &[(11, 4.0), (21, 0.0), (40, 0.5)] } else { &[(40, 4.0)] };
            let mut numbers = vec![(92, 1.0), (93, 1.0), (72, kind), (10, 0.0), (20, 0.0)];
            numbers.extend(shape);
            numbers.extend([(50, start), (51, end), (73, counter_clockwise), (97, 0.0), (75, 0.0)]);
            let Item::Fill(contours) = hatch(&numbers, 1e-4, &mut Budget::default()) else { panic!() };
            let [SpaceSegment::Arc { sweep, .. }, ..] = contours[0].segments.as_slice() else { panic!() };
            *sweep
        };
        use std::f64::consts::TAU;
        for kind in [2.0, 3.0] {
            for (start, end) in
                [(0.0, 360.000001), (90.0, 450.000001), (180.0, 539.9999), (0.0, -0.0001), (360.0, 0.0)]
            {
                assert_eq!(turn(kind, start, end, 1.0), TAU, "{kind} {start} {end}");
                assert_eq!(turn(kind, start, end, 0.0), -TAU, "{kind} {start} {end}");
            }
        }
        // On an ellipse five times as high as wide, 0.001 deg across the end of a turn is a short arc.
        let numbers = [
            (92, 1.0),
            (93, 2.0),
            (72, 3.0),
            (10, 0.0),
            (20, 0.0),
            (11, 4.0),
            (21, 0.0),
            (40, 5.0),
            (50, 180.0),
            (51, 180.001),
            (73, 1.0),
            (72, 1.0),
            (10, -4.0),
            (20, -0.0001),
            (11, -4.0),
            (21, 0.0),
            (97, 0.0),
            (75, 0.0),
        ];
        let Item::Fill(contours) = hatch(&numbers, 1e-4, &mut Budget::default()) else { panic!() };
        let [SpaceSegment::Arc { sweep, .. }, ..] = contours[0].segments.as_slice() else { panic!() };
        assert!(*sweep < 1e-5, "{sweep}");
    }
}
