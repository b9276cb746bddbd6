//! The length-true map for free-form surfaces: the bicubic B-spline map of the drawing whose image on the surface has
//! the smallest strain, found by the Gauss–Newton method.
//!
//! Where the part is curved in both directions, some strain must remain, and the weights decide where. Lines, inked areas and
//! their shapes are visible. The empty space between them is not, so it may be distorted: its small weight only keeps
//! the parts of the drawing in their places.

mod as_drawn;
mod enclosed;
mod fold;
mod geodesics;
mod options;
mod rounds;
mod scales;
mod strain;

use multiversion::multiversion;
use nalgebra::{Matrix2, Vector2};

pub use self::options::{Figure, IsometricOptions};
use self::scales::EvenMap;
use self::strain::{Cap, Damped, Fineness, Sample, Strain, Weighting, Weights, products, samples};
use crate::geometry::fork::{self, Fork, InTurn, join};
use crate::geometry::ink::Ink;
use crate::geometry::normal_equations::{
    CellRow, CellSum, ComposedSum, EquationRows, GridSolver, NormalEquations, SolveError,
};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::{NurbsSurface, SurfaceJet};

/// A bicubic B-spline map from the drawing to the view.
#[derive(Debug, Clone, PartialEq)]
pub struct IsometricMap {
    knots_s: UniformKnots,
    knots_t: UniformKnots,
    control: Vec<Vector2<f64>>,
    /// The steps that led to the solution.
    pub iterations: Vec<Iteration>,
    /// Whether the search converged. If not, the map is the best one that was found.
    pub settled: bool,
    /// What the map keeps, if the one that the options ask for is worse than the drawing as it is.
    pub instead: Option<Instead>,
}

/// What a map keeps where the one that the options ask for is worse than the drawing as it is, in the figure that comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Instead {
    /// Lengths alone; shapes, areas and distances give way more than the options ask for.
    LengthsAlone,
    /// The drawing as it is, without a correction.
    AsDrawn,
}

/// One Gauss–Newton step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Number of cells of the map.
    pub cells: usize,
    /// Weighted mean squared strain before the step.
    pub energy: f64,
    /// Weighted mean squared strain after the step.
    pub reached: f64,
    /// Largest shift of a control point, mm.
    pub step: f64,
}

impl Iteration {
    /// Whether the step hardly moved the map.
    fn is_short(&self) -> bool {
        self.step <= MAX_LAST_STEP
    }
}

/// Why no map was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IsometricError {
    /// The search did not converge.
    #[error("the length-true map did not converge in {} steps; the last step still moved it by {:.4} mm",
        iterations.len(), iterations.last().map_or(f64::NAN, |last| last.step))]
    NotConverged {
        /// The steps taken.
        iterations: Vec<Iteration>,
    },
    /// The part curves too strongly under the drawing: the map would fold the drawing over itself.
    #[error("the drawing would be folded over itself at ({:.2}, {:.2}) mm in the view", at.x, at.y)]
    Folded {
        /// A point of the fold.
        at: ViewPoint,
    },
    /// The equations of a step could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// The search has converged when the relative change of the energy is below this; strains are then known to half of it.
