//! Least squares over a tensor grid of control points: sparse normal equations and their solution.
//!
//! The surface fit and the length-true map both solve for the control points of a bicubic B-spline. Both lead to a
//! symmetric positive definite matrix in which a control point is coupled only to its neighbours within three rows and
//! columns.

use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};

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

/// The normal equations AᵀA x = Aᵀb over a grid of control points with `COMPONENTS` unknowns each.
#[derive(Debug, Clone)]
pub struct NormalEquations<const COMPONENTS: usize> {
    columns: usize,
    rows: usize,
    matrix: Vec<[[f64; COMPONENTS]; COMPONENTS]>,
    right: Vec<[f64; COMPONENTS]>,
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
        /// Number of unknowns.
        unknowns: usize,
    },
}

/// Marks a control point that is not an unknown.
const FIXED: u32 = u32::MAX;

/// The elimination order of a grid, computed once and used for every matrix on it.
#[derive(Debug, Clone)]
pub struct GridSolver<const COMPONENTS: usize> {
    columns: usize,
    rows: usize,
    /// The number of each control point among the unknowns, row by row, or [`FIXED`].
    numbers: Vec<u32>,
    column_starts: Vec<usize>,
    row_indices: Vec<usize>,
    symbolic: SymbolicLlt<usize>,
}

/// One observation that depends on the 4 × 4 control points of a cell: its derivative by each of their components.
pub type CellRow<const COMPONENTS: usize> = [[f64; COMPONENTS]; 16];

/// Observations of one cell, summed before they are added to the grid: 16 control points fit into the CPU's cache.
#[derive(Debug, Clone)]
pub struct CellSum<const COMPONENTS: usize> {
    matrix: [[[[f64; COMPONENTS]; COMPONENTS]; 16]; 16],
    right: [[f64; COMPONENTS]; 16],
}

