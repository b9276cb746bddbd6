//! Numbers in squares of cells.

/// Sums over squares of cells, from the sums over all rectangles at a corner (Crow, Summed-area tables for texture mapping, SIGGRAPH
/// 1984).
pub(super) struct Counts {
    size: [usize; 2],
    sums: Vec<u32>,
}

impl Counts {
    /// Of so many columns and rows of cells, with the number in each.
    pub(super) fn new([columns, rows]: [usize; 2], number: impl Fn(usize) -> usize) -> Self {
        let mut sums = vec![0; (columns + 1) * (rows + 1)];
        for row in 0..rows {
            let mut in_row = 0;
            for column in 0..columns {
                in_row += number(row * columns + column) as u32;
                let corner = (row + 1) * (columns + 1) + column + 1;
                sums[corner] = sums[corner - columns - 1] + in_row;
            }
        }
        Self { size: [columns, rows], sums }
    }

    /// The sum within so many cells of one.
    pub(super) fn round(&self, cell: usize, reach: usize) -> usize {
        let [[left, right], [low, high]] = self.range(cell, reach);
        let at = |column: usize, row: usize| self.sums[row * (self.size[0] + 1) + column];
        (at(right, high) + at(left, low) - at(right, low) - at(left, high)) as usize
    }

    /// The first column and the one after the last, and the same of the rows, within so many cells of one.
    fn range(&self, cell: usize, reach: usize) -> [[usize; 2]; 2] {
        let [columns, rows] = self.size;
        let range = |at: usize, count: usize| [at.saturating_sub(reach), (at + reach + 1).min(count)];
        [range(cell % columns, columns), range(cell / columns, rows)]
    }

    /// Within how many cells, up to the `farthest`, the sum is at least so large.
    pub(super) fn reach(&self, cell: usize, least: usize, farthest: usize) -> Option<usize> {
        (1..=farthest).find(|&reach| self.round(cell, reach) >= least)
    }
}
