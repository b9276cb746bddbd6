//! Rounds of weighting and solving, which make the sum of the strains' absolute values, and the largest angle
//! error, as small as possible.
//!
//! A Gauss–Newton step lowers a weighted sum of squares. With weights that fall with the strains of the step
//! before, the sum of squares becomes a sum of absolute values (Huber, Robust Statistics, 1981, section 7.8),
//! as e_l and e_a are. With weights that grow where an angle error is larger than elsewhere, only the largest
//! errors resist in the end (Arora, Hazan & Kale, The multiplicative weights update method, Theory of
//! Computing 2012).

use nalgebra::Vector2;

use super::scales::{EvenMap, Scales};
use super::strain::{Damped, Sample, Strain};
use super::{
    Ending, IsometricMap, IsometricOptions, Iteration, MOST_TRIES, Strains, Task, equations, half_of,
    more_damping,
};
use crate::geometry::normal_equations::GridSolver;
use crate::geometry::space::FlatPoint;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Maximum number of rounds; drawings of letters take three to five, large filled shapes more.
const MAX_ROUNDS: usize = 8;
/// Maximum number of thorough rounds.
const MOST_THOROUGH: usize = 60;
/// Thorough rounds end when none of this number of rounds lowers the cost of the best one by
/// [`THOROUGH_GAIN`].
const THOROUGH_PATIENCE: usize = 6;
/// In thorough rounds, a gain lowers the cost by at least this share.
const THOROUGH_GAIN: f64 = 0.01;
/// The rounds end when a round lowers the cost by less than this share. Before the first gain, and always
/// while angles are beyond their limit, [`LEAST_GAIN_BEYOND`] applies instead.
const LEAST_GAIN: f64 = 0.25;
/// Before the first gain, and always while angles are beyond their limit, the rounds end when a round lowers
/// the cost by less than this share.
const LEAST_GAIN_BEYOND: f64 = 0.03;
/// Strains and angle errors (rad) below this do not matter: 0.001 mm in 100 mm.
const SMALL: f64 = 1e-5;
/// From round to round, the weight of an angle error changes with the power 3/2 of the ratio of the error to
/// the mean of all. The ratio is limited to this range.
const ANGLE_RATIOS: [f64; 2] = [0.3, 3.0];
/// The weight of all angles in the first rounds, relative to later ones: the largest angles are not yet
/// known.
const FIRST_WEIGHTS: [f64; 2] = [3.0, 1.7];
/// Paper that gives way more than this many times as much as with the even map becomes stiffer.
const PAPER: f64 = 2.0;
/// A step that multiplies the cost by more than this is damped.
const OVERSHOOT: f64 = 4.0;

/// The scales of the weights for a map with these strains.
fn scales(start: &Figures, even: &EvenMap, options: &IsometricOptions) -> Scales {
    // The more of the angle error is spread over the ink, the less it can be moved to where no ink is.
    let spread = (start.mean_angle + SMALL) / (even.angle + SMALL);
    Scales {
        line: start.line + SMALL,
        area: start.area + SMALL,
        paper: PAPER * even.strain + SMALL,
        angles: options.angle_weight * spread.min(1.0).powf(1.5),
        limit: options.angle_limit * even.angle + SMALL,
    }
}

/// The strains of a map.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    /// Mean absolute strain along the lines.
    line: f64,
    /// Mean absolute strain of inked areas.
    area: f64,
    /// Mean square of the strains over the box, weighted.
    paper: f64,
    /// Root of the mean square of the angle errors under their weights, rad.
    mean_angle: f64,
    /// Largest angle error, rad.
    largest_angle: f64,
}

/// Sums over some samples.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Sums of strains times their weights; the largest angle error.
    strains: Figures,
    /// Sums of the weights of lines, areas and angles.
    lines: f64,
    areas: f64,
    angles: f64,
}

impl Sums {
    fn of(samples: &[Sample], strains: &[Strain]) -> Self {
        let mut sums = Self::default();
        for (place, strain) in samples.chunk_by(Sample::is_at).zip(strains) {
            let angle = strain.angle_error();
            for sample in place {
                if sample.line > 0.0 {
                    sums.lines += sample.line;
                    sums.strains.line += sample.line * strain.along(sample).abs();
                }
                if sample.area > 0.0 {
                    sums.areas += sample.area;
                    sums.strains.area += sample.area * (strain.area() - 1.0).abs();
                }
                if sample.all_round > 0.0 {
                    sums.strains.paper += sample.all_round
                        * (strain.largest_stretch().powi(2)
                            + strain.resistance_to_folds() * (strain.area() - 1.0).powi(2));
                }
                if sample.is_ink() {
                    sums.angles += sample.angle;
                    sums.strains.mean_angle += sample.angle * angle * angle;
                    sums.strains.largest_angle = sums.strains.largest_angle.max(angle);
                }
            }
        }
        sums
    }
}

impl Figures {
    fn of([low, high]: [Sums; 2]) -> Self {
        let mean = |sum: f64, weights: f64| if weights > 0.0 { sum / weights } else { 0.0 };
        let (one, other) = (low.strains, high.strains);
        let mean_square = mean(one.mean_angle + other.mean_angle, low.angles + high.angles);
        Self {
            line: mean(one.line + other.line, low.lines + high.lines),
            area: mean(one.area + other.area, low.areas + high.areas),
            paper: one.paper + other.paper,
            mean_angle: mean_square.sqrt().max(f64::MIN_POSITIVE),
            largest_angle: one.largest_angle.max(other.largest_angle),
        }
    }

