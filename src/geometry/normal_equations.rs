//! Least squares over a tensor grid of control points: sparse normal equations and their solution.
//!
//! The surface fit and the length-true map both solve for the control points of a bicubic B-spline. Both lead to a
//! symmetric positive definite matrix in which a control point is coupled only to its neighbours within three rows and
//! columns.

pub(crate) mod elimination;
pub(crate) mod factor;

use std::ops::Range;

use multiversion::multiversion;

use self::elimination::Elimination;
use self::factor::{Couplings, Factor, FactorError};
use crate::geometry::fork::{Fork, InTurn, join};

/// A control point is coupled to its neighbours within this number of rows and columns.
const REACH: usize = 3;

/// Equations with fewer unknowns are solved with the factor faster than they are shared among threads.
const LEAST_SHARED: usize = 2_000;

/// The control point itself, then its neighbours that follow it row by row: (columns, rows) to the right and up.
const STENCIL: [(isize, isize); 25] = {
    let mut offsets = [(0, 0); 25];
    let mut next = 0;
    let mut row = 0;
    while row <= 3 {
        let mut column = if row == 0 { 0 } else { -3 };
        while column <= 3 {
            offsets[next] = (column, row);
            next += 1;
            column += 1;
        }
        row += 1;
    }
    offsets
};

/// Position in [`STENCIL`] of the neighbour `column` to the right and `row` up, which must not precede the point
/// itself.
const fn stencil_index(column: isize, row: isize) -> usize {
    if row == 0 { column as usize } else { (row * 7 + column) as usize }
}

/// The third difference of four values.
const THIRD_DIFFERENCE: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];

/// The normal equations AᵀA x = Aᵀb over a grid of control points with `COMPONENTS` unknowns each.
#[derive(Debug, Clone)]
pub struct NormalEquations<const COMPONENTS: usize> {
    columns: usize,
    rows: usize,
    matrix: Vec<[[[f64; COMPONENTS]; COMPONENTS]; STENCIL.len()]>,
    right: Vec<[f64; COMPONENTS]>,
}

/// The equations of some rows of control points.
#[derive(Debug)]
pub(crate) struct EquationRows<'e, const COMPONENTS: usize> {
    columns: usize,
    rows: Range<usize>,
    matrix: &'e mut [[[[f64; COMPONENTS]; COMPONENTS]; STENCIL.len()]],
    right: &'e mut [[f64; COMPONENTS]],
}

/// Why the equations could not be solved.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The matrix is not positive definite: the data do not determine the control points.
    #[error("the data do not determine the {unknowns} unknowns of the fit")]
    NotPositiveDefinite {
        /// Number of unknowns.
        unknowns: usize,
    },
    /// The solution does not satisfy the equations.
    #[error("the solution of {unknowns} equations has a relative residual of {residual:.1e}")]
    Inaccurate {
        /// Number of unknowns.
        unknowns: usize,
        /// ‖Ax − b‖ / ‖b‖.
        residual: f64,
    },
    /// There is not enough memory.
    #[error("not enough memory to solve for {unknowns} unknowns")]
    OutOfMemory {
        /// Number of unknowns, or of all components of the grid when their elimination order does not fit.
        unknowns: usize,
    },
}

/// The elimination order of a grid, computed once and used for every matrix on it.
#[derive(Debug, Clone)]
pub struct GridSolver<'f, const COMPONENTS: usize> {
    columns: usize,
    rows: usize,
    elimination: Elimination,
    fork: &'f dyn Fork,
}

/// Numbers at the start of a line of the processor's cache.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Aligned<T>(T);

/// One observation that depends on the 4 × 4 control points of a cell: its derivative by each of their components.
pub type CellRow<const COMPONENTS: usize> = [[f64; COMPONENTS]; 16];

/// Observations of one cell, summed before they are added to the grid: 16 control points fit into the CPU's cache.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct CellSum<const COMPONENTS: usize> {
    /// For each component of each control point, its line of the matrix. Values before the diagonal are not
    /// used.
    matrix: [[[[f64; COMPONENTS]; 16]; COMPONENTS]; 16],
    right: [[f64; COMPONENTS]; 16],
}

