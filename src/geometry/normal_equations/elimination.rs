//! The order in which the unknowns of a grid are eliminated: nested dissection.
//!
//! A strip of control points, as wide as the couplings reach, separates a box of the grid into two halves that are not
//! coupled. The halves are dissected in the same way and eliminated before the strip, so that the factor of an n × n
//! grid has O(n² log n) entries and takes O(n³) operations (George, Nested dissection of a regular finite element mesh,
//! SIAM Journal on Numerical Analysis 10, 1973). Each strip, and each box that is not divided any more, is one dense
//! front of the factor (Duff & Reid, The multifrontal solution of indefinite sparse symmetric linear systems, ACM
//! Transactions on Mathematical Software 9, 1983).

use std::ops::Range;

/// Boxes with at most this number of points are not divided any more.
const LEAF: usize = 32;

/// Marks a point that is not an unknown.
const FIXED: u32 = u32::MAX;

/// The elimination order of a grid's points, and which of them are coupled by then.
#[derive(Debug, Clone)]
pub(crate) struct Elimination {
    /// The points in the order of their elimination.
    order: Vec<u32>,
    /// The position of each point in the order, or [`FIXED`].
    positions: Vec<u32>,
    /// Children before parents.
    fronts: Vec<Front>,
    /// The positions that each front is coupled to, ascending, front by front.
    rows: Vec<u32>,
}

/// Points that are eliminated together, as dense columns.
#[derive(Debug, Clone)]
struct Front {
    /// The first position after those of the front.
    end: usize,
    /// The end of its part of [`Elimination::rows`].
    rows_end: usize,
    /// Number of fronts whose remainders are added to this one.
    children: usize,
}

impl Elimination {
    /// The order for a grid of `columns` points in each row. Points for which `is_unknown` is true (by index,
    /// row by row) are unknowns. Each is coupled to those at most `reach` rows and columns from it. `None` if
    /// there is not enough memory.
    pub(crate) fn new(
        (columns, rows): (usize, usize),
        reach: usize,
        is_unknown: impl Fn(usize) -> bool,
    ) -> Option<Self> {
        let points = columns.checked_mul(rows).filter(|points| *points < FIXED as usize)?;
        let mut order = Vec::new();
        order.try_reserve_exact(points).ok()?;
        order.extend((0..points).filter(|point| is_unknown(*point)).map(|point| point as u32));
        let mut dissection = Dissection { columns, reach, leaf: LEAF, fronts: Vec::new() };
        dissection.fronts.try_reserve(2 * order.len() / LEAF).ok()?;
        dissection.divide(&mut order, 0);
        let mut positions = filled(points, FIXED)?;
        order.iter().enumerate().for_each(|(position, point)| positions[*point as usize] = position as u32);
        let mut this = Self { order, positions, fronts: dissection.fronts, rows: Vec::new() };
        this.couple(columns, reach)?;
        Some(this)
    }

    /// Finds the rows of every front: the later points to which its own are coupled, and those of its children.
    fn couple(&mut self, columns: usize, reach: usize) -> Option<()> {
        let grid_rows = self.positions.len() / columns.max(1);
        let mut found_by = filled(self.order.len(), u32::MAX)?;
        let mut waiting: Vec<usize> = Vec::new();
        let mut found = Vec::new();
        for front in 0..self.fronts.len() {
            let own = self.own(front);
            let mut find = |position: u32| {
                if position as usize >= own.end && found_by[position as usize] != front as u32 {
                    found_by[position as usize] = front as u32;
                    found.push(position);
                }
            };
            for &point in &self.order[own.clone()] {
                let (column, row) = (point as usize % columns, point as usize / columns);
                for other_row in row.saturating_sub(reach)..(row + reach + 1).min(grid_rows) {
                    let from = other_row * columns + column.saturating_sub(reach);
                    let to = other_row * columns + (column + reach + 1).min(columns);
                    self.positions[from..to]
                        .iter()
                        .filter(|position| **position != FIXED)
                        .for_each(|at| find(*at));
                }
            }
            for child in waiting.drain(waiting.len() - self.fronts[front].children..) {
                self.rows(child).iter().for_each(|position| find(*position));
            }
            waiting.push(front);
            found.sort_unstable();
            self.rows.try_reserve(found.len()).ok()?;
            self.rows.append(&mut found);
            self.fronts[front].rows_end = self.rows.len();
        }
        Some(())
    }

