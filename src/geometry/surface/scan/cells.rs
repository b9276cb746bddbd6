//! Square cells over the points of a scan, as the laser sees them.

use nalgebra::{Point3, Vector2};

use crate::geometry::space::Extents;
use crate::geometry::surface::summed_area::SummedArea;

/// Side of a cell in units of the point spacing: any square lattice then has a point in every cell.
pub(super) const CELL: f64 = 1.5;

/// Ratio of the standard deviation of a normal distribution to the median of its absolute values.
pub(super) const TO_DEVIATION: f64 = 1.482_602_218_505_602;

/// At least this many points round a place are needed to show the distance between points there.
const SHOW_SPACING: usize = 24;
/// The points that show their distance are searched for within these numbers of cells of the place, from the
/// first to the second. Within the first, the cells that the edge of a hole divides hardly matter. Beyond the
/// second, points are strays.
const SPACING_CELLS: [usize; 2] = [5, 10];
/// Points are sparse if they are at least this many times as far apart as usual. Less is chance.
const SPARSE: f64 = 1.4;
/// Sparse points are at most this many times as far apart as usual. Where the distance is larger, there is a
/// gap.
const FARTHEST_APART: f64 = 5.0;

/// Square cells over the view with the points in each, the uppermost first.
pub(super) struct Cells {
    origin: Vector2<f64>,
    side: f64,
    columns: usize,
    rows: usize,
    starts: Vec<usize>,
    order: Vec<u32>,
}

impl Cells {
    /// The points that are `inside`, in cells with a side, mm.
    pub(super) fn new(points: &[Point3<f64>], inside: &[u32], side: f64) -> Self {
        let extents = extents_of(points, inside);
        let size = extents.size();
        let (columns, rows) = ((size.x / side) as usize + 1, (size.y / side) as usize + 1);
        let cell_of = |at: u32| {
            let place = (points[at as usize].coords.xy() - extents.min) / side;
            place.y as usize * columns + place.x as usize
        };
        let mut starts = vec![0; columns * rows + 1];
        inside.iter().for_each(|&at| starts[cell_of(at) + 1] += 1);
        (0..columns * rows).for_each(|cell| starts[cell + 1] += starts[cell]);
        let (mut next, mut order) = (starts.clone(), vec![0; inside.len()]);
        for &at in inside {
            let cell = cell_of(at);
            order[next[cell]] = at;
            next[cell] += 1;
        }
        for cell in 0..columns * rows {
            let upper_first = |a: &u32, b: &u32| points[*b as usize].z.total_cmp(&points[*a as usize].z);
            order[starts[cell]..starts[cell + 1]].sort_by(upper_first);
        }
        Self { origin: extents.min, side, columns, rows, starts, order }
    }

    /// Distance between points, mm.
    pub(super) fn spacing(&self) -> f64 {
        self.side / CELL
    }

    /// Distance between points round each cell, mm, if `chosen` gives the number of points in it: that of points spread evenly over
    /// the cells which have some.
    pub(super) fn local_spacings(&self, chosen: &[usize]) -> Vec<f64> {
        let local = |cell: usize| {
            let [mut count, mut filled] = [0usize; 2];
            for near in self.window(cell) {
                count += chosen[near];
                filled += usize::from(chosen[near] > 0);
            }
            self.side * (filled as f64 / count.max(1) as f64).sqrt()
        };
        (0..self.count()).map(local).collect()
    }

    /// How many times as far apart as usual the points round each cell are; `chosen` returns the number of
    /// points in a cell. 1 if they are not notably sparse. The number of random points in the cells that have
    /// some shows how many cells are empty by chance, so that an edge of the scan is not treated as a sparse
    /// place. Points of a lattice leave no cell empty by chance: there are at least as many as in the cells
    /// at and beside points on average.
    pub(super) fn sparseness(&self, chosen: impl Fn(usize) -> usize) -> Vec<f64> {
        let points = SummedArea::of_counts(self.size(), &chosen);
        let filled = SummedArea::of_counts(self.size(), |cell| usize::from(chosen(cell) > 0));
        let is_beside = |cell: usize| self.window(cell).any(|near| chosen(near) > 0);
        let beside = SummedArea::of_counts(self.size(), |cell| usize::from(is_beside(cell)));
        let [nearest, farthest] = SPACING_CELLS;
        let local = |cell: usize| {
            let Some(reach) = points.reach(cell, SHOW_SPACING, farthest) else { return 1.0 };
            let reach = reach.max(nearest);
            let count = points.count(cell, reach) as f64;
            let by_chance = mean_of_all(count / filled.count(cell, reach) as f64);
            let apart = CELL / by_chance.max(count / beside.count(cell, reach) as f64).sqrt();
            if apart < SPARSE { 1.0 } else { apart.min(FARTHEST_APART) }
        };
        let local: Vec<f64> = (0..self.count()).map(local).collect();
        // Beside denser points, these are among those that show the distance.
        let largest_in_row = |cell: usize| {
            let (row, column) = (cell - cell % self.columns, cell % self.columns);
            let range = row + column.saturating_sub(nearest)..row + (column + nearest + 1).min(self.columns);
            local[range].iter().copied().fold(1.0, f64::max)
        };
        let in_rows: Vec<f64> = (0..self.count()).map(largest_in_row).collect();
        let largest = |cell: usize| {
            let (row, column) = (cell / self.columns, cell % self.columns);
            let rows = row.saturating_sub(nearest)..(row + nearest + 1).min(self.rows);
            rows.map(|row| in_rows[row * self.columns + column]).fold(1.0, f64::max)
        };
        (0..self.count()).map(largest).collect()
    }

