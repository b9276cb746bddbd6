//! Normals of a surface from the vertices of its mesh alone.

use multiversion::multiversion;
use nalgebra::{Matrix2x3, Point3, SMatrix, SVector, Vector3};

use super::adjacency::Neighbours;
use super::shape_fit::cross_directions;

/// Number of coefficients of a cubic without its constant: two slopes, three second and four third
/// derivatives.
const COEFFICIENTS: usize = 9;
/// Index of the first third derivative among the coefficients.
const FIRST_OF_THIRD: usize = 5;
/// Number of third derivatives.
const THIRDS: usize = COEFFICIENTS - FIRST_OF_THIRD;

/// Where the sides at a vertex deviate from the surface by less than this, mm, the vertex keeps its normal: the first
/// estimate is wrong by only a few per cent of the deviation, and fine meshes have many vertices.
pub(super) const NEGLIGIBLE_RISE: f64 = 1e-3;

/// Maximum number of neighbours used for one vertex.
const MAX_NEIGHBOURS: usize = 64;

/// Prior standard deviation of the slope error of the first estimate, divided by the distance of the nearest
/// vertex. For all prior deviations, the radius of curvature is the unit of length.
const SLOPE: f64 = 0.5;
/// Prior standard deviation of second derivatives, in the unit of [`SLOPE`].
const SECOND: f64 = 4.0;
/// Prior standard deviation of third derivatives times the distance of the nearest vertex, in the unit of
/// [`SLOPE`].
const THIRD: f64 = 0.6;
/// Prior standard deviation of the height that a cubic leaves at a vertex, divided by the fourth power of the
/// vertex's distance and times the square of the nearest distance, in the unit of [`SLOPE`].
const FOURTH: f64 = 0.01;
/// Added to the height that a cubic leaves at a vertex ([`FOURTH`]), in the unit of [`SLOPE`].
const FLOOR: f64 = 1e-6;

/// Rounding turns the normals of neighbours against each other by at most this many times its standard
/// deviation divided by the distance of the nearest vertex, rad.
const BY_CHANCE: f64 = 3.0;

/// A third derivative that the vertices hardly show is assumed to be as large as usual, with this weight.
const UNSEEN: f64 = 0.03;
/// Third derivatives are assumed to be at most this many times as large as usual, because noise looks like
/// third derivatives.
const WIDEST: f64 = 2.0;

/// A normal that is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EstimatedNormal {
    /// Unit vector.
    pub(super) normal: Vector3<f64>,
    /// Its standard deviation, rad; 0 where the first estimate is kept, as on flat regions.
    pub(super) deviation: f64,
}