impl<const COMPONENTS: usize> Default for CellSum<COMPONENTS> {
    fn default() -> Self {
        Self { matrix: [[[[0.0; COMPONENTS]; 16]; COMPONENTS]; 16], right: [[0.0; COMPONENTS]; 16] }
    }
}

impl<const COMPONENTS: usize> CellSum<COMPONENTS> {
    /// Adds the observation `row · x = value` with a weight.
    pub fn add(&mut self, row: &CellRow<COMPONENTS>, value: f64, weight: f64) {
        for first in 0..16 {
            for component in 0..COMPONENTS {
                let scaled = weight * row[first][component];
                self.right[first][component] += scaled * value;
                for second in first..16 {
                    for other in 0..COMPONENTS {
                        self.matrix[first][component][second][other] += scaled * row[second][other];
                    }
                }
            }
        }
    }
}

/// Observations at one place, summed before they are added to the control points: each is given by its derivatives by
/// `PARTS` quantities, such as a value and its slopes, that depend linearly on the 16 control points.
#[derive(Debug, Clone)]
pub struct ComposedSum<const PARTS: usize, const COMPONENTS: usize> {
    matrix: [[[[f64; COMPONENTS]; COMPONENTS]; PARTS]; PARTS],
    right: [[f64; COMPONENTS]; PARTS],
}

impl<const PARTS: usize, const COMPONENTS: usize> Default for ComposedSum<PARTS, COMPONENTS> {
    fn default() -> Self {
        Self { matrix: [[[[0.0; COMPONENTS]; COMPONENTS]; PARTS]; PARTS], right: [[0.0; COMPONENTS]; PARTS] }
    }
}

impl<const PARTS: usize, const COMPONENTS: usize> ComposedSum<PARTS, COMPONENTS> {
    /// Adds the observation `derivative · quantities = value` with a weight.
    #[inline(always)]
    pub fn add(&mut self, derivative: &[[f64; COMPONENTS]; PARTS], value: f64, weight: f64) {
        for part in 0..PARTS {
            for component in 0..COMPONENTS {
                let scaled = weight * derivative[part][component];
                self.right[part][component] += scaled * value;
                for other_part in 0..PARTS {
                    for other in 0..COMPONENTS {
                        self.matrix[part][other_part][component][other] +=
                            scaled * derivative[other_part][other];
                    }
                }
            }
        }
    }
}

impl<const COMPONENTS: usize> CellSum<COMPONENTS> {
    /// Adds the observations at a place where control point i contributes `basis[part][i]` to a quantity.
    #[inline(always)]
    pub fn add_composed<const PARTS: usize>(
        &mut self,
        observed: &ComposedSum<PARTS, COMPONENTS>,
        basis: &[[f64; 16]; PARTS],
    ) {
        let spread: Aligned<[[[[f64; COMPONENTS]; 4]; PARTS]; 4]> = Aligned(std::array::from_fn(|chunk| {
            std::array::from_fn(|part| {
                std::array::from_fn(|second| [basis[part][4 * chunk + second]; COMPONENTS])
            })
        }));
        for first in 0..16 {
            let mut row = [[[0.0; COMPONENTS]; COMPONENTS]; PARTS];
            for part in 0..PARTS {
                let share = basis[part][first];
                for component in 0..COMPONENTS {
                    self.right[first][component] += share * observed.right[part][component];
                    for other_part in 0..PARTS {
                        for other in 0..COMPONENTS {
                            row[other_part][component][other] +=
                                share * observed.matrix[part][other_part][component][other];
                        }
                    }
                }
            }
            for component in 0..COMPONENTS {
                let turned = row.map(|part| [part[component]; 4]);
                // From the start of the row of control points: parts of equal length fill the registers of any processor.
                let (line, _) = self.matrix[first][component].as_chunks_mut::<4>();
                for (chunk, values) in line.iter_mut().enumerate().skip(first / 4) {
                    let mut sum = *values;
                    for part in 0..PARTS {
                        for second in 0..4 {
                            for other in 0..COMPONENTS {
                                sum[second][other] +=
                                    spread.0[chunk][part][second][other] * turned[part][second][other];
                            }
                        }
                    }
                    *values = sum;
                }
            }
        }
    }
}