impl<const COMPONENTS: usize> Default for CellSum<COMPONENTS> {
    fn default() -> Self {
        Self { matrix: [[[[0.0; COMPONENTS]; COMPONENTS]; 16]; 16], right: [[0.0; COMPONENTS]; 16] }
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
                        self.matrix[first][second][component][other] += scaled * row[second][other];
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
    pub fn add_composed<const PARTS: usize>(
        &mut self,
        observed: &ComposedSum<PARTS, COMPONENTS>,
        basis: &[[f64; 16]; PARTS],
    ) {
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
            for second in first..16 {
                let block = &mut self.matrix[first][second];
                for part in 0..PARTS {
                    let share = basis[part][second];
                    for component in 0..COMPONENTS {
                        for other in 0..COMPONENTS {
                            block[component][other] += share * row[part][component][other];
                        }
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
            matrix: vec![[[0.0; COMPONENTS]; COMPONENTS]; points * STENCIL.len()],
            right: vec![[0.0; COMPONENTS]; points],
        }
    }

    /// Adds the observations of the cell whose lower left control point is (`column`, `row`).
    pub fn add_cell(&mut self, column: usize, row: usize, sum: &CellSum<COMPONENTS>) {
        for first in 0..16 {
            let (i, j) = (first % 4, first / 4);
            let point = (row + j) * self.columns + column + i;
            for component in 0..COMPONENTS {
                self.right[point][component] += sum.right[first][component];
            }
            for second in first..16 {
                let (k, l) = (second % 4, second / 4);
                let neighbour = stencil_index(k as isize - i as isize, l as isize - j as isize);
                let block = &mut self.matrix[point * STENCIL.len() + neighbour];
                for component in 0..COMPONENTS {
                    for other in 0..COMPONENTS {
                        block[component][other] += sum.matrix[first][second][component][other];
                    }
                }
            }
        }
    }

    /// The right-hand side Aᵀb, row by row.
    pub fn right(&self) -> &[[f64; COMPONENTS]] {
        &self.right
    }

    /// Adds `weight` times the square of the third difference along each row and column, for every component. It
    /// vanishes on quadratics, so it continues a surface smoothly where there are no data and hardly changes it where
    /// there are (Eilers & Marx, Flexible smoothing with B-splines and penalties, Statistical Science 1996, eq. 4).
    pub fn add_third_difference_penalty(&mut self, weight: f64) {
        const DIFFERENCE: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];
        for row in 0..self.rows {
            for column in 0..self.columns {
                for (step_column, step_row) in [(1, 0), (0, 1)] {
                    if column + 3 * step_column >= self.columns || row + 3 * step_row >= self.rows {
                        continue;
                    }
                    for first in 0..4 {
                        let point = (row + first * step_row) * self.columns + column + first * step_column;
                        for second in first..4 {
                            let apart = (second - first) as isize;
                            let neighbour =
                                stencil_index(apart * step_column as isize, apart * step_row as isize);
                            let block = &mut self.matrix[point * STENCIL.len() + neighbour];
                            for component in 0..COMPONENTS {
                                block[component][component] +=
                                    weight * DIFFERENCE[first] * DIFFERENCE[second];
                            }
                        }
                    }
                }
            }
        }
    }

    /// Adds the square of the third derivative in every direction, in differences of the control points:
    /// ∂³x² + 3 (∂²x ∂y)² + 3 (∂x ∂²y)² + ∂³y², for every component. It has no preferred direction and vanishes on
    /// quadratics (Wahba, Spline models for observational data, 1990, eq. 2.4.9, for m = 3; as differences after
    /// Eilers & Marx 1996). `weight` gives the weight at a place, in units of control points along x and y.
    pub fn add_roughness_penalty(&mut self, weight: impl Fn(f64, f64) -> f64) {
        const DIFFERENCES: [&[f64]; 4] = [&[1.0], &[-1.0, 1.0], &[1.0, -2.0, 1.0], &[-1.0, 3.0, -3.0, 1.0]];
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
                            let block = &mut self.matrix[point * STENCIL.len() + stencil_index(right, up)];
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
    pub fn solve(&self, solver: &GridSolver<COMPONENTS>) -> Result<Vec<[f64; COMPONENTS]>, SolveError> {
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
        solver: &GridSolver<COMPONENTS>,
        rights: &mut [Vec<[f64; COMPONENTS]>],
    ) -> Result<(), SolveError> {
        assert_eq!((solver.columns, solver.rows), (self.columns, self.rows), "solver made for another grid");
        let unknowns = solver.column_starts.len() - 1;
        let mut values = Vec::with_capacity(solver.row_indices.len());
        for_each_column::<COMPONENTS>(self.columns, &solver.numbers, |point, component, neighbour, other| {
            values.push(self.matrix[point * STENCIL.len() + neighbour][component][other]);
        });
        let pattern = SymbolicSparseColMatRef::new_checked(
            unknowns,
            unknowns,
            &solver.column_starts,
            None,
            &solver.row_indices,
        );
        let matrix = SparseColMatRef::new(pattern, &values);
        let factor = Llt::try_new_with_symbolic(solver.symbolic.clone(), matrix, Side::Lower)
            .map_err(|_| SolveError::NotPositiveDefinite { unknowns })?;
        for right in rights {
            assert_eq!(right.len(), self.right.len(), "right-hand side of another grid");
            let unknown = right.iter().zip(&solver.numbers).filter(|(_, number)| **number != FIXED);
            let rest: Vec<f64> = unknown.flat_map(|(point, _)| point).copied().collect();
            let mut solution = rest.clone();
            factor.solve_in_place(faer::ColMut::from_slice_mut(&mut solution).as_mat_mut());
            let residual = relative_residual(rest, solver, &values, &solution);
            // The matrix squares the condition number of the observations; 1e-7 of the right-hand side is far below
            // 1e-6 mm.
            if !(residual <= 1e-7) {
                return Err(SolveError::Inaccurate { unknowns, residual });
            }
            for (point, number) in right.iter_mut().zip(&solver.numbers) {
                *point = match *number {
                    FIXED => [0.0; COMPONENTS],
                    number => {
                        std::array::from_fn(|component| solution[number as usize * COMPONENTS + component])
                    }
                };
            }
        }
        Ok(())
    }

    /// How much a solution lowers the weighted sum of squares of the observations.
    pub fn gain(&self, solution: &[[f64; COMPONENTS]]) -> f64 {
        self.right.as_flattened().iter().zip(solution.as_flattened()).map(|(right, x)| right * x).sum()
    }
}

/// ‖Ax − b‖ / ‖b‖ for the lower triangle `values` of A and the right-hand side b, `rest`.
fn relative_residual<const COMPONENTS: usize>(
    mut rest: Vec<f64>,
    solver: &GridSolver<COMPONENTS>,
    values: &[f64],
    solution: &[f64],
) -> f64 {
    let scale = rest.iter().map(|value| value * value).sum::<f64>().sqrt();
    for column in 0..solution.len() {
        for at in solver.column_starts[column]..solver.column_starts[column + 1] {
            let row = solver.row_indices[at];
            rest[row] -= values[at] * solution[column];
            if row != column {
                rest[column] -= values[at] * solution[row];
            }
        }
    }
    let norm = rest.iter().map(|value| value * value).sum::<f64>().sqrt();
    if scale == 0.0 { norm } else { norm / scale }
}

impl<const COMPONENTS: usize> GridSolver<COMPONENTS> {
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
        let mut count = 0u32;
        let number = |point: usize| {
            let number = if is_unknown(point) { count } else { FIXED };
            count += u32::from(number != FIXED);
            number
        };
        let numbers: Vec<u32> = (0..columns * rows).map(number).collect();
        let unknowns = count as usize * COMPONENTS;
        let mut column_starts = vec![0; unknowns + 1];
        let mut row_indices = Vec::with_capacity(unknowns * STENCIL.len() * COMPONENTS);
        for_each_column::<COMPONENTS>(columns, &numbers, |point, component, neighbour, other| {
            row_indices
                .push(numbers[neighbour_index(columns, point, neighbour)] as usize * COMPONENTS + other);
            column_starts[numbers[point] as usize * COMPONENTS + component + 1] = row_indices.len();
        });
        let pattern =
            SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &column_starts, None, &row_indices);
        let symbolic =
            SymbolicLlt::try_new(pattern, Side::Lower).map_err(|_| SolveError::OutOfMemory { unknowns })?;
        Ok(Self { columns, rows, numbers, column_starts, row_indices, symbolic })
    }
}

/// The control point that is a neighbour of another.
fn neighbour_index(columns: usize, point: usize, neighbour: usize) -> usize {
    let (right, up) = STENCIL[neighbour];
    (point as isize + up * columns as isize + right) as usize
}

/// Visits the lower triangle of the matrix column by column, rows ascending, skipping control points that are not
/// unknowns: (point, component, neighbour in the stencil, its component).
fn for_each_column<const COMPONENTS: usize>(
    columns: usize,
    numbers: &[u32],
    mut visit: impl FnMut(usize, usize, usize, usize),
) {
    let rows = numbers.len() / columns.max(1);
    for point in (0..numbers.len()).filter(|&point| numbers[point] != FIXED) {
        let (column, row) = ((point % columns) as isize, (point / columns) as isize);
        for component in 0..COMPONENTS {
            for (neighbour, (right, up)) in STENCIL.iter().enumerate() {
                if column + right < 0 || column + right >= columns as isize || row + up >= rows as isize {
                    continue;
                }
                if numbers[neighbour_index(columns, point, neighbour)] == FIXED {
                    continue;
                }
                let first = if neighbour == 0 { component } else { 0 };
                (first..COMPONENTS).for_each(|other| visit(point, component, neighbour, other));
            }
        }
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
}