    /// The cell in which a place of the view is.
    pub(super) fn cell_at(&self, at: Vector2<f64>) -> Option<usize> {
        let [column, row] = [0, 1].map(|axis| (at[axis] - self.origin[axis]) / self.side);
        let is_inside = column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        is_inside.then_some(row as usize * self.columns + column as usize)
    }

    /// Side of a cell, mm.
    pub(super) fn side(&self) -> f64 {
        self.side
    }

    /// Longer side of all cells together, mm.
    pub(super) fn longer(&self) -> f64 {
        self.side * self.columns.max(self.rows) as f64
    }

    /// Number of cells along x and y.
    pub(super) fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Number of cells.
    pub(super) fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// The points in a cell, the uppermost first.
    pub(super) fn points(&self, cell: usize) -> &[u32] {
        &self.order[self.starts[cell]..self.starts[cell + 1]]
    }

    /// The cell `right` columns and `up` rows away.
    pub(super) fn neighbour(&self, cell: usize, right: isize, up: isize) -> Option<usize> {
        let column = (cell % self.columns).checked_add_signed(right).filter(|&at| at < self.columns)?;
        let row = (cell / self.columns).checked_add_signed(up).filter(|&at| at < self.rows)?;
        Some(row * self.columns + column)
    }

    /// The cells within `reach` cells of one, from below.
    pub(super) fn square(&self, cell: usize, reach: usize) -> impl Iterator<Item = usize> {
        let range = |at: usize, count: usize| at.saturating_sub(reach)..(at + reach + 1).min(count);
        let columns = range(cell % self.columns, self.columns);
        let rows = range(cell / self.columns, self.rows);
        rows.flat_map(move |row| columns.clone().map(move |column| row * self.columns + column))
    }

    /// A cell and the up to eight cells round it.
    pub(super) fn window(&self, cell: usize) -> impl Iterator<Item = usize> {
        let offsets = (-1..=1).flat_map(|up| (-1..=1).map(move |right| (right, up)));
        offsets.filter_map(move |(right, up)| self.neighbour(cell, right, up))
    }
}

/// The mean number of random points in a cell, if that in the cells that have some is `in_filled`: m / (1 − exp(−m)) for a Poisson
/// distribution.
fn mean_of_all(in_filled: f64) -> f64 {
    // Newton's method from above, where the function is convex.
    (0..20).fold(in_filled, |mean, _| {
        let empty = (-mean).exp();
        let (value, slope) = (mean - in_filled * (1.0 - empty), 1.0 - in_filled * empty);
        if slope > 1e-9 { (mean - value / slope).max(1e-3) } else { mean }
    })
}

/// The extents of the points that are `inside`, in the view.
pub(super) fn extents_of(points: &[Point3<f64>], inside: &[u32]) -> Extents {
    Extents::of(inside.iter().map(|&at| points[at as usize].coords.xy())).grown(1e-9)
}

/// The upper median; `None` without values.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The bit of the octant in which a direction is, anticlockwise.
pub(super) fn octant(to: Vector2<f64>) -> u8 {
    let is_wide = to.x.abs() >= to.y.abs();
    1 << match (to.x >= 0.0, to.y >= 0.0) {
        (true, true) => usize::from(!is_wide),
        (false, true) => 2 + usize::from(is_wide),
        (false, false) => 4 + usize::from(!is_wide),
        (true, false) => 6 + usize::from(is_wide),
    }
}

/// Whether there are points in all four quadrants, or no three octants in a row are empty: either way, every
/// half-plane has points.
pub(super) fn is_surrounded(octants: u8) -> bool {
    let empty = !octants;
    let has_empty_quadrant = (0..4).any(|quadrant| octants >> (2 * quadrant) & 0b11 == 0);
    !has_empty_quadrant || empty & empty.rotate_left(1) & empty.rotate_left(2) == 0
}