impl<const COMPONENTS: usize> EquationRows<'_, COMPONENTS> {
    /// Whether a cell whose lower left control point is in a row has control points here.
    pub(crate) fn touch(&self, row: usize) -> bool {
        row < self.rows.end && self.rows.start < row + 4
    }

    /// Adds what the observations of the cell whose lower left control point is (`column`, `row`) contribute to these rows.
    #[inline(always)]
    pub(crate) fn add_cell(&mut self, column: usize, row: usize, sum: &CellSum<COMPONENTS>) {
        for first in 0..16 {
            let (i, j) = (first % 4, first / 4);
            if !self.rows.contains(&(row + j)) {
                continue;
            }
            let point = (row + j - self.rows.start) * self.columns + column + i;
            for component in 0..COMPONENTS {
                self.right[point][component] += sum.right[first][component];
            }
            for second in first..16 {
                let (k, l) = (second % 4, second / 4);
                let neighbour = stencil_index(k as isize - i as isize, l as isize - j as isize);
                let block = &mut self.matrix[point][neighbour];
                for component in 0..COMPONENTS {
                    for other in 0..COMPONENTS {
                        block[component][other] += sum.matrix[first][component][second][other];
                    }
                }
            }
        }
    }
}

impl<const COMPONENTS: usize> NormalEquations<COMPONENTS> {
    /// Empty equations for `columns` × `rows` control points.
    pub fn new(columns: usize, rows: usize) -> Self {
        let points = columns * rows;
        Self {
            columns,
            rows,
            matrix: vec![[[[0.0; COMPONENTS]; COMPONENTS]; STENCIL.len()]; points],
            right: vec![[0.0; COMPONENTS]; points],
        }
    }

    /// Adds the observations of the cell whose lower left control point is (`column`, `row`).
    #[inline(always)]
    pub fn add_cell(&mut self, column: usize, row: usize, sum: &CellSum<COMPONENTS>) {
        let (rows, matrix, right) = (0..self.rows, &mut self.matrix[..], &mut self.right[..]);
        EquationRows { columns: self.columns, rows, matrix, right }.add_cell(column, row, sum);
    }

    /// Calls `add` for halves of the equations, which `fork` may fill at once: it must add each cell to each half that the cell
    /// touches ([`EquationRows::touch`]).
    pub(crate) fn fill(&mut self, fork: &dyn Fork, add: &(impl Fn(&mut EquationRows<COMPONENTS>) + Sync)) {
        let (columns, middle) = (self.columns, self.rows / 2);
        let (low, high) = self.matrix.split_at_mut(middle * columns);
        let (right_low, right_high) = self.right.split_at_mut(middle * columns);
        let mut low = EquationRows { columns, rows: 0..middle, matrix: low, right: right_low };
        let mut high = EquationRows { columns, rows: middle..self.rows, matrix: high, right: right_high };
        join(fork, || add(&mut low), || add(&mut high));
    }

    /// Calls `low` with the equations of the rows below the end of `shared`, and `high` with those from its
    /// start on. Both add to the rows that they share. `fork` may do both at once.
    pub(crate) fn fill_halves(
        &mut self,
        fork: &dyn Fork,
        shared: Range<usize>,
        low: impl FnOnce(&mut EquationRows<COMPONENTS>) + Send,
        high: impl FnOnce(&mut [EquationRows<COMPONENTS>; 2]) + Send,
    ) {
        let (columns, rows) = (self.columns, self.rows);
        let mut of_high = Self::new(columns, shared.len());
        let (below, above) = self.matrix.split_at_mut(shared.end * columns);
        let (right_below, right_above) = self.right.split_at_mut(shared.end * columns);
        let mut below = EquationRows { columns, rows: 0..shared.end, matrix: below, right: right_below };
        let Self { matrix, right, .. } = &mut of_high;
        let mut above = [
            EquationRows { columns, rows: shared.clone(), matrix, right },
            EquationRows { columns, rows: shared.end..rows, matrix: above, right: right_above },
        ];
        join(fork, || low(&mut below), || high(&mut above));
        let points = shared.start * columns..shared.end * columns;
        let sums = self.matrix[points.clone()].as_flattened_mut().as_flattened_mut().as_flattened_mut();
        let parts = of_high.matrix.as_flattened().as_flattened().as_flattened();
        sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        let sums = self.right[points].as_flattened_mut();
        sums.iter_mut().zip(of_high.right.as_flattened()).for_each(|(sum, part)| *sum += part);
    }