/// A better normal at a vertex; `normals` are the first estimates, unit vectors, and `rounding` is the
/// standard deviation of the positions, mm. A cubic over the estimated tangent plane is fitted to the
/// vertices round it and round its neighbours, and its normal is taken (Cazals & Pouget, Estimating
/// differential quantities using polynomial fitting of osculating jets, Computer Aided Geometric Design
/// 22(2), 2005).
///
/// Each vertex is weighted by the height that a cubic is expected to leave at its distance. The priors keep
/// derivatives within the order of the radius of curvature, so the few, far vertices of long strips hardly
/// change the estimate. Second derivatives are taken along chords instead of their projections, which makes
/// spheres exact. A vertex without neighbours, or on a flat region, keeps its estimate.
///
/// The deviation is the change of the slope by coefficients within their priors, and by fourth derivatives.
/// It is small if the vertices show these, or surround the vertex evenly, and large at a border. The priors
/// are as wide as the third derivatives that are found; on a sphere there are none (the evidence of MacKay,
/// Bayesian interpolation, Neural Computation 4(3), 1992, for one width, in one step).
#[multiversion(targets("x86_64+avx2"))]
pub(super) fn refined_normal(
    positions: &[Point3<f64>],
    normals: &[Vector3<f64>],
    around: &Neighbours,
    vertex: usize,
    rounding: f64,
) -> EstimatedNormal {
    let (here, normal) = (positions[vertex], normals[vertex]);
    let ring = around.of_vertex(vertex);
    let unchanged = EstimatedNormal { normal, deviation: 0.0 };
    let (mut radius, mut nearest, mut rise) = (f64::INFINITY, f64::INFINITY, 0.0f64);
    for &other in ring {
        nearest = nearest.min((positions[other as usize] - here).norm());
    }
    let by_chance = (BY_CHANCE * rounding / nearest).powi(2);
    for &other in ring {
        let distance = (positions[other as usize] - here).norm();
        let turn = ((normals[other as usize] - normal).norm_squared() - by_chance).max(0.0).sqrt();
        rise = rise.max(distance * turn / 8.0);
        if turn > 0.0 {
            radius = radius.min(distance / turn);
        }
    }
    if !(rise > NEGLIGIBLE_RISE && nearest > 0.0 && normal != Vector3::zeros()) {
        return unchanged;
    }
    let mut known: Vec<u32> =
        ring.iter().flat_map(|&other| around.of_vertex(other as usize)).chain(ring).copied().collect();
    known.sort_unstable();
    known.dedup();

    let (across, other) = cross_directions(&normal);
    let plane = Matrix2x3::from_rows(&[across.transpose(), other.transpose()]);
    let near = nearest / radius;
    let floor = FLOOR + rounding / radius;
    let (slope, third, fourth) = (SLOPE * near, THIRD / near, FOURTH / (near * near));
    let usual = [slope, slope, SECOND, SECOND, SECOND, third, third, third, third];
    let expected = SVector::<f64, COEFFICIENTS>::from(usual.map(|usual| usual.powi(-2)));
    // Of the equations: the columns of the matrix, the right side, and what fourth derivatives would change it by.
    let mut sums = [[0.0; COEFFICIENTS]; COEFFICIENTS + 6];
    (0..COEFFICIENTS).for_each(|index| sums[index][index] = expected[index]);
    for &other in known.iter().filter(|&&other| other as usize != vertex).take(MAX_NEIGHBOURS) {
        let step = (positions[other as usize] - here) / radius;
        let (at, height) = (plane * step, normal.dot(&step));
        let (flat, square) = (at.norm_squared(), step.norm_squared());
        if !(flat > 0.0) || normals[other as usize].dot(&normal) <= 0.0 {
            continue;
        }
        let (x, y, chord) = (at.x, at.y, square / flat);
        let row = [
            x,
            y,
            chord * x * x / 2.0,
            chord * x * y,
            chord * y * y / 2.0,
            x * x * x / 6.0,
            x * x * y / 2.0,
            x * y * y / 2.0,
            y * y * y / 6.0,
        ];
        let others = [
            height,
            x.powi(4) / 24.0,
            x.powi(3) * y / 6.0,
            x * x * y * y / 4.0,
            x * y.powi(3) / 6.0,
            y.powi(4) / 24.0,
        ];
        let weight = (fourth * square * square + floor).powi(-2);
        for (sum, factor) in sums.iter_mut().zip(row.into_iter().chain(others)) {
            let weighted = weight * factor;
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weighted * value);
        }
    }
    let matrix = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::from_fn(|row, column| sums[column][row]);
    let right = SVector::<f64, COEFFICIENTS>::from(sums[COEFFICIENTS]);
    let quartics =
        SMatrix::<f64, COEFFICIENTS, 5>::from_fn(|row, column| sums[COEFFICIENTS + 1 + column][row]);
    let Some(factor) = matrix.cholesky() else { return unchanged };
    let jet = factor.solve(&right);
    let tilt = plane.transpose() * jet.fixed_rows::<2>(0);
    let Some(normal) = (normal - tilt).try_normalize(0.0) else { return unchanged };
    // The covariance is the inverse of the matrix; of the third derivatives only the variances are needed, which follow from the last
    // rows of its factor.
    let mut slopes = SMatrix::<f64, COEFFICIENTS, 2>::identity();
    factor.solve_mut(&mut slopes);
    let mut of_thirds = SMatrix::<f64, THIRDS, THIRDS>::identity();
    factor
        .l_dirty()
        .fixed_view::<THIRDS, THIRDS>(FIRST_OF_THIRD, FIRST_OF_THIRD)
        .solve_lower_triangular_mut(&mut of_thirds);
    let variances = SVector::<f64, THIRDS>::from_fn(|index, _| of_thirds.column(index).norm_squared());
    let of_prior = slopes.row_iter().zip(&expected).map(|(row, expected)| row.norm_squared() * expected);
    let of_cubic: f64 = of_prior.sum();
    // A fourth derivative of 24 leaves a height of 1 at the distance 1.
    let of_quartic = (slopes.transpose() * quartics).norm_squared() * (24.0 * fourth).powi(2);
    let width = width_of_thirds(&jet, &expected, &variances);
    EstimatedNormal { normal, deviation: (of_cubic + of_quartic).sqrt() * width }
}

/// How wide the prior of the third derivatives is, as a multiple of the usual width, by those that are found and as far as the
/// vertices show them. `expected` are the inverse squares of the usual values, `variances` those of the third derivatives.
fn width_of_thirds(
    jet: &SVector<f64, COEFFICIENTS>,
    expected: &SVector<f64, COEFFICIENTS>,
    variances: &SVector<f64, THIRDS>,
) -> f64 {
    let thirds = FIRST_OF_THIRD..COEFFICIENTS;
    let found: f64 = thirds.clone().map(|index| jet[index].powi(2) * expected[index]).sum();
    let shown: f64 = thirds.zip(variances).map(|(index, variance)| 1.0 - variance * expected[index]).sum();
    ((found + UNSEEN) / (shown + UNSEEN)).sqrt().min(WIDEST)
}