const ENERGY_TOLERANCE: f64 = 0.03;
/// A mean squared strain treated as zero: 0.0001 mm in 100 mm.
const NO_STRAIN: f64 = 1e-12;
/// If the mean squared strain is at most this and the equations cannot be solved, no step is needed: 0.003 mm
/// in 100 mm.
const HARDLY_STRAINED: f64 = 1e-9;
/// Maximum number of steps on the fine grid.
const MAX_STEPS: usize = 20;
/// Maximum number of steps of the even map on the coarse grid; the fine grid continues from there.
const COARSE_STEPS: usize = 3;
/// Maximum number of steps on the coarse grid before the rounds on the fine one.
const START_STEPS: usize = 2;
/// A step that would have to be shortened to less than this share is damped instead.
const LEAST_SHARE: f64 = 0.1;
/// A damped step is shortened to no less than this share. If the energy still does not decrease, the surface is too rough for
/// its derivatives.
const SHORTEST: f64 = 1.0 / 64.0;
/// The first damping, as a multiple of the root of the energy. A turn by θ strains by θ²/2, which the
/// linearised strains do not contain.
const FIRST_DAMPING: f64 = 1.0 / 16.0;
/// The damping grows by this factor until a step does not overshoot.
const MORE_DAMPING: f64 = 8.0;
/// The damping of a step grows at most this many times.
const MOST_TRIES: usize = 5;
/// The search ends with a step shorter than this, mm: 16 bits over a field of 110 mm are 0.0017 mm.
const MIN_STEP: f64 = 1e-3;
/// A map whose last step was longer than this is rejected, mm.
const MAX_LAST_STEP: f64 = 0.05;
/// Weight of the pin relative to the mean strain's weight of 1: the anchor moves far less than a galvo resolves.
const PIN_WEIGHT: f64 = 1e4;

/// Weight of the sizes of cells that lines enclose, relative to that of inked areas: the lines are the ink.
const CELLS: f64 = 0.25;
/// Factors on the weight of the paper, tried one after the other while the map folds the paper between the
/// ink. The search starts in turn from the start for the ink and from the map with equal weights.
const STIFFER_PAPER: [f64; 6] = [1.0, 1.0, 4.0, 4.0, 16.0, 16.0];
/// Factors on the weight of the angles, tried one after the other.
const STIFFER: [f64; 3] = [1.0, 1.5, 2.2];
/// How finely the ink is sampled on the coarse grid.
const COARSE: Fineness = Fineness { most_places: 3000, parts: 2 };
/// How finely the ink is sampled on the fine grid.
const FINE: Fineness = Fineness { most_places: 3000, parts: 3 };

/// Fewer samples are processed faster than they are shared among threads.
const LEAST_SHARED: usize = 500;
/// The usual lengths of samples are close enough for cells with sides of this length, mm.
const USUAL_CELL: f64 = 1.0;
/// Samples are not made closer if there would be more pieces.
const MAX_CLOSE_PIECES: f64 = 1e5;

/// How rounds of weighting ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ending {
    /// With a better map than at the start, or with a map that leaves no error.
    Gained,
    /// With the map of the start, whose angles are within their limit.
    Within,
    /// With the map of the start, whose angles are beyond their limit.
    Beyond,
}

/// The strains of two halves of the samples.
type Strains = [Vec<Strain>; 2];

/// The problem that a map solves.
struct Task<'a> {
    surface: &'a NurbsSurface,
    samples: &'a [Sample],
    anchor: FlatPoint,
    /// Limit for the angle error of the ink.
    cap: Cap,
}

impl IsometricMap {
    /// The map with the smallest strain from the drawing onto `surface`.
    ///
    /// `ink` is the placed drawing. `anchor` keeps its place in the view, and the drawing's x direction there
    /// stays the view's x direction. Strain is the relative change of length, |F_d| − 1 for a unit direction
    /// d of the drawing and F(s, t) = (φ, f(φ)). Its derivatives by the control points include the change of
    /// the surface's slope and curvature as the point moves.
    ///
    /// The steps are Gauss–Newton steps, shortened or damped where they would overshoot (Nocedal & Wright,
    /// Numerical Optimization, 2006, section 10.3). They start from geodesic parallel coordinates, which are
    /// exact where the surface is developable. They continue on a grid with cells of twice the side and end
    /// on the fine grid. There, rounds of weighting make the map true where the options ask for it. The limit
    /// for the angle error of the ink comes from the map with equal weights, which is computed first.
    ///
    /// # Errors
    /// See [`IsometricError`].
    pub fn solve(
        surface: &NurbsSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
    ) -> Result<Self, IsometricError> {
        Self::solve_with_fork(surface, ink, anchor, options, &InTurn)
    }

