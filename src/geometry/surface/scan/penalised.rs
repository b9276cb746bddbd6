//! A penalised spline through scattered heights: outliers are weighted down, and the noise determines the smoothing.
//!
//! The spline minimises Σ w (z − f)² + λ ∫ |∂³f|², in differences of control points (Eilers & Marx, Flexible
//! smoothing with B-splines and penalties, Statistical Science 1996). Its frequency response is 1 / (1 + (ω/ω_c)⁶),
//! the square of a Butterworth filter of third order, the result of running that filter forwards and backwards
//! (Unser, Aldroubi & Eden, B-spline signal processing, IEEE Trans. Signal Processing 1993, part II, section IV). So
//! λ is given as a wavelength: waves of this length are halved, shorter ones are removed.

use nalgebra::{Point3, Vector2, Vector3};

use super::cells::{Cells, TO_DEVIATION, median};
use super::visible::Region;
use super::{ScanError, Smoothing};
use crate::geometry::fork::Fork;
use crate::geometry::normal_equations::{CellRow, CellSum, GridSolver, NormalEquations, SolveError};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::knots::UniformKnots;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Size of a bin along x and y, knot distances. Points in one bin are averaged before the equations are set up: the
/// surface is almost flat over a bin.
const BIN: f64 = 0.25;
/// Knot distance in units of the point spacing: at the start, with four points per control point, and the minimum.
const KNOT_SPACING: [f64; 2] = [2.0, 1.0];
/// Spans along the longer side of a surface: at the start, and the maximum for surfaces with finer detail.
const SPANS: [f64; 2] = [96.0, 256.0];
/// Spans along the longer side of the whole scan at the start: small surfaces beside a large one need no finer knots.
const WHOLE_SPANS: f64 = 128.0;
/// Waves shorter than this need more knots, knot distances.
const RESOLVED: f64 = 2.0;
/// Longest wavelength on a knot grid, knot distances: beyond it the equations are not accurate enough.
const LONGEST: f64 = 64.0;
/// Wavelength without smoothing, knot distances: the penalty then only determines control points without data.
const HARDLY_ANY: f64 = 0.5;
/// Wavelength for the first detection of outliers, knot distances.
const FIRST_LOOK: f64 = 2.5;
/// Smallest weight of the penalty on steep surface: that at 84°.
const MIN_TILT_WEIGHT: f64 = 1e-6;
/// Number of random sign vectors for estimating the trace of the influence matrix.
const PROBES: usize = 8;
/// Smallest assumed noise of a scanner, mm; smaller deviations are never outliers.
const FINEST_NOISE: f64 = 0.01;
/// Deviations up to which points have full weight, and from which they have none, in standard deviations of the noise.
const FULL_TO_ZERO_WEIGHT: [f64; 2] = [3.0, 6.0];
/// Maximum number of rounds of weighting and smoothing; two or three are usual.
const MAX_ROUNDS: usize = 6;
/// They end when no weight changes by more than this, and the wavelength by no more than this share.
const SETTLED: f64 = 0.05;
/// Knots that are this many times as far apart as the finest ones are as fine: halving comes no nearer.
const AS_FINE: f64 = 1.01;
/// The search for the wavelength starts with steps of this factor.
const APART: f64 = 1.6;
/// The search for the wavelength ends with steps of this power of [`APART`]. A search from the wavelength of
/// the last round starts with such steps.
const SMALLEST_STEP: f64 = 0.125;
/// A mean deviation of a neighbourhood beyond this many of its standard errors is not noise.
const SIGNIFICANT: f64 = 6.0;

/// A smoothed surface and the statistics of its points.
pub(super) struct Smoothed {
    pub(super) nurbs: NurbsSurface,
    /// The surfaces of every other point, and of the others.
    pub(super) of_halves: Vec<NurbsSurface>,
    /// Standard deviation of the points from the surface, mm.
    pub(super) noise: f64,
    /// Wavelength that is halved, mm.
    pub(super) wavelength: f64,
    /// Number of used points.
    pub(super) used: usize,
    /// Whether each point is used, that is, not an outlier.
    pub(super) is_used: Vec<bool>,
    /// Largest mean deviation of a neighbourhood that is not noise, mm, and its position.
    pub(super) departure: (f64, ViewPoint),
}