    /// The right-hand side Aᵀb, row by row.
    pub fn right(&self) -> &[[f64; COMPONENTS]] {
        &self.right
    }

    /// Adds `weight` times the square of the third difference along each row and column, for every component. It
    /// vanishes on quadratics, so it continues a surface smoothly where there are no data and hardly changes it where
    /// there are (Eilers & Marx, Flexible smoothing with B-splines and penalties, Statistical Science 1996, eq. 4).
    pub fn add_third_difference_penalty(&mut self, weight: f64) {
        let mut matrix = std::mem::take(&mut self.matrix);
        self.for_each_third_difference(|points| {
            let is_along_row = points[1] == points[0] + 1;
            for first in 0..4 {
                for second in first..4 {
                    let apart = (second - first) as isize;
                    let neighbour =
                        if is_along_row { stencil_index(apart, 0) } else { stencil_index(0, apart) };
                    let block = &mut matrix[points[first]][neighbour];
                    for component in 0..COMPONENTS {
                        block[component][component] +=
                            weight * THIRD_DIFFERENCE[first] * THIRD_DIFFERENCE[second];
                    }
                }
            }
        });
        self.matrix = matrix;
    }

    /// Adds the square of the third derivative in every direction, in differences of the control points:
    /// ∂³x² + 3 (∂²x ∂y)² + 3 (∂x ∂²y)² + ∂³y², for every component. It has no preferred direction and vanishes on
    /// quadratics (Wahba, Spline models for observational data, 1990, eq. 2.4.9, for m = 3; as differences after
    /// Eilers & Marx 1996). `weight` gives the weight at a place, in units of control points along x and y.
    pub fn add_roughness_penalty(&mut self, weight: impl Fn(f64, f64) -> f64) {
        const DIFFERENCES: [&[f64]; 4] = [&[1.0], &[-1.0, 1.0], &[1.0, -2.0, 1.0], &THIRD_DIFFERENCE];
        for (along, share) in [(3, 1.0), (2, 3.0), (1, 3.0), (0, 1.0)] {
            let (across_columns, across_rows) = (DIFFERENCES[along], DIFFERENCES[3 - along]);
            let points: Vec<(usize, usize, f64)> = (0..across_rows.len())
                .flat_map(|row| (0..across_columns.len()).map(move |column| (column, row)))
                .map(|(column, row)| (column, row, across_columns[column] * across_rows[row]))
                .collect();
            for row in 0..(self.rows + 1).saturating_sub(across_rows.len()) {
                for column in 0..(self.columns + 1).saturating_sub(across_columns.len()) {
                    let middle = |from: usize, differences: usize| from as f64 + differences as f64 / 2.0;
                    let weight = share * weight(middle(column, along), middle(row, 3 - along));
                    for (index, first) in points.iter().enumerate() {
                        let point = (row + first.1) * self.columns + column + first.0;
                        for second in &points[index..] {
                            let (right, up) =
                                (second.0 as isize - first.0 as isize, (second.1 - first.1) as isize);
                            let block = &mut self.matrix[point][stencil_index(right, up)];
                            for component in 0..COMPONENTS {
                                block[component][component] += weight * first.2 * second.2;
                            }
                        }
                    }
                }
            }
        }
    }

    /// The control points that satisfy the equations, row by row; those that are not unknowns of the solver are 0.
    ///
    /// # Errors
    /// See [`SolveError`]; the residual of every solution is checked.
    ///
    /// # Panics
    /// Never, if `solver` was made for the same grid.
    pub fn solve(&self, solver: &GridSolver<'_, COMPONENTS>) -> Result<Vec<[f64; COMPONENTS]>, SolveError> {
        let mut solution = [self.right.clone()];
        self.solve_each(solver, &mut solution)?;
        let [solution] = solution;
        Ok(solution)
    }