    /// What the rounds lower.
    fn cost(&self, scales: &Scales, options: &IsometricOptions) -> f64 {
        options.line_weight * self.line.powi(2)
            + options.area_weight * self.area.powi(2)
            + scales.angles * self.largest_angle.powi(2)
            + self.paper
    }

    /// The cost, much higher for a map that shears beyond the limit.
    fn verdict(&self, scales: &Scales, options: &IsometricOptions) -> f64 {
        self.cost(scales, options) * (self.largest_angle / scales.limit).max(1.0).powi(8)
    }
}

impl IsometricMap {
    /// What this map, made with equal weights, leaves at the ink and over the box.
    pub(super) fn even_strains(&self, task: &Task) -> EvenMap {
        let mut even = EvenMap { angle: 0.0, strain: 0.0 };
        for place in task.samples.chunk_by(Sample::is_at) {
            let strain = self.strain_only(task.surface, &place[0]);
            if place.iter().any(Sample::is_ink) {
                even.angle = even.angle.max(strain.angle_error());
            } else {
                even.strain = even.strain.max(strain.largest_stretch());
            }
        }
        even
    }

    /// Rounds from the map as it is to the best one that is found.
    pub(super) fn rounds(
        &mut self,
        surface: &NurbsSurface,
        anchor: FlatPoint,
        samples: &mut [Sample],
        even: &EvenMap,
        options: &IsometricOptions,
        solver: &GridSolver<2>,
    ) -> Ending {
        let cells = self.knots_s.spans() * self.knots_t.spans();
        // One buffer for all rounds: it is large.
        let fork = solver.fork();
        let mut strains = Strains::default();
        let mut figures = Figures::of(self.strained(surface, samples, &mut strains, fork, Sums::of));
        if figures.line.max(figures.area).max(figures.largest_angle) <= SMALL {
            return Ending::Gained;
        }
        let scales = scales(&figures, even, options);
        let mut cost = figures.cost(&scales, options);
        let mut best = figures.verdict(&scales, options);
        let mut kept = self.control.clone();
        let (mut last, mut has_gained) = (best, false);
        let starts_within = figures.largest_angle <= scales.limit;
        let (mut landmark, mut since) = (best, 0);
        let mut damping = 0.0;
        'rounds: for round in 0..if options.is_thorough { MOST_THOROUGH } else { MAX_ROUNDS } {
            let first = FIRST_WEIGHTS.get(round).copied().unwrap_or(1.0);
            weigh_angles(samples, &strains, &figures, scales.angles * first, round > 0);
            let (start, before) = (self.control.clone(), cost);
            // The damping is a multiple of the weight of the paper, which is small.
            let scale = before / options.box_weight.powi(2);
            let mut tries = 0;
            let shifts = loop {
                let damped = Damped { weighting: &scales, damping };
                let equations = equations(self, anchor, samples, &strains, &damped, fork);
                let solved = equations.solve(solver);
                tries += 1;
                let Ok(shifts) = solved else {
                    if tries > MOST_TRIES {
                        break 'rounds;
                    }
                    damping = more_damping(damping, scale);
                    continue;
                };
                for (point, (old, shift)) in self.control.iter_mut().zip(start.iter().zip(&shifts)) {
                    *point = old + Vector2::from(*shift);
                }
                figures = Figures::of(self.strained(surface, samples, &mut strains, fork, Sums::of));
                cost = figures.cost(&scales, options);
                if cost <= OVERSHOOT * before || tries > MOST_TRIES {
                    break shifts;
                }
                damping = more_damping(damping, scale);
                self.control.clone_from(&start);
                self.strained(surface, samples, &mut strains, fork, |_, _| ());
            };
            let largest = shifts.iter().map(|&shift| Vector2::from(shift).norm()).fold(0.0, f64::max);
            self.iterations.push(Iteration { cells, energy: before, reached: cost, step: largest });
            let verdict = figures.verdict(&scales, options);
            if verdict < best {
                (best, has_gained) = (verdict, true);
                kept.clone_from(&self.control);
            }
            if options.is_thorough {
                since += 1;
                if best <= (1.0 - THOROUGH_GAIN) * landmark {
                    (landmark, since) = (best, 0);
                }
                if since >= THOROUGH_PATIENCE {
                    break;
                }
                continue;
            }
            // In the first rounds the angles are not yet weighted as they will be.
            let is_within = has_gained && figures.largest_angle <= scales.limit;
            let least = if is_within { LEAST_GAIN } else { LEAST_GAIN_BEYOND };
            if !(verdict <= (1.0 - least) * last) && round >= FIRST_WEIGHTS.len() {
                break;
            }
            last = verdict;
        }
        self.control = kept;
        match (has_gained, starts_within) {
            (true, _) => Ending::Gained,
            (false, true) => Ending::Within,
            (false, false) => Ending::Beyond,
        }
    }
}

/// Multiplies the weights of angle errors by a power of their size, and scales them so that they sum up to `total`.
fn weigh_angles(samples: &mut [Sample], strains: &Strains, figures: &Figures, total: f64, by_size: bool) {
    let mut sum = 0.0;
    let (low, high) = samples.split_at_mut(half_of(samples));
    for (samples, strains) in [low, high].into_iter().zip(strains) {
        for (place, strain) in samples.chunk_by_mut(Sample::is_at).zip(strains) {
            let ratio = (strain.angle_error() / figures.mean_angle).clamp(ANGLE_RATIOS[0], ANGLE_RATIOS[1]);
            let factor = if by_size { ratio * ratio.sqrt() } else { 1.0 };
            for sample in place {
                sample.angle *= factor;
                sum += sample.angle;
            }
        }
    }
    let scale = if sum > 0.0 { total / sum } else { 0.0 };
    samples.iter_mut().for_each(|sample| sample.angle *= scale);
}