/// The points of a region, ready to be fitted on one knot grid.
struct Problem<'a> {
    region: &'a Region,
    cells: &'a Cells,
    knots_x: UniformKnots,
    knots_y: UniformKnots,
    solver: GridSolver<'a, 1>,
    /// Points in the order of their bins, bins in the order of their spans.
    order: Vec<u32>,
    /// Mean height, mm. Heights are fitted relative to it, so that a part far from the origin loses no precision.
    mean: f64,
}

/// The points of one bin, averaged.
struct Mean {
    /// The mean point, its height above the mean of all, mm.
    point: Point3<f64>,
    /// Sum of the points' weights.
    weight: f64,
}

/// The equations for one set of weights.
struct Weighted {
    means: Vec<Mean>,
    equations: NormalEquations<1>,
    probes: Vec<Vec<[f64; 1]>>,
    /// Sum of the weights.
    total: f64,
}

/// The typical deviation round a point, from the medians of the cells round it, mm.
#[derive(Clone, Copy)]
struct Usual {
    median: f64,
    /// Half the distance between their quartiles: how much a feature changes within a cell.
    spread: f64,
}

/// A spline for one wavelength.
struct Fit {
    wavelength: f64,
    nurbs: NurbsSurface,
    /// Trace of the influence matrix: the effective degrees of freedom.
    freedom: f64,
    /// Its score of generalised cross-validation, mm².
    score: f64,
}

/// Smooths the points of a region.
pub(super) fn smooth(
    region: &Region,
    cells: &Cells,
    smoothing: Smoothing,
    fork: &dyn Fork,
) -> Result<Smoothed, ScanError> {
    let spacing = cells.spacing();
    let trusted = region.points.iter().zip(&region.trusted).filter(|(_, trusted)| **trusted);
    let extents = Extents::of(trusted.map(|(point, _)| point.coords.xy()));
    let size = extents.size();
    let longer = size.x.max(size.y);
    let finest = (KNOT_SPACING[1] * spacing).max(longer / SPANS[1]);
    let usual = (KNOT_SPACING[0] * spacing).max(longer / SPANS[0]).max(cells.longer() / WHOLE_SPANS);
    let mut knot_distance = match smoothing {
        Smoothing::LowPass { wavelength } => {
            finest.max(usual.min(wavelength / RESOLVED)).max(wavelength / LONGEST)
        }
        Smoothing::Auto | Smoothing::None => finest.max(usual),
    };
    let mut weights: Vec<f64> = region.trusted.iter().map(|trusted| f64::from(*trusted)).collect();
    loop {
        let problem = Problem::new(region, cells, extents, knot_distance, fork)?;
        let fit = problem.settle(&mut weights, smoothing)?;
        let unresolved = fit.wavelength < RESOLVED * knot_distance && smoothing.follows_the_points();
        if !unresolved || knot_distance <= AS_FINE * finest {
            return Ok(problem.finish(fit, &weights));
        }
        knot_distance = finest.max(knot_distance / 2.0);
    }
}

impl<'a> Problem<'a> {
    fn new(
        region: &'a Region,
        cells: &'a Cells,
        extents: Extents,
        knot_distance: f64,
        fork: &'a dyn Fork,
    ) -> Result<Self, ScanError> {
        let along = |low: f64, high: f64| {
            let spans = ((high - low) / knot_distance).ceil().max(1.0);
            // Whole spans; the excess is divided between both sides.
            let start = (low + high - spans * knot_distance) / 2.0;
            UniformKnots::new(start, knot_distance, spans as usize)
        };
        let knots_x = along(extents.min.x, extents.max.x);
        let knots_y = along(extents.min.y, extents.max.y);
        let mut order: Vec<u32> = (0..region.points.len() as u32).collect();
        order.sort_by_cached_key(|&at| bin(&knots_x, &knots_y, &region.points[at as usize]));
        let mean = region.points.iter().map(|point| point.z).sum::<f64>() / region.points.len() as f64;
        let solver = GridSolver::new(knots_x.control_points(), knots_y.control_points())?.with_fork(fork);
        Ok(Self { region, cells, knots_x, knots_y, solver, order, mean })
    }