    /// The same map as that of [`Self::solve`]; `fork` may do halves of the work at once.
    ///
    /// # Errors
    /// See [`IsometricError`].
    pub fn solve_with_fork(
        surface: &NurbsSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
        fork: &dyn Fork,
    ) -> Result<Self, IsometricError> {
        fork::start(fork, || Self::search(surface, ink, anchor, options, fork))
    }

    fn search(
        surface: &NurbsSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
        fork: &dyn Fork,
    ) -> Result<Self, IsometricError> {
        let with_cells = if options.are_outlines_areas { enclosed::with_enclosed_cells(ink) } else { None };
        let ink = with_cells.as_ref().unwrap_or(ink);
        let mut extents = ink.extents;
        extents.include(anchor.coords());
        let (knots_s, knots_t) = coarse_grid(&extents, options);
        let (fine_s, fine_t) = (knots_s.halved(), knots_t.halved());
        let is_even = options.is_even() || ink.pieces.is_empty() && ink.squares.is_empty();
        let of_cells = if with_cells.is_some() { CELLS } else { 1.0 };
        let given = IsometricOptions { area_weight: of_cells * options.area_weight, ..*options };
        let weights = if is_even { Weights::EVEN } else { given.weights() };
        let (coarse, (solver, fine)) = join(
            fork,
            || {
                let control = geodesics::parallel_coordinates(surface, anchor, &knots_s, &knots_t);
                let mut map =
                    Self { knots_s, knots_t, control, iterations: Vec::new(), settled: false, instead: None };
                let even = map.descend_coarse_grid(surface, ink, anchor, is_even, fork)?;
                Ok::<_, IsometricError>((map, even))
            },
            || (solver((&fine_s, &fine_t), fork), samples((&fine_s, &fine_t), ink, &weights, FINE)),
        );
        let ((mut map, even), solver) = (coarse?, solver?);
        map.refine();
        if let Some((even, mut flat)) = even {
            let start = map.control.clone();
            let mut first = Some(fine);
            for (attempt, paper) in STIFFER_PAPER.into_iter().enumerate() {
                if attempt % 2 == 1 {
                    if flat.control.len() < start.len() {
                        flat.refine();
                    }
                    map.control.clone_from(&flat.control);
                } else {
                    map.control.clone_from(&start);
                }
                let mut is_within = false;
                // Where the limit for the angle error leaves no gain, more weight on the angles comes nearer to it.
                for stiffness in STIFFER {
                    let options = IsometricOptions {
                        angle_weight: stiffness * given.angle_weight,
                        box_weight: paper * given.box_weight,
                        ..given
                    };
                    let mut fine = first.take().unwrap_or_else(|| map.samples(ink, &options.weights(), FINE));
                    let ending = map.rounds(surface, anchor, &mut fine, &even, &options, &solver);
                    map.settled = ending == Ending::Gained;
                    is_within |= ending == Ending::Within;
                    if map.settled {
                        break;
                    }
                }
                map.settled |= is_within;
                if !map.settled {
                    break;
                }
                if map.fold(surface, ink).is_none() {
                    return Ok(map);
                }
            }
            // The part is rough: sums of squares with steps that are as short as they must be.
            map.control = start;
            let fine = map.samples(ink, &Weights::START, FINE);
            let task = Task { surface, samples: &fine, anchor, cap: Cap(even.angle) };
            map.settled = map.descend(&task, &solver, MAX_STEPS)?;
        } else {
            let task = Task { surface, samples: &fine, anchor, cap: Cap::NONE };
            map.settled = map.descend(&task, &solver, MAX_STEPS)?;
        }
        if !map.settled && !map.iterations.last().is_some_and(Iteration::is_short) {
            return Err(IsometricError::NotConverged { iterations: map.iterations });
        }
        match map.fold(surface, ink) {
            Some(at) => Err(IsometricError::Folded { at }),
            None => Ok(map),
        }
    }

