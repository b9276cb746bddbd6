//! Detects maps that fold the drawing over itself.

use nalgebra::Vector2;

use super::strain::Sample;
use super::{IsometricMap, products};
use crate::geometry::ink::Ink;
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::NurbsSurface;

/// Smallest allowed ratio of area on the part to area in the drawing; below it the map is about to fold.
const MIN_AREA: f64 = 0.05;

impl IsometricMap {
    /// A point of the view where the map folds the drawing over, if there is one. Only cells that contain ink, or are
    /// between cells that do, are checked: a fold in an empty corner of the box is not visible.
    pub(super) fn fold(&self, surface: &NurbsSurface, ink: &Ink) -> Option<ViewPoint> {
        // Five probes along a cell's side: between them, a cubic with strains of less than 1 cannot fold.
        const STEPS: usize = 4;
        let probes = |knots: &UniformKnots, cell: usize| -> [Basis; STEPS + 1] {
            let within = |step: usize| cell as f64 + step as f64 / STEPS as f64;
            std::array::from_fn(|step| knots.basis(knots.start() + knots.step() * within(step)))
        };
        for (row, columns) in self.cells_among(ink) {
            let up = probes(&self.knots_t, row);
            for column in columns {
                if self.smallest_area(row, column) > MIN_AREA {
                    continue;
                }
                let across = probes(&self.knots_s, column);
                for (s, t) in up.iter().flat_map(|t| across.iter().map(move |s| (s, t))) {
                    if !(self.strain_only(surface, &Sample::at(*s, *t)).area() > MIN_AREA) {
                        return Some(self.sum(s, t, &products(&s.value, &t.value)).into());
                    }
                }
            }
        }
        None
    }

    /// A lower bound for the ratio of area in the view to area in the drawing within a cell. ∂φ/∂s and ∂φ/∂t are convex combinations
    /// of the differences of the cell's control points (The NURBS Book, eq. 3.24), and area on the part is no smaller than in the view.
    pub(super) fn smallest_area(&self, row: usize, column: usize) -> f64 {
        let columns = self.knots_s.control_points();
        let at = |i: usize, j: usize| self.control[(row + j) * columns + column + i];
        let range = |step: f64, differences: [Vector2<f64>; 12]| {
            let [first, rest @ ..] = differences;
            let (low, high) =
                rest.iter().fold((first, first), |(low, high), next| (low.inf(next), high.sup(next)));
            [low / step, high / step]
        };
        let by_s = std::array::from_fn(|index| at(index % 3 + 1, index / 3) - at(index % 3, index / 3));
        let by_t = std::array::from_fn(|index| at(index / 3, index % 3 + 1) - at(index / 3, index % 3));
        let (by_s, by_t) = (range(self.knots_s.step(), by_s), range(self.knots_t.step(), by_t));
        let product = |a: usize, b: usize| {
            let ends = by_s.iter().flat_map(|s| by_t.iter().map(move |t| s[a] * t[b]));
            ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)))
        };
        product(0, 1).0 - product(1, 0).1
    }

    /// For each row, the columns of the cells that contain ink or have ink on both sides in their row or column.
    fn cells_among(&self, ink: &Ink) -> Vec<(usize, Vec<usize>)> {
        let (columns, rows) = (self.knots_s.spans(), self.knots_t.spans());
        let mut in_rows = vec![(columns, 0); rows];
        let mut in_columns = vec![(rows, 0); columns];
        let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
        for point in ends.chain(ink.squares.iter().chain(&ink.dots).copied()) {
            let (column, row) = (self.knots_s.span(point.x), self.knots_t.span(point.y));
            let widen = |range: &mut (usize, usize), to: usize| *range = (range.0.min(to), range.1.max(to));
            widen(&mut in_rows[row], column);
            widen(&mut in_columns[column], row);
        }
        let within = |range: (usize, usize), cell: usize| range.0 <= cell && cell <= range.1;
        let among = |row: usize| {
            let inside = |&column: &usize| within(in_rows[row], column) || within(in_columns[column], row);
            (row, (0..columns).filter(inside).collect())
        };
        (0..rows).map(among).collect()
    }
}