    /// Alternates weighting and smoothing until both converge.
    fn settle(&self, weights: &mut Vec<f64>, smoothing: Smoothing) -> Result<Fit, ScanError> {
        let first = FIRST_LOOK * self.knots_x.step();
        let hardly_any = HARDLY_ANY * self.knots_x.step();
        let mut weighted = self.weighted(weights, PROBES);
        let mut fit = match smoothing {
            Smoothing::LowPass { wavelength } => self.fit(&weighted, None, wavelength)?,
            Smoothing::Auto | Smoothing::None => self.fit(&weighted, None, first)?,
        };
        for round in 0..MAX_ROUNDS {
            let next = self.reweighed(&fit);
            let moved = weights.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            *weights = next;
            weighted = self.weighted(weights, PROBES);
            let before = fit.wavelength;
            fit = match smoothing {
                Smoothing::Auto => {
                    self.best(&weighted, &fit, if round == 0 { 1.0 } else { SMALLEST_STEP })?
                }
                Smoothing::LowPass { wavelength } => self.fit(&weighted, None, wavelength)?,
                Smoothing::None => self.fit(&weighted, None, first)?,
            };
            if moved < SETTLED && (fit.wavelength / before).ln().abs() < SETTLED {
                break;
            }
        }
        match smoothing {
            Smoothing::None => self.fit(&weighted, None, hardly_any),
            Smoothing::Auto | Smoothing::LowPass { .. } => Ok(fit),
        }
    }

    /// The fit with the smallest score, searched from the last wavelength between almost no smoothing and the whole region: first in
    /// steps of this power of [`APART`], which grow up to that factor, then in smaller ones.
    fn best(&self, weighted: &Weighted, last: &Fit, step: f64) -> Result<Fit, ScanError> {
        let spans = self.knots_x.spans().max(self.knots_y.spans()) as f64;
        let wavelengths = HARDLY_ANY * self.knots_x.step()..=LONGEST.min(2.0 * spans) * self.knots_x.step();
        let fit = |wavelength: f64| self.fit(weighted, Some(&last.nurbs), wavelength);
        let mut best = fit(last.wavelength.clamp(*wavelengths.start(), *wavelengths.end()))?;
        let is_better = |step: f64, best: &mut Fit| {
            let wavelength = best.wavelength * APART.powf(step);
            let better = wavelengths.contains(&wavelength).then(|| fit(wavelength).ok()).flatten();
            let better = better.filter(|fit| fit.score < best.score);
            better.map(|fit| *best = fit).is_some()
        };
        let mut step = step;
        // Descend in one direction: the score has one minimum, or is flat towards no smoothing.
        for direction in [-1.0, 1.0] {
            let mut moved = false;
            while is_better(direction * step, &mut best) {
                moved = true;
                step = (2.0 * step).min(1.0);
            }
            if moved {
                break;
            }
        }
        while step > SMALLEST_STEP {
            step /= 2.0;
            if !is_better(step, &mut best) {
                is_better(-step, &mut best);
            }
        }
        Ok(best)
    }

