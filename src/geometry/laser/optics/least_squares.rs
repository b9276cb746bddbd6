//! Least squares with a few unknowns: the solution, how well each unknown is known, and how far each observation is from
//! what all others predict.

use nalgebra::{DMatrix, DVector};

/// Columns whose share of the matrix is below this are combinations of others.
const RANK: f64 = 1e-9;
/// Steps of Gauss–Newton; good starts need three or four.
const MOST_STEPS: usize = 60;

/// A solution.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    /// The unknowns.
    pub(super) unknowns: DVector<f64>,
    /// Observed minus predicted, for each observation.
    pub(super) residuals: DVector<f64>,
    /// For each observation, the share of it that the solution takes over: from 0 to 1.
    pub(super) leverages: Vec<f64>,
    /// The covariance of the unknowns for observations with a standard deviation of 1.
    pub(super) covariance: DMatrix<f64>,
}

impl Solution {
    /// The number of observations that only check the others.
    pub(super) fn spare(&self) -> usize {
        self.residuals.len().saturating_sub(self.unknowns.len())
    }

    /// The standard deviation of one observation, from the residuals; `None` without spare observations.
    pub(super) fn deviation(&self) -> Option<f64> {
        (self.spare() > 0).then(|| (self.residuals.norm_squared() / self.spare() as f64).sqrt())
    }

    /// The standard deviation of an unknown, if one observation has this one.
    pub(super) fn uncertainty(&self, unknown: usize, deviation: f64) -> f64 {
        self.covariance[(unknown, unknown)].max(0.0).sqrt() * deviation
    }

    /// What an observation would differ from the prediction of all others; `None` where no others predict it.
    pub(super) fn difference_from_others(&self, index: usize) -> Option<f64> {
        let free = 1.0 - self.leverages[index];
        (free > 1e-6).then(|| self.residuals[index] / free)
    }

    /// The observation that contradicts the others most, with its difference from their prediction in
    /// standard deviations of the others and in its own unit. `None` if there are too few observations to
    /// show this.
    pub(super) fn most_contradicting(&self) -> Option<Contradiction> {
        let spare = self.spare();
        if spare < 3 {
            return None;
        }
        let sum = self.residuals.norm_squared();
        let candidates = (0..self.residuals.len()).filter_map(|index| {
            let free = 1.0 - self.leverages[index];
            // An observation that decides an unknown almost alone cannot be checked.
            if free < 0.05 {
                return None;
            }
            let own = self.residuals[index].powi(2) / free;
            let others = ((sum - own).max(0.0) / (spare - 1) as f64).sqrt();
            let difference = self.residuals[index] / free;
            Some(Contradiction { index, ratio: own.sqrt() / others.max(1e-12), difference })
        });
        candidates.max_by(|one, other| one.ratio.total_cmp(&other.ratio))
    }
}

/// An observation that does not fit the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contradiction {
    /// Its index.
    pub(super) index: usize,
    /// Its residual in standard deviations of the others.
    pub(super) ratio: f64,
    /// Observed minus what the others predict.
    pub(super) difference: f64,
}

/// The unknowns for which `matrix` times them is nearest to `observed`; `None` if some unknowns are not determined.
pub(super) fn linear(matrix: &DMatrix<f64>, observed: &DVector<f64>) -> Option<Solution> {
    let columns = matrix.ncols();
    if matrix.nrows() < columns {
        return None;
    }
    // Columns of equal length, so that the rank does not depend on units.
    let lengths: Vec<f64> = matrix.column_iter().map(|column| column.norm()).collect();
    if lengths.iter().any(|length| !(*length > 0.0 && length.is_finite())) {
        return None;
    }
    let mut scaled = matrix.clone();
    scaled.column_iter_mut().zip(&lengths).for_each(|(mut column, length)| column /= *length);
    let parts = scaled.svd(true, true);
    let (left, right) = (parts.u?, parts.v_t?);
    let largest = parts.singular_values.max();
    if !(parts.singular_values.min() > RANK * largest) {
        return None;
    }
    let shares = left.tr_mul(observed).component_div(&parts.singular_values);
    let mut unknowns = right.tr_mul(&shares);
    let mut half = right.transpose();
    for (index, value) in parts.singular_values.iter().enumerate() {
        half.column_mut(index).unscale_mut(*value);
    }
    for (row, length) in lengths.iter().enumerate() {
        unknowns[row] /= length;
        half.row_mut(row).unscale_mut(*length);
    }
    let residuals = observed - matrix * &unknowns;
    let leverages = left.row_iter().map(|row| row.norm_squared().min(1.0)).collect();
    Some(Solution { unknowns, residuals, leverages, covariance: &half * half.transpose() })
}