    /// The start of the search on the fine grid. If not all is weighted equally, also what the map with equal weights leaves, and this
    /// map.
    fn descend_coarse_grid(
        &mut self,
        surface: &NurbsSurface,
        ink: &Ink,
        anchor: FlatPoint,
        is_even: bool,
        fork: &dyn Fork,
    ) -> Result<Option<(EvenMap, Self)>, IsometricError> {
        let solver = solver((&self.knots_s, &self.knots_t), fork)?;
        let even = self.samples(ink, &Weights::EVEN, COARSE);
        let even_steps = if is_even { COARSE_STEPS } else { 1 };
        self.descend(&Task { surface, samples: &even, anchor, cap: Cap::NONE }, &solver, even_steps)?;
        if is_even {
            return Ok(None);
        }
        let inked = self.samples(ink, &Weights::START, COARSE);
        let task = Task { surface, samples: &inked, anchor, cap: Cap::NONE };
        let even = self.even_strains(&task);
        let flat = self.clone();
        self.descend(&Task { cap: Cap(even.angle), ..task }, &solver, START_STEPS)?;
        Ok(Some((even, flat)))
    }

    /// The image of a point of the drawing; outside the drawing's box the border polynomials are extrapolated.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        let (s, t) = (self.knots_s.basis(at.x), self.knots_t.basis(at.y));
        self.sum(&s, &t, &products(&s.value, &t.value)).into()
    }

    fn sum(&self, s: &Basis, t: &Basis, products: &[f64; 16]) -> Vector2<f64> {
        let columns = self.knots_s.control_points();
        let mut total = Vector2::zeros();
        for row in 0..4 {
            let start = (t.first + row) * columns + s.first;
            for column in 0..4 {
                total += self.control[start + column] * products[row * 4 + column];
            }
        }
        total
    }

    fn samples(&self, ink: &Ink, weights: &Weights, fineness: Fineness) -> Vec<Sample> {
        samples((&self.knots_s, &self.knots_t), ink, weights, fineness)
    }

    /// Lowers the energy until it converges or the steps are used up; returns whether it converged.
    fn descend(
        &mut self,
        task: &Task,
        solver: &GridSolver<2>,
        max_steps: usize,
    ) -> Result<bool, IsometricError> {
        let cells = self.knots_s.spans() * self.knots_t.spans();
        let fork = solver.fork();
        // One buffer for all steps: it is large.
        let mut strains = Strains::default();
        let mut energy = self.energy(task, &mut strains, fork);
        let mut damping = 0.0;
        for _ in 0..max_steps {
            let start = self.control.clone();
            let mut tries = 0;
            let (shifts, expected, fraction, reached) = loop {
                let damped = Damped { weighting: &task.cap, damping };
                let equations = equations(self, task.anchor, task.samples, &strains, &damped, fork);
                let is_last = tries == MOST_TRIES;
                match equations.solve(solver) {
                    Ok(shifts) => {
                        let expected = equations.gain(&shifts);
                        let shortest = if is_last { SHORTEST } else { LEAST_SHARE };
                        let (fraction, reached) = self.shift(
                            task,
                            (&start, &shifts),
                            (energy, expected),
                            shortest,
                            &mut strains,
                            fork,
                        );
                        if is_last || is_gained(energy - reached, expected, fraction) {
                            break (shifts, expected, fraction, reached);
                        }
                        self.control.clone_from(&start);
                        self.energy(task, &mut strains, fork);
                    }
                    Err(_) if is_last && energy <= HARDLY_STRAINED => return Ok(true),
                    Err(error) if is_last => return Err(error.into()),
                    Err(_) => {}
                }
                tries += 1;
                damping = more_damping(damping, energy);
            };
            if !(reached <= energy + NO_STRAIN) {
                self.control = start;
                self.iterations.push(Iteration { cells, energy, reached: energy, step: 0.0 });
                return Ok(false);
            }
            let largest = shifts.iter().map(|&shift| Vector2::from(shift).norm()).fold(0.0, f64::max);
            let step = largest * fraction;
            self.iterations.push(Iteration { cells, energy, reached, step });
            let (gain, missed) = (energy - reached, (energy - expected - reached).abs());
            energy = reached;
            // If a full step reaches the prediction of the linearised strains, the next one would gain nothing.
            let as_predicted = fraction == 1.0
                && damping == 0.0
                && expected < reached
                && missed <= ENERGY_TOLERANCE * reached;
            let no_gain = fraction > 0.1 && gain <= ENERGY_TOLERANCE / 4.0 * reached;
            let is_short = fraction > 0.1 && step <= MIN_STEP;
            if reached <= NO_STRAIN || as_predicted || no_gain || is_short {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Moves the control points from `start` by a share of `shifts` that gains at least half of what is predicted for it, or by one
    /// that is at most `shortest`; returns the share and the energy that it reaches.
    fn shift(
        &mut self,
        task: &Task,
        (start, shifts): (&[Vector2<f64>], &[[f64; 2]]),
        (energy, expected): (f64, f64),
        shortest: f64,
        strains: &mut Strains,
        fork: &dyn Fork,
    ) -> (f64, f64) {
        let mut fraction = 1.0;
        loop {
            for (point, (old, shift)) in self.control.iter_mut().zip(start.iter().zip(shifts)) {
                *point = old + Vector2::from(*shift) * fraction;
            }
            let reached = self.energy(task, strains, fork);
            if is_gained(energy - reached, expected, fraction) || fraction <= shortest {
                return (fraction, reached);
            }
            let missed = reached - energy + predicted(expected, fraction);
            fraction = shorter(fraction, expected, missed / fraction.powi(4));
        }
    }

    /// The strain at a sample without its derivatives: the surface's second derivatives are 0.
    fn strain_only(&self, surface: &NurbsSurface, sample: &Sample) -> Strain {
        let [at, by_s, by_t] = self.image(sample);
        let jet =
            SurfaceJet { height: 0.0, gradient: surface.gradient(at.into()), hessian: Matrix2::zeros() };
        Strain { jet, by_s, by_t }
    }

    /// The image φ of a sample, ∂φ/∂s and ∂φ/∂t.
    #[inline(always)]
    fn image(&self, Sample { s, t, .. }: &Sample) -> [Vector2<f64>; 3] {
        let columns = self.knots_s.control_points();
        let [mut at, mut by_s, mut by_t] = [Vector2::zeros(); 3];
        for row in 0..4 {
            let start = (t.first + row) * columns + s.first;
            let line = &self.control[start..start + 4];
            let [mut value, mut slope] = [Vector2::zeros(); 2];
            for column in 0..4 {
                value += line[column] * s.value[column];
                slope += line[column] * s.slope[column];
            }
            at += value * t.value[row];
            by_s += slope * t.value[row];
            by_t += value * t.slope[row];
        }
        [at, by_s, by_t]
    }

    /// The energy and, for the next step, the strain at each place.
    fn energy(&self, task: &Task, strains: &mut Strains, fork: &dyn Fork) -> f64 {
        let mut energy = 0.0;
        self.pin(task.anchor, |residual, _| energy += PIN_WEIGHT * residual * residual);
        let of_half = |samples: &[Sample], strains: &[Strain]| {
            let mut energy = 0.0;
            for (place, strain) in samples.chunk_by(Sample::is_at).zip(strains) {
                for sample in place {
                    let mut add = |weight: f64, residual: f64, _: &_| energy += weight * residual * residual;
                    task.cap.observe(strain, sample, &mut add);
                }
            }
            energy
        };
        let [low, high] = self.strained(task.surface, task.samples, strains, fork, of_half);
        energy + low + high
    }

    /// Finds the strain at each place, and what `of_half` finds for halves of the samples and their strains.
    fn strained<T: Send>(
        &self,
        surface: &NurbsSurface,
        samples: &[Sample],
        strains: &mut Strains,
        fork: &dyn Fork,
        of_half: impl Fn(&[Sample], &[Strain]) -> T + Sync,
    ) -> [T; 2] {
        let ([low, high], [low_strains, high_strains]) = (halves(samples), strains);
        let fork = if samples.len() < LEAST_SHARED { &InTurn } else { fork };
        let half = |samples: &[Sample], strains: &mut Vec<Strain>| {
            strains_at(self, surface, samples, strains);
            of_half(samples, strains)
        };
        join(fork, || half(low, low_strains), || half(high, high_strains)).into()
    }

    /// The residuals that keep the anchor at its place, and the drawing's x direction there parallel to the view's.
    fn pin(&self, anchor: FlatPoint, mut take: impl FnMut(f64, &CellRow<2>)) {
        let (s, t) = (self.knots_s.basis(anchor.x), self.knots_t.basis(anchor.y));
        let (value, value_s) = (products(&s.value, &t.value), products(&s.slope, &t.value));
        let image = self.sum(&s, &t, &value);
        take(image.x - anchor.x, &value.map(|n| [n, 0.0]));
        take(image.y - anchor.y, &value.map(|n| [0.0, n]));
        take(self.sum(&s, &t, &value_s).y, &value_s.map(|n| [0.0, n]));
    }

    /// Halves the cells without changing the map.
    fn refine(&mut self) {
        self.control = self.knots_s.halved_net(&self.control);
        (self.knots_s, self.knots_t) = (self.knots_s.halved(), self.knots_t.halved());
    }
}

/// The strain at each place.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn strains_at(map: &IsometricMap, surface: &NurbsSurface, samples: &[Sample], strains: &mut Vec<Strain>) {
    strains.clear();
    strains.extend(samples.chunk_by(Sample::is_at).map(|place| {
        let [at, by_s, by_t] = map.image(&place[0]);
        Strain { jet: surface.jet(at.into()), by_s, by_t }
    }));
}

/// The equations of a step from the strain at each place, with the pin at the anchor.
fn equations(
    map: &IsometricMap,
    anchor: FlatPoint,
    samples: &[Sample],
    strains: &Strains,
    weighting: &(impl Weighting + Sync),
    fork: &dyn Fork,
) -> NormalEquations<2> {
    let mut equations = NormalEquations::new(map.knots_s.control_points(), map.knots_t.control_points());
    let ([low, high], [low_strains, high_strains]) = (halves(samples), strains);
    let row = |sample: Option<&Sample>| sample.map_or(0, |sample| sample.t.first);
    let start = row(high.first());
    // The four rows of control points of a cell.
    let shared = start..row(low.last()).max(start) + 4;
    equations.fill_halves(
        fork,
        shared,
        |rows| add_cells(low, low_strains, weighting, std::slice::from_mut(rows)),
        |rows| add_cells(high, high_strains, weighting, rows),
    );
    let mut pinned = CellSum::default();
    map.pin(anchor, |residual, derivative| pinned.add(derivative, -residual, PIN_WEIGHT));
    let (s, t) = (map.knots_s.span(anchor.x), map.knots_t.span(anchor.y));
    equations.add_cell(s, t, &pinned);
    // A control point at a corner far from all ink may be almost undetermined; this fixes it.
    equations.add_third_difference_penalty(1e-10);
    equations
}

/// Adds what is measured at some samples to the equations of some rows.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2"))]
fn add_cells(
    samples: &[Sample],
    strains: &[Strain],
    weighting: &impl Weighting,
    rows: &mut [EquationRows<2>],
) {
    let mut strains = strains.iter();
    for cell in samples.chunk_by(|a, b| a.cell() == b.cell()) {
        let mut sum = CellSum::default();
        for (place, strain) in cell.chunk_by(Sample::is_at).zip(&mut strains) {
            let mut observed = ComposedSum::default();
            for sample in place {
                weighting.observe(strain, sample, |weight, residual, derivative| {
                    observed.add(derivative, -residual, weight);
                });
            }
            sum.add_composed(&observed, &place[0].basis());
        }
        rows.iter_mut().for_each(|rows| rows.add_cell(cell[0].s.first, cell[0].t.first, &sum));
    }
}

/// Two halves of the samples, divided between cells. They do not depend on who works on them, nor do sums over them.
fn halves(samples: &[Sample]) -> [&[Sample]; 2] {
    let (low, high) = samples.split_at(half_of(samples));
    [low, high]
}

/// The number of samples in the first half.
fn half_of(samples: &[Sample]) -> usize {
    let middle = samples.len() / 2;
    let Some(cell) = samples.get(middle).map(Sample::cell) else { return 0 };
    middle + samples[middle..].iter().take_while(|sample| sample.cell() == cell).count()
}

/// The solver for a grid.
fn solver<'f>(
    (knots_s, knots_t): (&UniformKnots, &UniformKnots),
    fork: &'f dyn Fork,
) -> Result<GridSolver<'f, 2>, SolveError> {
    Ok(GridSolver::new(knots_s.control_points(), knots_t.control_points())?.with_fork(fork))
}