    /// Replaces each of several right-hand sides, row by row, by the control points that satisfy the equations with
    /// it; those that are not unknowns of the solver become 0.
    ///
    /// # Errors
    /// See [`SolveError`]; the residual of every solution is checked.
    ///
    /// # Panics
    /// Never, if `solver` was made for the same grid and each right-hand side has its length.
    pub fn solve_each(
        &self,
        solver: &GridSolver<'_, COMPONENTS>,
        rights: &mut [Vec<[f64; COMPONENTS]>],
    ) -> Result<(), SolveError> {
        let factor = self.factored(solver)?;
        for right in rights {
            *right = self.solution(solver, &factor, right)?;
        }
        Ok(())
    }

    /// [`Self::solve`] for equations that hold a third-difference penalty of this `weight`
    /// ([`Self::add_third_difference_penalty`]), so that the penalty hardly applies to the solution. The
    /// equations are solved in `passes` passes. Each pass starts from the solution of the one before
    /// (iterated Tikhonov regularisation: Engl, Hanke & Neubauer, Regularization of inverse problems, 1996,
    /// sec. 5.1).
    ///
    /// # Errors
    /// See [`SolveError`].
    pub(crate) fn solve_in_passes(
        &self,
        solver: &GridSolver<'_, COMPONENTS>,
        weight: f64,
        passes: usize,
    ) -> Result<Vec<[f64; COMPONENTS]>, SolveError> {
        let factor = self.factored(solver)?;
        let mut solution = self.solution(solver, &factor, &self.right)?;
        let mut last = solution.clone();
        for _ in 1..passes {
            // The residual of the equations without the penalty is the pull of the penalty.
            last = self.solution(solver, &factor, &self.third_difference_pull(&last, weight))?;
            let (sum, last) = (solution.as_flattened_mut(), last.as_flattened());
            sum.iter_mut().zip(last).for_each(|(sum, last)| *sum += last);
        }
        Ok(solution)
    }

    /// The product of the matrix of a third-difference penalty with a solution.
    fn third_difference_pull(&self, solution: &[[f64; COMPONENTS]], weight: f64) -> Vec<[f64; COMPONENTS]> {
        let mut pull = vec![[0.0; COMPONENTS]; solution.len()];
        self.for_each_third_difference(|points| {
            for component in 0..COMPONENTS {
                let terms = points.iter().zip(THIRD_DIFFERENCE);
                let difference: f64 = terms.map(|(point, share)| share * solution[*point][component]).sum();
                for (point, share) in points.iter().zip(THIRD_DIFFERENCE) {
                    pull[*point][component] += weight * share * difference;
                }
            }
        });
        pull
    }

    /// Visits the control points of every third difference along a row or column.
    fn for_each_third_difference(&self, mut visit: impl FnMut([usize; 4])) {
        for row in 0..self.rows {
            for column in 0..self.columns {
                let first = row * self.columns + column;
                if column + 3 < self.columns {
                    visit([0, 1, 2, 3].map(|step| first + step));
                }
                if row + 3 < self.rows {
                    visit([0, 1, 2, 3].map(|step| first + step * self.columns));
                }
            }
        }
    }

