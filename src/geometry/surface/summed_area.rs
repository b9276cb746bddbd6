//! Sums over squares of a grid.

use std::ops::{Add, Sub};

/// Sums over squares of a grid, from the sums over all rectangles at its first corner (Crow, Summed-area tables for texture mapping,
/// SIGGRAPH 1984).
pub(super) struct SummedArea<T> {
    size: [usize; 2],
    /// The sum over all places left of and below each corner of the places' cells.
    sums: Vec<T>,
}

impl<T: Copy + Default + Add<Output = T> + Sub<Output = T>> SummedArea<T> {
    /// The sums of `values` on a grid of `columns` × `rows` places. Each value comes with the number of its
    /// place, row by row. Places without a value are zero.
    pub(super) fn of([columns, rows]: [usize; 2], values: impl Iterator<Item = (usize, T)>) -> Self {
        let width = columns + 1;
        let mut sums = vec![T::default(); width * (rows + 1)];
        for (place, value) in values {
            sums[(place / columns + 1) * width + place % columns + 1] = value;
        }
        for row in 1..=rows {
            for column in 1..=columns {
                let at = row * width + column;
                sums[at] = sums[at] + (sums[at - 1] + sums[at - width] - sums[at - width - 1]);
            }
        }
        Self { size: [columns, rows], sums }
    }

    /// The sum over the places within `reach` columns and rows of one.
    pub(super) fn round(&self, place: usize, reach: usize) -> T {
        let [columns, rows] = self.size;
        let range = |at: usize, count: usize| [at.saturating_sub(reach), (at + reach + 1).min(count)];
        let [left, right] = range(place % columns, columns);
        let [low, high] = range(place / columns, rows);
        let at = |column: usize, row: usize| self.sums[row * (columns + 1) + column];
        at(right, high) - at(left, high) - at(right, low) + at(left, low)
    }
}

impl SummedArea<i64> {
    /// For each cell, the number of things in it.
    pub(super) fn of_counts(size: [usize; 2], count: impl Fn(usize) -> usize) -> Self {
        Self::of(size, (0..size[0] * size[1]).map(|cell| (cell, count(cell) as i64)))
    }

    /// The number within `reach` cells of one.
    pub(super) fn count(&self, cell: usize, reach: usize) -> usize {
        self.round(cell, reach) as usize
    }

    /// The fewest cells, from 1 to `farthest`, within which there are at least `least` things.
    pub(super) fn reach(&self, cell: usize, least: usize, farthest: usize) -> Option<usize> {
        (1..=farthest).find(|&reach| self.count(cell, reach) >= least)
    }
}

#[cfg(test)]
mod tests {
    use super::SummedArea;

    #[test]
    fn squares_at_the_borders_and_inside_have_the_sums_of_their_places() {
        let size @ [columns, rows] = [7, 5];
        let value = |place: usize| place * place % 11;
        let sums = SummedArea::of_counts(size, value);
        for place in 0..columns * rows {
            for reach in 0..6 {
                let is_near = |other: &usize| {
                    let apart = [place % columns, place / columns]
                        .into_iter()
                        .zip([other % columns, other / columns])
                        .map(|(one, other)| one.abs_diff(other));
                    apart.max() <= Some(reach)
                };
                let expected: usize = (0..columns * rows).filter(is_near).map(value).sum();
                assert_eq!(sums.count(place, reach), expected, "within {reach} of {place}");
            }
        }
        assert_eq!(sums.reach(0, value(0) + value(1) + 1, 6), Some(1));
        assert_eq!(sums.reach(0, 10_000, 6), None);
    }
}