/// The next damping to try after one with which a step overshot.
fn more_damping(damping: f64, energy: f64) -> f64 {
    (MORE_DAMPING * damping).max(FIRST_DAMPING * energy.sqrt())
}

/// The gain that the linearised strains predict for a share of a step, from that of the whole step.
fn predicted(expected: f64, fraction: f64) -> f64 {
    fraction * (2.0 - fraction) * expected
}

/// Whether a share of a step gains at least half of what is predicted.
fn is_gained(gain: f64, expected: f64, fraction: f64) -> bool {
    gain >= predicted(expected, fraction) / 2.0 - NO_STRAIN
}

/// The fraction f that minimises expected·(f² − 2f) + excess·f⁴: the gain that the linearised strains predict, and the
/// error of that prediction, which grows at least with the fourth power.
fn shorter(fraction: f64, expected: f64, excess: f64) -> f64 {
    let mut lowest = fraction;
    // The slope is convex and increasing, so Newton's method approaches its root from above.
    for _ in 0..8 {
        let slope = 2.0 * expected * (lowest - 1.0) + 4.0 * excess * lowest.powi(3);
        lowest -= slope / (2.0 * expected + 12.0 * excess * lowest.powi(2));
    }
    lowest.clamp(fraction / 8.0, fraction * 0.75)
}