    /// The equations, with at most [`PROBES`] random sign vectors.
    fn weighted(&self, weights: &[f64], probes: usize) -> Weighted {
        let means = self.means(weights);
        let (columns, rows) = (self.knots_x.control_points(), self.knots_y.control_points());
        let mut equations = NormalEquations::new(columns, rows);
        let mut probes = vec![vec![[0.0]; columns * rows]; probes];
        let span = |mean: &Mean| (self.knots_x.span(mean.point.x), self.knots_y.span(mean.point.y));
        let mut number = 0;
        for run in means.chunk_by(|a, b| span(a) == span(b)) {
            let (column, row) = span(&run[0]);
            let mut sum = CellSum::default();
            let mut signed = [[0.0; 16]; PROBES];
            for mean in run {
                let basis = self.row(&mean.point);
                sum.add(&basis, mean.point.z, mean.weight);
                let (signs, size) = (signs(number), mean.weight.sqrt());
                number += 1;
                for (probe, values) in signed.iter_mut().enumerate() {
                    let sign = if signs >> probe & 1 == 0 { size } else { -size };
                    values.iter_mut().zip(&basis).for_each(|(value, [basis])| *value += sign * basis);
                }
            }
            equations.add_cell(column, row, &sum);
            for (probe, values) in probes.iter_mut().zip(&signed) {
                for (local, value) in values.iter().enumerate() {
                    probe[(row + local / 4) * columns + column + local % 4][0] += value;
                }
            }
        }
        let total = means.iter().map(|mean| mean.weight).sum();
        Weighted { means, equations, probes, total }
    }

    /// The weighted mean of the points in each bin that has weight.
    fn means(&self, weights: &[f64]) -> Vec<Mean> {
        let mut means = Vec::new();
        let bin = |at: &u32| bin(&self.knots_x, &self.knots_y, &self.region.points[*at as usize]);
        for run in self.order.chunk_by(|a, b| bin(a) == bin(b)) {
            let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
            for &at in run {
                sum += self.region.points[at as usize].coords * weights[at as usize];
                weight += weights[at as usize];
            }
            if weight > 0.0 {
                let point = Point3::from(sum / weight - Vector3::new(0.0, 0.0, self.mean));
                means.push(Mean { point, weight });
            }
        }
        means
    }

    fn row(&self, point: &Point3<f64>) -> CellRow<1> {
        let (x, y) = (self.knots_x.basis(point.x).value, self.knots_y.basis(point.y).value);
        std::array::from_fn(|local| [x[local % 4] * y[local / 4]])
    }

    /// The spline that halves waves of this length, with the score n RSS / (n − tr A)² (Craven & Wahba, Smoothing noisy
    /// data with spline functions, Numerische Mathematik 1979, eq. 1.9). The trace is the mean of vᵀAv over fixed
    /// random signs v (Hutchinson, A stochastic estimator of the trace of the influence matrix, Commun. Statist. 1990). Without signs
    /// there is no score.
    fn fit(
        &self,
        weighted: &Weighted,
        tilt: Option<&NurbsSurface>,
        wavelength: f64,
    ) -> Result<Fit, ScanError> {
        let mut equations = weighted.equations.clone();
        let penalty = self.penalty(weighted.total, wavelength);
        equations.add_roughness_penalty(|x, y| penalty * self.tilt_weight(tilt, x, y));
        let mut solutions = weighted.probes.clone();
        solutions.push(weighted.equations.right().to_vec());
        equations.solve_each(&self.solver, &mut solutions)?;
        let heights = solutions.pop().unwrap_or_default();
        let trace = |(probe, solution): (&Vec<[f64; 1]>, &Vec<[f64; 1]>)| -> f64 {
            probe.iter().zip(solution).map(|([a], [b])| a * b).sum()
        };
        let freedom = weighted.probes.iter().zip(&solutions).map(trace).sum::<f64>() / PROBES as f64;
        let heights = heights.into_iter().map(|[height]| height + self.mean).collect();
        let nurbs = NurbsSurface::new(self.knots_x, self.knots_y, heights)
            .ok_or(SolveError::NotPositiveDefinite { unknowns: solutions.len() })?;
        let squares: f64 = weighted
            .means
            .iter()
            .map(|mean| mean.weight * (mean.point.z + self.mean - height(&nurbs, &mean.point)).powi(2))
            .sum();
        let count = weighted.means.len() as f64;
        let left = (count - freedom).max(1e-3 * count);
        Ok(Fit { wavelength, nurbs, freedom, score: count * squares / (left * left) })
    }

