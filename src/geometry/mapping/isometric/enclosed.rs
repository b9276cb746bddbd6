//! The cells that lines enclose in a drawing without filled areas, as in a grid: people see their size and
//! shape.

use crate::geometry::ink::Ink;
use crate::geometry::space::FlatPoint;

/// Largest number of squares in the drawing's box; beyond it, squares are made larger.
const MOST_SQUARES: f64 = 2.5e5;
/// The squares are this many times smaller than those of inked areas, so that paths go through narrow gaps.
/// In the end, only one in this many in a row is kept.
const FINER: f64 = 4.0;

/// The drawing with the cells that its lines enclose as inked squares, if it has no inked area of its own.
pub(super) fn with_enclosed_cells(ink: &Ink) -> Option<Ink> {
    if !ink.squares.is_empty() || ink.pieces.is_empty() {
        return None;
    }
    let squares = enclosed(ink);
    (!squares.is_empty()).then(|| Ink {
        pieces: ink.pieces.clone(),
        dots: ink.dots.clone(),
        inked_area: squares.len() as f64 * ink.side * ink.side,
        squares,
        blocks: Vec::new(),
        ..*ink
    })
}

/// The centres of the squares that no path without crossing a line connects with the outside of the box.
fn enclosed(ink: &Ink) -> Vec<FlatPoint> {
    let size = ink.extents.size();
    let side = (ink.side / FINER).max((size.x * size.y / MOST_SQUARES).sqrt()).max(size.max() / MOST_SQUARES);
    // Only one in this many squares in a row is kept in the end ([`FINER`]).
    let every = ((ink.side / side) as usize).max(1);
    // A border of free squares round the box.
    let [columns, rows] = [size.x, size.y].map(|length| (length / side) as usize + 3);
    let index = |at: FlatPoint| {
        let [column, row] = [at.x - ink.extents.min.x, at.y - ink.extents.min.y]
            .map(|from_corner| (from_corner / side).max(0.0) as usize + 1);
        row.min(rows - 2) * columns + column.min(columns - 2)
    };
    let mut is_free = vec![true; columns * rows];
    for piece in &ink.pieces {
        // Neighbouring squares share at least a corner, which a path from side to side cannot cross.
        let steps = (2.0 * piece.length() / side).ceil().max(1.0) as usize;
        for step in 0..=steps {
            is_free[index(piece.from.lerp(piece.to, step as f64 / steps as f64))] = false;
        }
    }
    let mut open = vec![0];
    while let Some(square) = open.pop() {
        if !std::mem::take(&mut is_free[square]) {
            continue;
        }
        let (column, row) = (square % columns, square / columns);
        let beside = [
            (column > 0).then(|| square - 1),
            (column + 1 < columns).then(|| square + 1),
            (row > 0).then(|| square - columns),
            (row + 1 < rows).then(|| square + columns),
        ];
        open.extend(beside.into_iter().flatten().filter(|square| is_free[*square]));
    }
    let is_kept =
        |square: usize| (square % columns).is_multiple_of(every) && (square / columns).is_multiple_of(every);
    let center = |square: usize| {
        let [column, row] = [square % columns, square / columns].map(|place| place as f64 - 0.5);
        FlatPoint::new(ink.extents.min.x + column * side, ink.extents.min.y + row * side)
    };
    (0..is_free.len()).filter(|square| is_free[*square] && is_kept(*square)).map(center).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::geometry::ink::Piece;
    use crate::geometry::space::Extents;

    /// Two rings, 0.5 mm apart, each with a gap on opposite sides.
    fn rings(gap: f64) -> Ink {
        let ring = |radius: f64, start: f64| {
            let at = move |step: u32| {
                let angle = start + gap / 2.0 + (TAU - gap) * f64::from(step) / 400.0;
                FlatPoint::new(radius * angle.cos(), radius * angle.sin())
            };
            (0..400).map(move |step| Piece { from: at(step), to: at(step + 1) })
        };
        let pieces: Vec<Piece> = ring(10.0, 0.0).chain(ring(10.5, TAU / 2.0)).collect();
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
    fn a_channel_between_lines_leads_outside() {
        assert_eq!(with_enclosed_cells(&rings(0.2)), None);
    }

    #[test]
    fn closed_rings_enclose_a_disc() {
        let ink = with_enclosed_cells(&rings(0.0)).unwrap();
        let area = ink.squares.len() as f64 * ink.side * ink.side;
        assert!((area / (TAU / 2.0 * 10.5 * 10.5) - 1.0).abs() < 0.05, "{area} mm²");
    }
}