    /// Number of points that are unknowns.
    pub(crate) fn len(&self) -> usize {
        self.order.len()
    }

    /// The points in the order of their elimination.
    pub(crate) fn order(&self) -> &[u32] {
        &self.order
    }

    /// The position of a point in the order; `None` if it is not an unknown.
    pub(crate) fn position(&self, point: usize) -> Option<usize> {
        Some(self.positions[point]).filter(|position| *position != FIXED).map(|position| position as usize)
    }

    /// Number of fronts.
    pub(crate) fn fronts(&self) -> usize {
        self.fronts.len()
    }

    /// The positions that a front eliminates.
    pub(crate) fn own(&self, front: usize) -> Range<usize> {
        front.checked_sub(1).map_or(0, |before| self.fronts[before].end)..self.fronts[front].end
    }

    /// The later positions to which a front is coupled, ascending.
    pub(crate) fn rows(&self, front: usize) -> &[u32] {
        let start = front.checked_sub(1).map_or(0, |before| self.fronts[before].rows_end);
        &self.rows[start..self.fronts[front].rows_end]
    }

    /// For each front, the first of the fronts that are added to it, directly or through others; itself if
    /// there are none. `None` if there is not enough memory.
    pub(crate) fn starts(&self) -> Option<Vec<usize>> {
        let mut starts: Vec<usize> = Vec::new();
        starts.try_reserve_exact(self.fronts.len()).ok()?;
        for (front, Front { children, .. }) in self.fronts.iter().enumerate() {
            // Each child ends where the next one starts.
            let start = (0..*children).fold(front, |start, _| starts[start - 1]);
            starts.push(start);
        }
        Some(starts)
    }

    /// How many of the fronts before this one, and not added to others yet, are added to it.
    pub(crate) fn children(&self, front: usize) -> usize {
        self.fronts[front].children
    }
}

/// A list of equal values; `None` when there is not enough memory.
pub(super) fn filled<T: Clone>(len: usize, value: T) -> Option<Vec<T>> {
    let mut list = Vec::new();
    list.try_reserve_exact(len).ok()?;
    list.resize(len, value);
    Some(list)
}

/// The state of the dissection.
struct Dissection {
    columns: usize,
    reach: usize,
    leaf: usize,
    fronts: Vec<Front>,
}

/// A strip of columns or rows between two halves.
struct Cut {
    score: u64,
    is_across: bool,
    from: usize,
}

impl Dissection {
    /// Orders some points that start at a position of the order; returns the number of fronts that are not children
    /// of others.
    fn divide(&mut self, points: &mut [u32], start: usize) -> usize {
        if points.is_empty() {
            return 0;
        }
        let cut = if points.len() > self.leaf { self.cut(points) } else { None };
        let mut children = 0;
        if let Some(cut) = cut {
            let side = |point: &u32| {
                let at = self.coordinate(*point, cut.is_across);
                if at < cut.from { 0 } else { 1 + u8::from(at < cut.from + self.reach) }
            };
            // Stable, so that points stay in the order of the grid.
            points.sort_by_key(side);
            let left = points.partition_point(|point| side(point) < 1);
            let halves = points.partition_point(|point| side(point) < 2);
            children += self.divide(&mut points[..left], start);
            children += self.divide(&mut points[left..halves], start + left);
            if halves == points.len() {
                return children;
            }
        }
        self.fronts.push(Front { end: start + points.len(), rows_end: 0, children });
        1
    }

    fn coordinate(&self, point: u32, is_across: bool) -> usize {
        if is_across { point as usize % self.columns } else { point as usize / self.columns }
    }

