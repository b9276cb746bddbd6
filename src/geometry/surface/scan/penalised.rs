//! A penalised spline through scattered heights: outliers weighted down, smoothing found from the noise.
//!
//! The spline minimises Σ w (z − f)² + λ ∫ |∂³f|², in differences of control points (Eilers & Marx, Flexible smoothing
//! with B-splines and penalties, Statistical Science 1996). Its frequency response is 1 / (1 + (ω/ω_c)⁶), the square of
//! a Butterworth filter of third order, which is what running that filter forwards and backwards gives (Unser, Aldroubi
//! & Eden, B-spline signal processing, IEEE Trans. Signal Processing 1993, part II, section IV). So λ is told as a
//! wavelength: waves of this length are halved, shorter ones go.

use nalgebra::{Point3, Vector2, Vector3};

use super::visible::{Cells, Region, TO_DEVIATION, median};
use super::{ScanError, Smoothing};
use crate::geometry::normal_equations::{CellRow, CellSum, GridSolver, NormalEquations, SolveError};
use crate::geometry::space::{Extents, ViewPoint};
use crate::geometry::surface::knots::UniformKnots;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Points within this share of a knot distance, along x and y, are averaged before the equations are set up: over so
/// little the surface is flat.
const BIN: f64 = 0.25;
/// Distance between knots in distances between points: at first, with four points to a control point, and at least.
const KNOT_SPACING: [f64; 2] = [2.0, 1.0];
/// Spans along the longer side of a surface at first, and at most where it shows finer detail than those resolve.
const SPANS: [f64; 2] = [96.0, 256.0];
/// Spans along the longer side of the whole scan at first: small surfaces beside a large one need no finer knots.
const WHOLE_SPANS: f64 = 128.0;
/// Waves shorter than this many knot distances ask for more knots.
const RESOLVED: f64 = 2.0;
/// Longest wavelength on a knot grid, knot distances: beyond it the equations lose the digits that are asked for.
const LONGEST: f64 = 64.0;
/// Where no smoothing is wanted: the penalty then only ties what has no data, knot distances.
const HARDLY_ANY: f64 = 0.5;
/// Wavelength that outliers are told by before anything is known, knot distances.
const FIRST_LOOK: f64 = 2.5;
/// The penalty falls no lower than this on steep surface: that of 84°.
const LEAST_TILT_WEIGHT: f64 = 1e-6;
/// Random signs that the trace of the influence matrix is estimated with.
const PROBES: usize = 8;
/// No scanner is better than this, mm; smaller deviations never make an outlier.
const FINEST_NOISE: f64 = 0.01;
/// Deviations that count fully, and not at all, in standard deviations of the noise.
const SURE_TO_LOST: [f64; 2] = [3.0, 6.0];
/// Rounds of weighing and smoothing at most; two or three are usual.
const MOST_ROUNDS: usize = 6;
/// A mean deviation of a neighbourhood beyond this many of its standard errors is no noise.
const SIGNIFICANT: f64 = 6.0;

/// A smoothed surface with what was found about its points.
pub(super) struct Smoothed {
    pub(super) nurbs: NurbsSurface,
    /// Standard deviation of the points from the surface, mm.
    pub(super) noise: f64,
    /// Wavelength that is halved, mm.
    pub(super) wavelength: f64,
    /// Number of points that count.
    pub(super) used: usize,
    /// Whether each point counts.
    pub(super) counts: Vec<bool>,
    /// Largest mean deviation of a neighbourhood that is no noise, and where, mm.
    pub(super) departure: (f64, ViewPoint),
}

/// The points of a region, ready to be fitted on one knot grid.
struct Problem<'a> {
    region: &'a Region,
    cells: &'a Cells,
    knots_x: UniformKnots,
    knots_y: UniformKnots,
    solver: GridSolver<1>,
    /// Points in the order of their bins, bins in the order of their spans.
    order: Vec<u32>,
    /// Heights are fitted from their mean, so that a part far from the origin loses no digits.
    mean: f64,
}

