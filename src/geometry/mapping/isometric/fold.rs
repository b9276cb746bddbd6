//! Whether a map lays the drawing over itself.

use super::IsometricMap;
use super::strain::Sample;
use crate::geometry::ink::Ink;
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::NurbsSurface;

/// The least area on the part for an area of the drawing; below it the map is about to turn over.
const LEAST_AREA: f64 = 0.05;

impl IsometricMap {
    /// A point of the view where the map turns the drawing over, if there is one. Looked at are the cells that hold ink
    /// or lie between cells that do: what the map does with empty corners of the box shows nowhere.
    pub(super) fn fold(&self, surface: &NurbsSurface, ink: &Ink) -> Option<ViewPoint> {
        // Five looks along a cell's side: between them a cubic with strains of less than 1 does not turn over unseen.
        const LOOKS: usize = 4;
        let looks = |knots: &UniformKnots, cell: usize| -> [Basis; LOOKS + 1] {
            let within = |look: usize| cell as f64 + look as f64 / LOOKS as f64;
            std::array::from_fn(|look| knots.basis(knots.start() + knots.step() * within(look)))
        };
        for (row, columns) in self.cells_among(ink) {
            let up = looks(&self.knots_t, row);
            for column in columns {
                let across = looks(&self.knots_s, column);
                for (s, t) in up.iter().flat_map(|t| across.iter().map(move |s| (s, t))) {
                    let strain = self.strain(surface, &Sample::at(*s, *t));
                    if !(strain.area() > LEAST_AREA) {
                        return Some(self.sum(s, t, &strain.basis[0]).into());
                    }
                }
            }
        }
        None
    }

    /// For each row the columns of the cells that have ink to both sides in their row or in their column.
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