    fn factored<'s>(
        &self,
        solver: &'s GridSolver<'_, COMPONENTS>,
    ) -> Result<Factor<'s, COMPONENTS, 1>, SolveError> {
        assert_eq!((solver.columns, solver.rows), (self.columns, self.rows), "solver made for another grid");
        let unknowns = solver.elimination.len() * COMPONENTS;
        Factor::new(&solver.elimination, self, solver.fork).map_err(|error| match error {
            FactorError::Pivot => SolveError::NotPositiveDefinite { unknowns },
            FactorError::Memory => SolveError::OutOfMemory { unknowns },
        })
    }

    fn solution(
        &self,
        solver: &GridSolver<'_, COMPONENTS>,
        factor: &Factor<'_, COMPONENTS, 1>,
        right: &[[f64; COMPONENTS]],
    ) -> Result<Vec<[f64; COMPONENTS]>, SolveError> {
        assert_eq!(right.len(), self.right.len(), "right-hand side of another grid");
        let elimination = &solver.elimination;
        let unknowns = elimination.len() * COMPONENTS;
        let given = elimination.order().iter().map(|point| right[*point as usize]);
        let mut solution: Vec<[f64; COMPONENTS]> = given.collect();
        let fork: &dyn Fork = if unknowns < LEAST_SHARED { &InTurn } else { solver.fork };
        factor.solve(&mut solution, fork);
        let mut found = vec![[0.0; COMPONENTS]; right.len()];
        elimination.order().iter().zip(solution).for_each(|(point, value)| found[*point as usize] = value);
        let residual = self.relative_residual(solver, right, &found, fork);
        // The matrix squares the condition number of the observations; 1e-7 of the right-hand side is far below
        // 1e-6 mm.
        if !(residual <= 1e-7) {
            return Err(SolveError::Inaccurate { unknowns, residual });
        }
        Ok(found)
    }

    /// ‖Ax − b‖ / ‖b‖ over the unknowns.
    fn relative_residual(
        &self,
        solver: &GridSolver<'_, COMPONENTS>,
        right: &[[f64; COMPONENTS]],
        solution: &[[f64; COMPONENTS]],
        fork: &dyn Fork,
    ) -> f64 {
        // A margin of zeros takes the place of neighbours outside the grid, whose blocks are zero.
        let width = self.columns + 2 * REACH;
        let padded = |of: &[[f64; COMPONENTS]]| {
            let mut padded = vec![[0.0; COMPONENTS]; of.len() / self.columns * width + REACH * width];
            for (line, to) in of.chunks(self.columns).zip(padded.chunks_mut(width)) {
                to[REACH..REACH + self.columns].copy_from_slice(line);
            }
            padded
        };
        // What the lower rows leave of the upper ones is in the margin above them.
        let (solution, middle) = (padded(solution), self.rows / 2);
        let (low, high) = (0..middle, middle..self.rows);
        let rest_of = |rows: Range<usize>| {
            let points = rows.start * self.columns..rows.end * self.columns;
            let mut rest = padded(&right[points.clone()]);
            subtract_product(&self.matrix[points], self.columns, &solution[rows.start * width..], &mut rest);
            rest
        };
        let (mut rest, above) = join(fork, || rest_of(low), || rest_of(high));
        let margin = rest.split_off(middle * width);
        rest.extend(above);
        for (sum, part) in rest[middle * width..].as_flattened_mut().iter_mut().zip(margin.as_flattened()) {
            *sum += part;
        }
        let order = solver.elimination.order();
        let norm = |square: &dyn Fn(usize) -> f64| {
            order.iter().map(|point| square(*point as usize)).sum::<f64>().sqrt()
        };
        let square = |of: &[f64; COMPONENTS]| of.iter().map(|value| value * value).sum();
        let at = |point: usize| point / self.columns * width + REACH + point % self.columns;
        let (scale, norm) = (norm(&|point| square(&right[point])), norm(&|point| square(&rest[at(point)])));
        if scale == 0.0 { norm } else { norm / scale }
    }

    /// Which neighbours of a point are inside the grid.
    fn within(&self, point: usize) -> Within {
        let (column, row) = (point % self.columns, point / self.columns);
        let left = column.min(REACH) as isize;
        let right = (self.columns - 1 - column).min(REACH) as isize;
        let [down, up] = [row, self.rows - 1 - row].map(|apart| apart.min(REACH) as isize);
        Within { columns: self.columns as isize, left, right, down, up }
    }

    /// How much a solution lowers the weighted sum of squares of the observations.
    pub fn gain(&self, solution: &[[f64; COMPONENTS]]) -> f64 {
        self.right.as_flattened().iter().zip(solution.as_flattened()).map(|(right, x)| right * x).sum()
    }
}

/// Subtracts the product of a symmetric matrix over a grid with a vector. Both vectors have a margin of [`REACH`] points beside and
/// above the grid.
#[multiversion(targets("x86_64+avx2"))]
fn subtract_product<const COMPONENTS: usize>(
    matrix: &[[[[f64; COMPONENTS]; COMPONENTS]; STENCIL.len()]],
    columns: usize,
    vector: &[[f64; COMPONENTS]],
    from: &mut [[f64; COMPONENTS]],
) {
    let width = columns + 2 * REACH;
    for (row, line) in matrix.chunks(columns).enumerate() {
        for (column, blocks) in line.iter().enumerate() {
            let point = row * width + REACH + column;
            let value = vector[point];
            for (block, (right, up)) in blocks.iter().zip(STENCIL) {
                let other = point.wrapping_add_signed(up * width as isize + right);
                let across = vector[other];
                for component in 0..COMPONENTS {
                    for along in 0..COMPONENTS {
                        from[point][component] -= block[component][along] * across[along];
                    }
                }
                if other != point {
                    for along in 0..COMPONENTS {
                        for component in 0..COMPONENTS {
                            from[other][along] -= block[component][along] * value[component];
                        }
                    }
                }
            }
        }
    }
}