/// The unknowns near `start` for which `residuals` (observed minus predicted) are smallest, by Gauss–Newton with numeric
/// derivatives over `steps`. `None` if some unknowns are not determined, or the search does not end.
pub(super) fn nonlinear(
    start: &[f64],
    steps: &[f64],
    residuals: impl Fn(&[f64]) -> Option<Vec<f64>>,
) -> Option<Solution> {
    let mut at = start.to_vec();
    let mut now = DVector::from_vec(residuals(&at)?);
    for _ in 0..MOST_STEPS {
        let mut slopes = DMatrix::zeros(now.len(), at.len());
        for (column, step) in steps.iter().enumerate() {
            let moved = |by: f64| {
                let mut moved = at.clone();
                moved[column] += by;
                residuals(&moved).map(DVector::from_vec)
            };
            let slope = (moved(-*step)? - moved(*step)?) / (2.0 * step);
            slopes.set_column(column, &slope);
        }
        let solution = linear(&slopes, &now)?;
        let mut share = 1.0;
        let (next, found) = loop {
            let next: Vec<f64> =
                at.iter().zip(solution.unknowns.iter()).map(|(at, step)| at + share * step).collect();
            let found = residuals(&next).map(DVector::from_vec);
            if let Some(found) = found.filter(|found| found.norm() <= now.norm() * (1.0 + 1e-12) + 1e-12) {
                break (next, found);
            }
            share /= 2.0;
            if share < 1e-6 {
                break (at.clone(), now.clone());
            }
        };
        let is_still = solution.unknowns.iter().zip(steps).all(|(change, step)| change.abs() < 1e-4 * step);
        (at, now) = (next, found);
        if is_still || share < 1e-6 {
            let Solution { leverages, covariance, .. } = solution;
            return Some(Solution { unknowns: DVector::from_vec(at), residuals: now, leverages, covariance });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_points_is_found_with_its_uncertainty_and_the_point_beside_it() {
        let xs = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let observed =
            DVector::from_iterator(6, xs.iter().map(|x| 2.0 + 0.5 * x + if *x == 3.0 { 1.0 } else { 0.0 }));
        let matrix = DMatrix::from_fn(6, 2, |row, column| if column == 0 { 1.0 } else { xs[row] });
        let solution = linear(&matrix, &observed).unwrap();
        let odd = solution.most_contradicting().unwrap();
        assert_eq!(odd.index, 3);
        assert!((odd.difference - 1.0).abs() < 1e-9 && odd.ratio > 1e6);
        // The variance of a slope is 1 / Σ (x − mean)².
        assert!((solution.covariance[(1, 1)] - 1.0 / 17.5).abs() < 1e-12);
        let bent = nonlinear(&[1.0, 1.0], &[1e-3, 1e-3], |p| {
            Some(xs.iter().map(|x| 3.0 * (0.2 * x).exp() - p[0] * (p[1] * x).exp()).collect())
        });
        assert!((bent.unwrap().unknowns - DVector::from_vec(vec![3.0, 0.2])).norm() < 1e-9);
        let same = DMatrix::from_fn(6, 2, |row, _| xs[row]);
        assert!(linear(&same, &observed).is_none());
    }
}
