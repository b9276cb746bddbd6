//! The outlines of united cells: a laser marks no edge between two of them.

use super::Modules;

/// Directions of an edge: right, up, left, down.
const STEPS: [[isize; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// The outlines of the dark modules in corners of modules from the lower left: outer ones counter-clockwise, those of holes
/// clockwise, without corners on straight edges. Modules that only touch at a corner have separate outlines.
#[must_use]
pub fn outlines(modules: &Modules) -> Vec<Vec<[usize; 2]>> {
    let [columns, rows] = modules.size();
    let index = |[x, y]: [usize; 2]| y * (columns + 1) + x;
    // The edges that leave each corner, a bit for each direction; the dark module is on their left.
    let mut leaving = vec![0u8; (columns + 1) * (rows + 1)];
    for row in 0..rows {
        for column in (0..columns).filter(|column| modules.is_dark(*column, row)) {
            let is_dark = |dx: isize, dy: isize| {
                let (x, y) = (column.checked_add_signed(dx), row.checked_add_signed(dy));
                x.zip(y).is_some_and(|(x, y)| modules.is_dark(x, y))
            };
            let edges = [
                ([column, row], is_dark(0, -1)),
                ([column + 1, row], is_dark(1, 0)),
                ([column + 1, row + 1], is_dark(0, 1)),
                ([column, row + 1], is_dark(-1, 0)),
            ];
            for (direction, (from, is_shared)) in edges.into_iter().enumerate() {
                leaving[index(from)] |= u8::from(!is_shared) << direction;
            }
        }
    }
    let mut found = Vec::new();
    for start in 0..leaving.len() {
        while leaving[start] != 0 {
            let from = [start % (columns + 1), start / (columns + 1)];
            found.push(outline(&mut leaving, from, columns + 1));
        }
    }
    found
}

/// Follows one outline from a corner and removes its edges.
fn outline(leaving: &mut [u8], from: [usize; 2], width: usize) -> Vec<[usize; 2]> {
    let mut corners = Vec::new();
    let mut at = from;
    let mut direction = leaving[from[1] * width + from[0]].trailing_zeros() as usize;
    let first = direction;
    loop {
        leaving[at[1] * width + at[0]] &= !(1 << direction);
        at = [0, 1].map(|axis| at[axis].saturating_add_signed(STEPS[direction][axis]));
        let edges = leaving[at[1] * width + at[0]];
        let is_end = |next: usize| at == from && next == first;
        // The left turn stays with the same module where two touch at a corner.
        let turns = [1, 0, 3].map(|turn| (direction + turn) % 4);
        let next = turns.into_iter().find(|next| is_end(*next) || edges & (1 << next) != 0);
        if next != Some(direction) {
            corners.push(at);
        }
        match next.filter(|next| !is_end(*next)) {
            Some(next) => direction = next,
            None => return corners,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::code::{Kind, encode};

    fn modules(rows: &[&str]) -> Modules {
        let dark = rows.iter().rev().flat_map(|row| row.bytes().map(|cell| cell == b'#')).collect();
        Modules::new(rows[0].len(), dark)
    }

    /// Twice the signed area, and the length.
    fn measure(outline: &[[usize; 2]]) -> (isize, usize) {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).fold((0, 0), |(area, length), (a, b)| {
            let [ax, ay, bx, by] = [a[0], a[1], b[0], b[1]].map(|value| value as isize);
            (area + ax * by - bx * ay, length + (ax - bx).unsigned_abs() + (ay - by).unsigned_abs())
        })
    }

    #[test]
    fn shared_edges_are_in_no_outline() {
        assert_eq!(outlines(&modules(&["##", "##"])), [[[2, 0], [2, 2], [0, 2], [0, 0]]]);
        // A hole is clockwise.
        let ring = outlines(&modules(&["###", "#.#", "###"]));
        assert_eq!(ring.iter().map(|outline| measure(outline).0).collect::<Vec<_>>(), [18, -2]);
        // Modules that touch at a corner stay separate.
        let touching = outlines(&modules(&["#.", ".#"]));
        assert_eq!(touching.iter().map(|outline| measure(outline)).collect::<Vec<_>>(), [(2, 4), (2, 4)]);
        assert!(outlines(&modules(&["..", ".."])).is_empty());
    }

    #[test]
    fn the_outlines_of_a_code_have_its_area_and_every_free_edge_once() {
        for kind in [Kind::DataMatrix, Kind::Qr, Kind::Code128] {
            for invert in [false, true] {
                let code = encode(kind, "SN 000017 / 2026-11-23", false).unwrap().with_margin([1, 1]);
                let code = if invert { code.inverted() } else { code };
                let [columns, rows] = code.size();
                let (mut dark, mut free) = (0, 0);
                for row in 0..rows {
                    for column in (0..columns).filter(|column| code.is_dark(*column, row)) {
                        dark += 2;
                        let near = [
                            (column.wrapping_sub(1), row),
                            (column + 1, row),
                            (column, row.wrapping_sub(1)),
                            (column, row + 1),
                        ];
                        free += near.iter().filter(|(x, y)| !code.is_dark(*x, *y)).count();
                    }
                }
                let sums = outlines(&code)
                    .iter()
                    .map(|outline| measure(outline))
                    .fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
                assert_eq!(sums, (dark, free), "{kind}");
            }
        }
    }
}
