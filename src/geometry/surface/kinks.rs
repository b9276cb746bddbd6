//! Where a sampled part has a kink: its slope jumps from node to node, while it changes little beside them.

use nalgebra::Vector3;

use crate::geometry::height_field::{HeightField, Node};
use crate::geometry::space::ViewPoint;

/// A kink is searched for among this many nodes on either side of a place.
const NEAR: isize = 3;
/// This many nodes on either side of a kink show how the slope changes beside it.
const BESIDE: isize = 8;
/// At a kink, the slope jumps by more than this many times its usual change.
const STANDS_OUT: f64 = 4.0;
/// At a kink, the slope jumps by more than this, no unit: 1.5°.
const LEAST: f64 = 0.026;
/// The usual change is known only if at least this many changes of the slope beside a kink are known.
const FEWEST: usize = 6;

impl HeightField {
    /// The angle by which the surface turns at a kink near a place, rad; `None` where it runs on smoothly or is not known.
    pub fn kink(&self, at: ViewPoint) -> Option<f64> {
        let (column, row, place) = self.cell(at)?;
        let middle = [column + place.x.round() as usize, row + place.y.round() as usize];
        let lines =
            (-1..=1).flat_map(|line| [self.kink_along(middle, 0, line), self.kink_along(middle, 1, line)]);
        lines.flatten().reduce(f64::max)
    }

    /// The kink along one line of nodes: along x (`axis` 0) or y (1), `line` lines beside the place `middle`.
    fn kink_along(&self, middle: [usize; 2], axis: usize, line: isize) -> Option<f64> {
        let height_at = |along: isize, across: isize| {
            let (columns, rows) = self.size();
            let shift = if axis == 0 { [along, line + across] } else { [line + across, along] };
            let column = middle[0].checked_add_signed(shift[0]).filter(|&at| at < columns)?;
            let row = middle[1].checked_add_signed(shift[1]).filter(|&at| at < rows)?;
            match self.nodes()[row * columns + column] {
                Node::Surface(height) => Some(height),
                Node::Empty | Node::Wall(_) => None,
            }
        };
        let height = |along: isize| height_at(along, 0);
        let slope = |along: isize| Some((height(along + 1)? - height(along)?) / self.step());
        let change = |along: isize| Some((slope(along)? - slope(along - 1)?).abs());
        let jump = |along: &isize| change(*along).unwrap_or(0.0);
        let at = (-NEAR..=NEAR).max_by(|one, other| jump(one).total_cmp(&jump(other)))?;
        // A kink between two nodes is seen at both.
        let beside = (-BESIDE..=BESIDE).filter(|along| (along - at).abs() > 1);
        let mut usual: Vec<f64> = beside.filter_map(change).collect();
        if usual.len() < FEWEST {
            return None;
        }
        let half = usual.len() / 2;
        let usual = *usual.select_nth_unstable_by(half, f64::total_cmp).1;
        let before = slope(at - 2)?;
        let after = slope(at + 1)?;
        let is_kink = (after - before).abs() > LEAST && jump(&at) > STANDS_OUT * usual + LEAST / 4.0;
        // The slope across the line is part of both normals: on a tilted side, the angle in the section is larger.
        let across = |along: isize| {
            let slope = height_at(along, 1).zip(height_at(along, -1)).map(|(one, other)| one - other);
            slope.map_or(0.0, |slope| slope / (2.0 * self.step()))
        };
        let [one, other] = [(before, across(at - 2)), (after, across(at + 2))]
            .map(|(along, across)| Vector3::new(-along, -across, 1.0));
        is_kink.then(|| one.angle(&other))
    }

    /// Whether the surface ends within two nodes of a place: at a hole, a rim or a cliff.
    pub fn ends_near(&self, at: ViewPoint) -> bool {
        let Some((column, row, _)) = self.cell(at) else { return true };
        let (columns, rows) = self.size();
        let around = |middle: usize, count: usize| middle.saturating_sub(2)..(middle + 4).min(count);
        let is_surface = |index: usize| matches!(self.nodes()[index], Node::Surface(_));
        around(row, rows).any(|row| around(column, columns).any(|column| !is_surface(row * columns + column)))
            || column < 2
            || row < 2
            || column + 3 >= columns
            || row + 3 >= rows
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    fn field(height: impl Fn(f64, f64) -> f64) -> HeightField {
        let nodes = (0..61 * 61).map(|index| {
            let place = |number: usize| number as f64 * 0.5 - 15.0;
            Node::Surface(height(place(index % 61), place(index / 61)))
        });
        HeightField::new(Vector2::repeat(-15.0), 0.5, 61, 61, nodes.collect()).unwrap()
    }

    #[test]
    fn a_ridge_is_a_kink_whichever_way_it_runs_and_only_there() {
        let slope = 10f64.to_radians().tan();
        for turn in [0.0f64, 0.3, 0.8, 1.2, 1.57] {
            let across = move |x: f64, y: f64| x * turn.cos() + y * turn.sin();
            let roof = field(move |x, y| 20.0 - slope * (across(x, y) - 0.13).abs() - x * x / 200.0);
            let angle = roof.kink(ViewPoint::new(0.1, 0.0)).unwrap().to_degrees();
            assert!(angle > 12.0 && angle < 22.0, "{turn}: {angle} deg");
            let beside = ViewPoint::new(6.0 * turn.cos(), 6.0 * turn.sin());
            assert_eq!(roof.kink(beside), None, "{turn}");
        }
    }

    #[test]
    fn the_angle_of_an_edge_is_that_of_the_part_on_a_tilted_side_too() {
        // A side that is tilted by 50 deg, with a chamfer of 45 deg along its slope.
        let (tilt, chamfer) = (50f64.to_radians(), 45f64.to_radians());
        let fall = chamfer.tan() / tilt.cos();
        let edge = field(move |x, y| 20.0 - tilt.tan() * x - fall * (y - 0.13).max(0.0));
        let angle = edge.kink(ViewPoint::new(2.0, 0.0)).unwrap();
        assert!((angle - chamfer).abs() < 0.01, "{} deg", angle.to_degrees());
    }

    #[test]
    fn what_bends_smoothly_has_no_kink() {
        for radius in [15.5, 20.0, 30.0, 100.0] {
            let ball = field(move |x, y| (radius * radius - 0.45 * (x * x + y * y)).sqrt());
            assert_eq!(ball.kink(ViewPoint::new(3.0, 2.0)), None, "radius {radius} mm");
        }
        let waves = field(|x, y| 0.2 * (x * 1.5).sin() * (y * 1.2).cos());
        for x in -20..=20 {
            assert_eq!(waves.kink(ViewPoint::new(f64::from(x) * 0.5, 0.3)), None, "waves at {x}");
        }
    }

    #[test]
    fn the_end_of_the_surface_is_near_its_rim_only() {
        let flat = field(|_, _| 0.0);
        assert!(flat.ends_near(ViewPoint::new(-14.6, 0.0)) && flat.ends_near(ViewPoint::new(40.0, 0.0)));
        assert!(!flat.ends_near(ViewPoint::new(0.0, 0.0)));
    }
}