/// Points of one bin in one.
struct Mean {
    /// The mean point, its height above the mean of all, mm.
    point: Point3<f64>,
    /// Sum of the points' weights.
    weight: f64,
}

/// Equations of one set of weights.
struct Weighed {
    means: Vec<Mean>,
    equations: NormalEquations<1>,
    probes: Vec<Vec<[f64; 1]>>,
    /// Sum of the weights.
    total: f64,
}

/// The deviations of the cells round a point, each by its median, mm.
#[derive(Clone, Copy)]
struct Usual {
    median: f64,
    /// Half the distance between their quartiles: as much as a feature changes within a cell.
    spread: f64,
}

/// A spline of one wavelength.
struct Fit {
    wavelength: f64,
    nurbs: NurbsSurface,
    /// Trace of the influence matrix: as many points could have been followed exactly.
    freedom: f64,
    /// The generalised cross validation of it, mm².
    score: f64,
}

/// Smooths the points of a region.
pub(super) fn smooth(region: &Region, cells: &Cells, smoothing: Smoothing) -> Result<Smoothed, ScanError> {
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
        let problem = Problem::new(region, cells, extents, knot_distance)?;
        let fit = problem.settle(&mut weights, smoothing)?;
        let unresolved = fit.wavelength < RESOLVED * knot_distance && smoothing.follows_the_points();
        if !unresolved || knot_distance <= 1.01 * finest {
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
    ) -> Result<Self, ScanError> {
        let along = |low: f64, high: f64| {
            let spans = ((high - low) / knot_distance).ceil().max(1.0);
            // Whole spans, the rest to both sides.
            let start = (low + high - spans * knot_distance) / 2.0;
            UniformKnots::new(start, knot_distance, spans as usize)
        };
        let knots_x = along(extents.min.x, extents.max.x);
        let knots_y = along(extents.min.y, extents.max.y);
        let mut order: Vec<u32> = (0..region.points.len() as u32).collect();
        order.sort_by_cached_key(|&at| bin(&knots_x, &knots_y, &region.points[at as usize]));
        let mean = region.points.iter().map(|point| point.z).sum::<f64>() / region.points.len() as f64;
        let solver = GridSolver::new(knots_x.control_points(), knots_y.control_points())?;
        Ok(Self { region, cells, knots_x, knots_y, solver, order, mean })
    }

    /// Weighs and smooths by turns until both stand still.
    fn settle(&self, weights: &mut Vec<f64>, smoothing: Smoothing) -> Result<Fit, ScanError> {
        let first = FIRST_LOOK * self.knots_x.step();
        let hardly_any = HARDLY_ANY * self.knots_x.step();
        let mut weighed = self.weigh(weights);
        let mut fit = match smoothing {
            Smoothing::LowPass { wavelength } => self.fit(&weighed, None, wavelength)?,
            Smoothing::Auto | Smoothing::None => self.fit(&weighed, None, first)?,
        };
        for _ in 0..MOST_ROUNDS {
            let next = self.reweighed(&fit);
            let moved = weights.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            *weights = next;
            weighed = self.weigh(weights);
            let before = fit.wavelength;
            fit = match smoothing {
                Smoothing::Auto => self.best(&weighed, &fit)?,
                Smoothing::LowPass { wavelength } => self.fit(&weighed, None, wavelength)?,
                Smoothing::None => self.fit(&weighed, None, first)?,
            };
            if moved < 0.05 && (fit.wavelength / before).ln().abs() < 0.05 {
                break;
            }
        }
        match smoothing {
            Smoothing::None => self.fit(&weighed, None, hardly_any),
            Smoothing::Auto | Smoothing::LowPass { .. } => Ok(fit),
        }
    }

    /// The fit with the smallest score. Where there is none yet, wavelengths from hardly any smoothing to the whole
    /// region are tried, 1.6 times apart; then the neighbourhood of the best one is searched.
    fn best(&self, weighed: &Weighed, last: &Fit) -> Result<Fit, ScanError> {
        const APART: f64 = 1.6;
        let spans = self.knots_x.spans().max(self.knots_y.spans()) as f64;
        let wavelengths = HARDLY_ANY * self.knots_x.step()..=LONGEST.min(2.0 * spans) * self.knots_x.step();
        let fit = |wavelength: f64| self.fit(weighed, Some(&last.nurbs), wavelength);
        let mut best = fit(last.wavelength.clamp(*wavelengths.start(), *wavelengths.end()))?;
        let is_better = |factor: f64, best: &mut Fit| {
            let wavelength = best.wavelength * factor;
            let better = wavelengths.contains(&wavelength).then(|| fit(wavelength).ok()).flatten();
            let better = better.filter(|fit| fit.score < best.score);
            better.map(|fit| *best = fit).is_some()
        };
        // Downhill to one side: the score has one valley, or a flat floor towards no smoothing.
        for factor in [1.0 / APART, APART] {
            let mut moved = false;
            while is_better(factor, &mut best) {
                moved = true;
            }
            if moved {
                break;
            }
        }
        for step in [APART.powf(0.5), APART.powf(0.25), APART.powf(0.125)] {
            if !is_better(step, &mut best) {
                is_better(1.0 / step, &mut best);
            }
        }
        Ok(best)
    }

    fn weigh(&self, weights: &[f64]) -> Weighed {
        let means = self.means(weights);
        let (columns, rows) = (self.knots_x.control_points(), self.knots_y.control_points());
        let mut equations = NormalEquations::new(columns, rows);
        let mut probes = vec![vec![[0.0]; columns * rows]; PROBES];
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
        Weighed { means, equations, probes, total }
    }

    /// The weighted mean of the points in each bin, as far as they have weight.
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

    /// The spline that halves waves of this length, with its score: n RSS / (n − tr A)² (Craven & Wahba, Smoothing noisy
    /// data with spline functions, Numerische Mathematik 1979, eq. 1.9). The trace is the mean of vᵀAv over fixed
    /// random signs v (Hutchinson, A stochastic estimator of the trace of the influence matrix, Commun. Statist. 1990).
    fn fit(&self, weighed: &Weighed, tilt: Option<&NurbsSurface>, wavelength: f64) -> Result<Fit, ScanError> {
        let mut equations = weighed.equations.clone();
        let penalty = self.penalty(weighed.total, wavelength);
        equations.add_roughness_penalty(|x, y| penalty * self.tilt_weight(tilt, x, y));
        let mut solutions = weighed.probes.clone();
        solutions.push(weighed.equations.right().to_vec());
        equations.solve_each(&self.solver, &mut solutions)?;
        let heights = solutions.pop().unwrap_or_default();
        let trace = |(probe, solution): (&Vec<[f64; 1]>, &Vec<[f64; 1]>)| -> f64 {
            probe.iter().zip(solution).map(|([a], [b])| a * b).sum()
        };
        let freedom = weighed.probes.iter().zip(&solutions).map(trace).sum::<f64>() / PROBES as f64;
        let heights = heights.into_iter().map(|[height]| height + self.mean).collect();
        let nurbs = NurbsSurface::new(self.knots_x, self.knots_y, heights)
            .ok_or(SolveError::NotPositiveDefinite { unknowns: solutions.len() })?;
        let squares: f64 = weighed
            .means
            .iter()
            .map(|mean| mean.weight * (mean.point.z + self.mean - height(&nurbs, &mean.point)).powi(2))
            .sum();
        let count = weighed.means.len() as f64;
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
        (1.0 + jet.gradient.norm_squared()).powi(-3).max(LEAST_TILT_WEIGHT)
    }

    /// The weight of the penalty for a wavelength: λ = ρ (L / 2π)⁶ for ρ points in 1 mm², and a third difference of
    /// control points h apart is h³ third derivatives.
    fn penalty(&self, points: f64, wavelength: f64) -> f64 {
        let cells = self.region.cells.chunk_by(|a, b| a == b).count() as f64;
        let density = points / (cells * self.cells.side().powi(2));
        density * (wavelength / std::f64::consts::TAU).powi(6) / self.knots_x.step().powi(4)
    }

    /// Weights after a fit: 1 for what noise explains, falling to 0 for outliers, in the manner of Tukey's biweight
    /// (Beaton & Tukey, Technometrics 1974). A deviation that the neighbours share is a feature that the spline does
    /// not follow, and no outlier; so each is measured from what is usual round it.
    fn reweighed(&self, fit: &Fit) -> Vec<f64> {
        let residuals = self.residuals(&fit.nurbs);
        let usual = self.usual(&residuals);
        let alone = |((residual, usual), _): ((&f64, &Usual), _)| (residual - usual.median).abs();
        let all = residuals.iter().zip(&usual).zip(&self.region.trusted);
        let mut sizes: Vec<f64> = all.filter(|(_, trusted)| **trusted).map(alone).collect();
        let noise = (median(&mut sizes).unwrap_or(0.0) * TO_DEVIATION).max(FINEST_NOISE);
        let [sure, lost] = SURE_TO_LOST;
        let weight = |(residual, usual): (&f64, &Usual)| {
            let deviation = (residual - usual.median).abs() - usual.spread;
            let beyond = ((deviation / noise - sure) / (lost - sure)).clamp(0.0, 1.0);
            (1.0 - beyond * beyond).powi(2)
        };
        residuals.iter().zip(&usual).map(weight).collect()
    }

    /// For each point, what deviations are usual round it.
    fn usual(&self, residuals: &[f64]) -> Vec<Usual> {
        let mut medians = vec![f64::NAN; self.cells.count()];
        let mut values = Vec::new();
        let mut start = 0;
        for run in self.region.cells.chunk_by(|a, b| a == b) {
            values.clear();
            values.extend_from_slice(&residuals[start..start + run.len()]);
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
            // Too few neighbours share nothing.
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
        let counts: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
        let used = counts.iter().filter(|counts| **counts).count();
        let residuals = self.residuals(&fit.nurbs);
        let kept = residuals.iter().zip(&counts).filter(|(_, counts)| **counts);
        let mut sizes: Vec<f64> = kept.map(|(residual, _)| residual.abs()).collect();
        let left = (1.0 - fit.freedom / used as f64).max(1e-3);
        let noise = median(&mut sizes).unwrap_or(0.0) * TO_DEVIATION / left.sqrt();
        let departure = self.departure(&residuals, &counts, noise);
        Smoothed { nurbs: fit.nurbs, noise, wavelength: fit.wavelength, used, counts, departure }
    }

    /// The largest mean deviation of the points round a cell that noise does not explain, and where.
    fn departure(&self, residuals: &[f64], counts: &[bool], noise: f64) -> (f64, ViewPoint) {
        let mut sums = vec![(0.0, 0.0, Vector2::zeros()); self.cells.count()];
        for (at, point) in self.region.points.iter().enumerate().filter(|(at, _)| counts[*at]) {
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

/// The span of a point and its bin in it: (row, column, bin's row, bin's column).
fn bin(knots_x: &UniformKnots, knots_y: &UniformKnots, point: &Point3<f64>) -> [usize; 4] {
    let along = |knots: &UniformKnots, at: f64| {
        let span = knots.span(at);
        (span, ((at - knots.start()) / knots.step() - span as f64) / BIN)
    };
    let ((column, x), (row, y)) = (along(knots_x, point.x), along(knots_y, point.y));
    [row, column, y as usize, x as usize]
}

/// Random signs for the probes of a mean, one in each bit: fixed, so that the same scan gives the same surface
/// (Steele, Lea & Flood, Fast splittable pseudorandom number generators, OOPSLA 2014: its finaliser).
fn signs(mean: u64) -> u64 {
    let mut bits = mean.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}
