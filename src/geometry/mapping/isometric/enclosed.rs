//! The cells that line work without filled areas encloses, as in a grid: a person sees their size and shape.

use crate::geometry::ink::Ink;
use crate::geometry::space::FlatPoint;

/// Largest number of squares in the drawing's box; beyond it, squares are made larger.
const MOST_SQUARES: f64 = 2.5e5;

/// The drawing with the cells that its lines enclose as inked squares, if it has no inked area of its own.
pub(super) fn with_enclosed_cells(ink: &Ink) -> Option<Ink> {
    if !ink.squares.is_empty() || ink.pieces.is_empty() {
        return None;
    }
    let squares = enclosed(ink);
    (!squares.is_empty()).then(|| Ink {
        pieces: ink.pieces.clone(),
        dots: ink.dots.clone(),
        squares,
        blocks: Vec::new(),
        ..*ink
    })
}

/// The centres of the squares that no path without crossing a line connects with the outside of the box.
fn enclosed(ink: &Ink) -> Vec<FlatPoint> {
    let size = ink.extents.size();
    let side = ink.side.max((size.x * size.y / MOST_SQUARES).sqrt()).max(size.max() / MOST_SQUARES);
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
    let center = |square: usize| {
        let [column, row] = [square % columns, square / columns].map(|place| place as f64 - 0.5);
        FlatPoint::new(ink.extents.min.x + column * side, ink.extents.min.y + row * side)
    };
    is_free.iter().enumerate().filter(|(_, is_free)| **is_free).map(|(square, _)| center(square)).collect()
}