/// Samples of a drawing. Between samples, a map is free: in small drawings, whose maps have small cells, the samples are so close
/// that each cell has several. `sample` takes the factor on the usual lengths of pieces and sides of squares.
pub(super) fn several_in_cell(sample: impl Fn(f64) -> Ink) -> Ink {
    let ink = sample(1.0);
    let factor = least_cell(&ink.extents) / USUAL_CELL;
    // Where lines are that dense, every cell has samples.
    let factor = factor.max(ink.pieces.len() as f64 / MAX_CLOSE_PIECES);
    if factor < 1.0 { sample(factor) } else { ink }
}

/// The side of the smallest cells of a map of a drawing, mm.
fn least_cell(extents: &Extents) -> f64 {
    let (size, options) = (box_of(extents), &IsometricOptions::UNIFORM);
    options.cell.min((size.x * size.y / options.cells[0] as f64).sqrt())
}

/// The size of the box of a map, mm: a drawing that is a single line or dot is widened to a band.
fn box_of(extents: &Extents) -> Vector2<f64> {
    let longest = extents.size().max();
    extents.size().map(|side| side.max(longest * 0.05).max(1e-3))
}

/// Knots over the drawing's box, with cells of about twice the side that the options specify.
fn coarse_grid(extents: &Extents, options: &IsometricOptions) -> (UniformKnots, UniformKnots) {
    let size = box_of(extents);
    let [largest, smallest] = options.cells.map(|cells| (size.x * size.y / cells as f64).sqrt());
    let cell = 2.0 * options.cell.min(largest).max(smallest);
    let along = |center: f64, length: f64| {
        let spans = (length / cell).round().max(2.0);
        UniformKnots::new(center - length / 2.0, length / spans, spans as usize)
    };
    (along(extents.center().x, size.x), along(extents.center().y, size.y))
}

#[cfg(test)]
mod tests;