    /// Height of each point above a surface, mm.
    fn residuals(&self, nurbs: &NurbsSurface) -> Vec<f64> {
        self.region.points.iter().map(|point| point.z - height(nurbs, point)).collect()
    }

    fn tilt_weight(&self, tilt: Option<&NurbsSurface>, x: f64, y: f64) -> f64 {
        let Some(surface) = tilt else { return 1.0 };
        let at = |knots: &UniformKnots, place: f64| {
            (knots.start() + knots.step() * (place - 1.0)).clamp(knots.start(), knots.end())
        };
        let jet = surface.jet(ViewPoint::new(at(&self.knots_x, x), at(&self.knots_y, y)));
        (1.0 + jet.gradient.norm_squared()).powi(-3).max(MIN_TILT_WEIGHT)
    }

    /// The weight of the penalty for a wavelength: λ = ρ (L / 2π)⁶ for ρ points per mm². A third difference of control
    /// points with distance h is h³ times the third derivative.
    fn penalty(&self, points: f64, wavelength: f64) -> f64 {
        let cells = self.region.cells.chunk_by(|a, b| a == b).count() as f64;
        let density = points / (cells * self.cells.side().powi(2));
        density * (wavelength / std::f64::consts::TAU).powi(6) / self.knots_x.step().powi(4)
    }

    /// Weights after a fit: 1 for deviations that noise explains, falling to 0 for outliers, similar to Tukey's
    /// biweight (Beaton & Tukey, Technometrics 1974). A deviation that the neighbours share is a feature that the
    /// spline does not follow, not an outlier; so each deviation is measured relative to the usual one round it.
    fn reweighed(&self, fit: &Fit) -> Vec<f64> {
        let residuals = self.residuals(&fit.nurbs);
        let usual = self.usual(&residuals);
        let alone = |((residual, usual), _): ((&f64, &Usual), _)| (residual - usual.median).abs();
        let all = residuals.iter().zip(&usual).zip(&self.region.trusted);
        let mut sizes: Vec<f64> = all.filter(|(_, trusted)| **trusted).map(alone).collect();
        let noise = (median(&mut sizes).unwrap_or(0.0) * TO_DEVIATION).max(FINEST_NOISE);
        let [full, zero] = FULL_TO_ZERO_WEIGHT;
        let weight = |(residual, usual): (&f64, &Usual)| {
            let deviation = (residual - usual.median).abs() - usual.spread;
            let beyond = ((deviation / noise - full) / (zero - full)).clamp(0.0, 1.0);
            (1.0 - beyond * beyond).powi(2)
        };
        residuals.iter().zip(&usual).map(weight).collect()
    }

    /// For each point, the usual deviation round it: that of points that are certainly on the surface. Debris shares a deviation, too.
    fn usual(&self, residuals: &[f64]) -> Vec<Usual> {
        let mut medians = vec![f64::NAN; self.cells.count()];
        let mut values = Vec::new();
        let mut start = 0;
        for run in self.region.cells.chunk_by(|a, b| a == b) {
            values.clear();
            let here = start..start + run.len();
            let trusted = residuals[here.clone()].iter().zip(&self.region.trusted[here]);
            values.extend(trusted.filter(|(_, trusted)| **trusted).map(|(residual, _)| residual));
            start += run.len();
            medians[run[0]] = median(&mut values).unwrap_or(f64::NAN);
        }
        let mut usual = Vec::with_capacity(residuals.len());
        for run in self.region.cells.chunk_by(|a, b| a == b) {
            values.clear();
            values
                .extend(self.cells.window(run[0]).map(|cell| medians[cell]).filter(|value| !value.is_nan()));
            values.sort_by(f64::total_cmp);
            let count = values.len();
            // Too few neighbours for a usual deviation.
            let here = match count {
                0..4 => Usual { median: 0.0, spread: 0.0 },
                _ => Usual {
                    median: values[count / 2],
                    spread: (values[count - 1 - count / 4] - values[count / 4]) / 2.0,
                },
            };
            usual.extend(std::iter::repeat_n(here, run.len()));
        }
        usual
    }