    /// The best strip: few points in it, and halves of about the same size.
    fn cut(&self, points: &[u32]) -> Option<Cut> {
        let cuts = [true, false].into_iter().filter_map(|is_across| {
            let coordinates = points.iter().map(|point| self.coordinate(*point, is_across));
            let (least, most) =
                coordinates.clone().fold((usize::MAX, 0), |(least, most), at| (least.min(at), most.max(at)));
            // Number of points before each column or row.
            let mut before = vec![0; most - least + 2];
            coordinates.for_each(|at| before[at - least + 1] += 1);
            (1..before.len()).for_each(|at| before[at] += before[at - 1]);
            let score = |from: usize| {
                let to = (from + self.reach).min(before.len() - 1);
                let (left, right) = (before[from], points.len() - before[to]);
                let strip = before[to] - left;
                // Both halves are smaller than all points, so that the division ends.
                let is_cut = left.max(right) <= points.len() * 2 / 3;
                is_cut.then(|| Cut {
                    score: (strip as u64 + 1) * (left.max(right) + strip) as u64,
                    is_across,
                    from: least + from,
                })
            };
            (0..before.len() - 1).filter_map(score).min_by_key(|cut| cut.score)
        });
        cuts.min_by_key(|cut| cut.score)
            .filter(|cut| cut.score < (points.len() as u64 + 1) * points.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same by definition: eliminates point after point and couples all of its later neighbours.
    fn coupled(elimination: &Elimination, columns: usize, reach: usize) -> Vec<Vec<bool>> {
        let count = elimination.len();
        let place = |position: usize| {
            let point = elimination.order()[position] as usize;
            (point % columns, point / columns)
        };
        let is_near = |a: usize, b: usize| {
            let ((a_column, a_row), (b_column, b_row)) = (place(a), place(b));
            a_column.abs_diff(b_column) <= reach && a_row.abs_diff(b_row) <= reach
        };
        let mut coupled: Vec<Vec<bool>> =
            (0..count).map(|a| (0..count).map(|b| is_near(a, b)).collect()).collect();
        for pivot in 0..count {
            let later: Vec<usize> = (pivot + 1..count).filter(|at| coupled[pivot][*at]).collect();
            for &a in &later {
                later.iter().for_each(|&b| coupled[a][b] = true);
            }
        }
        coupled
    }

    #[test]
    fn the_rows_of_a_front_are_the_points_that_its_elimination_couples() {
        let all = |_: usize| true;
        let hole = |point: usize| !(4..9).contains(&(point % 17)) || !(3..11).contains(&(point / 17));
        let scattered = |point: usize| point * 7919 % 5 > 1;
        for (size, reach, is_unknown) in [
            ((17, 14), 3, &all as &dyn Fn(usize) -> bool),
            ((17, 14), 1, &all),
            ((17, 14), 3, &hole),
            ((17, 14), 3, &scattered),
            ((60, 1), 3, &all),
            ((1, 60), 3, &all),
            ((40, 4), 3, &all),
            ((2, 2), 3, &all),
            ((9, 9), 3, &|_| false),
        ] {
            let elimination = Elimination::new(size, reach, is_unknown).unwrap();
            let mut seen: Vec<usize> = elimination.order().iter().map(|point| *point as usize).collect();
            seen.sort_unstable();
            assert!(seen.into_iter().eq((0..size.0 * size.1).filter(|point| is_unknown(*point))));
            let coupled = coupled(&elimination, size.0, reach);
            for front in 0..elimination.fronts() {
                let own = elimination.own(front);
                let later = own.end..elimination.len();
                let truth = later.filter(|at| own.clone().any(|point| coupled[point][*at]));
                assert!(truth.eq(elimination.rows(front).iter().map(|at| *at as usize)));
            }
        }
    }

    #[test]
    fn the_order_of_a_square_grid_takes_few_operations() {
        // George's bound for separators of one row, 31/4 n² log₂ n entries, for blocks of 3 × 3 points: 9 entries each.
        let n = 150usize;
        let elimination = Elimination::new((n, n), 3, |_| true).unwrap();
        let entries: usize = (0..elimination.fronts())
            .map(|front| {
                let own = elimination.own(front).len();
                own * (own + 1) / 2 + own * elimination.rows(front).len()
            })
            .sum();
        let blocks = n as f64 / 3.0;
        assert!((entries as f64) < 81.0 * 31.0 / 4.0 * blocks * blocks * blocks.log2());
    }

    #[test]
    fn a_grid_with_too_many_points_is_refused() {
        assert!(Elimination::new((1 << 20, 1 << 20), 3, |_| true).is_none());
        assert!(Elimination::new((usize::MAX, 2), 3, |_| true).is_none());
    }
}