/// How many columns and rows of the grid are beside a point, up to [`REACH`].
struct Within {
    columns: isize,
    left: isize,
    right: isize,
    down: isize,
    up: isize,
}

impl Within {
    /// A point's neighbour in the stencil.
    fn neighbour(&self, point: usize, neighbour: usize) -> Option<usize> {
        let (right, up) = STENCIL[neighbour];
        let is_inside = -self.left <= right && right <= self.right && up <= self.up;
        is_inside.then(|| point.wrapping_add_signed(up * self.columns + right))
    }

    /// The point whose neighbour in the stencil is this one.
    fn opposite(&self, point: usize, neighbour: usize) -> Option<usize> {
        let (right, up) = STENCIL[neighbour];
        let is_inside = -self.left <= -right && -right <= self.right && up <= self.down;
        is_inside.then(|| point.wrapping_add_signed(-(up * self.columns + right)))
    }
}

impl<const COMPONENTS: usize> Couplings<COMPONENTS, 1> for NormalEquations<COMPONENTS> {
    fn each(&self, point: usize, mut add: impl FnMut(usize, &[[[f64; COMPONENTS]; COMPONENTS]; 1])) {
        let within = self.within(point);
        let turned = |block: &[[f64; COMPONENTS]; COMPONENTS]| {
            [std::array::from_fn(|down| std::array::from_fn(|across| block[across][down]))]
        };
        add(point, &turned(&self.matrix[point][0]));
        for neighbour in 1..STENCIL.len() {
            if let Some(other) = within.neighbour(point, neighbour) {
                add(other, &turned(&self.matrix[point][neighbour]));
            }
            if let Some(other) = within.opposite(point, neighbour) {
                add(other, &[self.matrix[other][neighbour]]);
            }
        }
    }
}

impl<'f, const COMPONENTS: usize> GridSolver<'f, COMPONENTS> {
    /// The solver for `columns` × `rows` control points.
    ///
    /// # Errors
    /// When there is not enough memory.
    pub fn new(columns: usize, rows: usize) -> Result<Self, SolveError> {
        Self::for_some(columns, rows, |_| true)
    }

    /// The solver whose unknowns are only the control points (by index, row by row) for which `is_unknown` is true.
    ///
    /// # Errors
    /// When there is not enough memory.
    pub fn for_some(
        columns: usize,
        rows: usize,
        is_unknown: impl Fn(usize) -> bool,
    ) -> Result<Self, SolveError> {
        let elimination = Elimination::new((columns, rows), REACH, is_unknown);
        let elimination = elimination.ok_or_else(|| {
            let points = columns.saturating_mul(rows);
            SolveError::OutOfMemory { unknowns: points.saturating_mul(COMPONENTS) }
        })?;
        Ok(Self { columns, rows, elimination, fork: &InTurn })
    }

    /// The solver that solves halves of the equations at once, if `fork` does.
    #[must_use]
    pub fn with_fork(self, fork: &'f dyn Fork) -> Self {
        Self { fork, ..self }
    }

    /// What does halves of the work.
    pub(crate) fn fork(&self) -> &'f dyn Fork {
        self.fork
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn observations_of_known_control_points_recover_them() {
        let (columns, rows) = (6, 5);
        let truth = |point: usize, component: usize| (point as f64).sin() + component as f64;
        let mut equations = NormalEquations::<2>::new(columns, rows);
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        for row in 0..rows - 3 {
            for column in 0..columns - 3 {
                let mut sum = CellSum::default();
                for _ in 0..60 {
                    let derivative: CellRow<2> = std::array::from_fn(|_| [random(), random()]);
                    let mut value = 0.0;
                    for (local, entry) in derivative.iter().enumerate() {
                        let point = (row + local / 4) * columns + column + local % 4;
                        value += entry[0] * truth(point, 0) + entry[1] * truth(point, 1);
                    }
                    sum.add(&derivative, value, 0.7);
                }
                equations.add_cell(column, row, &sum);
            }
        }
        let solution = equations.solve(&GridSolver::new(columns, rows).unwrap()).unwrap();
        for (point, components) in solution.iter().enumerate() {
            for (component, value) in components.iter().enumerate() {
                assert!((value - truth(point, component)).abs() < 1e-9);
            }
        }
        // A solver for some control points sets all others to 0.
        let corner = |point: usize| point % columns < 5 && point / columns < 4;
        let some = equations.solve(&GridSolver::for_some(columns, rows, corner).unwrap()).unwrap();
        for (point, components) in some.iter().enumerate() {
            assert_eq!(*components == [0.0; 2], !corner(point));
        }
    }