    fn finish(&self, fit: Fit, weights: &[f64]) -> Smoothed {
        let is_used: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
        let used = is_used.iter().filter(|is_used| **is_used).count();
        let residuals = self.residuals(&fit.nurbs);
        let kept = residuals.iter().zip(&is_used).filter(|(_, is_used)| **is_used);
        let mut sizes: Vec<f64> = kept.map(|(residual, _)| residual.abs()).collect();
        let left = (1.0 - fit.freedom / used as f64).max(1e-3);
        let noise = median(&mut sizes).unwrap_or(0.0) * TO_DEVIATION / left.sqrt();
        let departure = self.departure(&residuals, &is_used, noise);
        let of_halves = [0, 1].into_iter().filter_map(|half| self.half(&fit, weights, half)).collect();
        Smoothed { nurbs: fit.nurbs, of_halves, noise, wavelength: fit.wavelength, used, is_used, departure }
    }

    /// The surface of every other point, smoothed in the same way; `None` where it cannot be found.
    fn half(&self, fit: &Fit, weights: &[f64], half: usize) -> Option<NurbsSurface> {
        let mut of_half = vec![0.0; weights.len()];
        // Every other point from bin to bin: neighbours in different halves.
        for &at in self.order.iter().filter(|&&at| weights[at as usize] > 0.0).skip(half).step_by(2) {
            of_half[at as usize] = weights[at as usize];
        }
        let fit = self.fit(&self.weighted(&of_half, 0), Some(&fit.nurbs), fit.wavelength).ok()?;
        Some(fit.nurbs)
    }

    /// The largest mean deviation of the points round a cell that noise does not explain, and its position.
    fn departure(&self, residuals: &[f64], is_used: &[bool], noise: f64) -> (f64, ViewPoint) {
        let mut sums = vec![(0.0, 0.0, Vector2::zeros()); self.cells.count()];
        for (at, point) in self.region.points.iter().enumerate().filter(|(at, _)| is_used[*at]) {
            let sum = &mut sums[self.region.cells[at]];
            *sum = (sum.0 + 1.0, sum.1 + residuals[at], sum.2 + point.coords.xy());
        }
        let mut largest = (0.0f64, ViewPoint::new(0.0, 0.0));
        for run in self.region.cells.chunk_by(|a, b| a == b) {
            let around = self.cells.window(run[0]).map(|cell| sums[cell]);
            let (count, sum, place) =
                around.fold((0.0, 0.0, Vector2::zeros()), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2));
            let mean: f64 = sum / count;
            if count >= 6.0 && mean.abs() > SIGNIFICANT * noise / count.sqrt() && mean.abs() > largest.0 {
                largest = (mean.abs(), (place / count).into());
            }
        }
        largest
    }
}

fn height(nurbs: &NurbsSurface, at: &Point3<f64>) -> f64 {
    nurbs.height(ViewPoint::new(at.x, at.y))
}

/// The span of a point and its bin in the span: (row, column, bin's row, bin's column).
fn bin(knots_x: &UniformKnots, knots_y: &UniformKnots, point: &Point3<f64>) -> [usize; 4] {
    let along = |knots: &UniformKnots, at: f64| {
        let span = knots.span(at);
        (span, ((at - knots.start()) / knots.step() - span as f64) / BIN)
    };
    let ((column, x), (row, y)) = (along(knots_x, point.x), along(knots_y, point.y));
    [row, column, y as usize, x as usize]
}

/// Random signs for the probes of a mean, one in each bit: reproducible, so that the same scan gives the same surface
/// (Steele, Lea & Flood, Fast splittable pseudorandom number generators, OOPSLA 2014: its finaliser).
fn signs(mean: u64) -> u64 {
    let mut bits = mean.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}