    #[test]
    fn undetermined_control_points_are_an_error_without_a_penalty() {
        let solver = GridSolver::<1>::new(8, 4).unwrap();
        let mut equations = NormalEquations::<1>::new(8, 4);
        let mut sum = CellSum::default();
        for local in 0..16 {
            let mut row = [[0.0]; 16];
            row[local] = [1.0];
            // The heights 1 + column²: a quadratic, which the penalty continues exactly.
            sum.add(&row, 1.0 + ((local % 4) as f64).powi(2), 1.0);
        }
        equations.add_cell(0, 0, &sum);
        assert!(equations.solve(&solver).is_err());
        equations.add_third_difference_penalty(1e-3);
        let solution = equations.solve(&solver).unwrap();
        assert!((solution[7][0] - 50.0).abs() < 1e-6, "{}", solution[7][0]);
    }

    #[test]
    fn a_grid_beyond_the_memory_is_an_error() {
        let found = GridSolver::<2>::new(1 << 20, 1 << 20).err();
        assert_eq!(found, Some(SolveError::OutOfMemory { unknowns: 1 << 41 }));
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_an_error() {
        let mut equations = NormalEquations::<1>::new(40, 30);
        equations.add_third_difference_penalty(1.0);
        let mut sum = CellSum::default();
        sum.add(&[[1.0]; 16], 1.0, -1e3);
        equations.add_cell(20, 10, &sum);
        let found = equations.solve(&GridSolver::new(40, 30).unwrap());
        assert_eq!(found, Err(SolveError::NotPositiveDefinite { unknowns: 1200 }));
    }

    #[test]
    fn several_right_hand_sides_have_the_solutions_of_each() {
        let (columns, rows) = (19, 23);
        let mut equations = NormalEquations::<2>::new(columns, rows);
        equations.add_roughness_penalty(|x, y| 1.0 + x + y * y);
        for cell in 0..(columns - 3) * (rows - 3) {
            let mut sum = CellSum::default();
            for local in 0..16 {
                let mut row = [[0.0; 2]; 16];
                row[local] = [1.0, (cell as f64).sin()];
                sum.add(&row, (cell + local) as f64, 0.3);
                row[15 - local] = [0.3, 1.0];
                sum.add(&row, local as f64, 0.8);
            }
            equations.add_cell(cell % (columns - 3), cell / (columns - 3), &sum);
        }
        let solver = GridSolver::for_some(columns, rows, |point| point % 9 != 4).unwrap();
        let truths: [Vec<[f64; 2]>; 2] = [1.3, 2.7].map(|turn| {
            let value = |point: usize| {
                let of = |angle: f64| if point % 9 == 4 { 0.0 } else { angle.sin() };
                [of(turn * point as f64), of(turn * point as f64 + 1.0)]
            };
            (0..columns * rows).map(value).collect()
        });
        // A times a known solution, point by point, from both triangles.
        let mut rights = truths.clone().map(|truth| {
            let mut right = vec![[0.0; 2]; truth.len()];
            for point in 0..truth.len() {
                equations.each(point, |other, [block]| {
                    for (component, row) in block.iter().enumerate() {
                        right[other][component] += row[0] * truth[point][0] + row[1] * truth[point][1];
                    }
                });
            }
            right
        });
        equations.solve_each(&solver, &mut rights).unwrap();
        for (found, truth) in rights.concat().as_flattened().iter().zip(truths.concat().as_flattened()) {
            assert!((found - truth).abs() < 1e-8);
        }
    }
}
