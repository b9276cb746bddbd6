//! The length-true map for free-form surfaces: the bicubic B-spline map of the drawing whose image on the surface has
//! the smallest strain, found by Gauss–Newton.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::ink::Ink;
use crate::geometry::normal_equations::{CellRow, CellSum, GridSolver, NormalEquations, SolveError};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::knots::{Basis, UniformKnots};
use crate::geometry::surface::nurbs::{NurbsSurface, SurfaceJet};

/// What the strain is weighted by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsometricOptions {
    /// Weight of the mean squared strain along the drawing's own lines.
    pub line_weight: f64,
    /// Weight of the mean squared area strain over the inked area.
    pub area_weight: f64,
    /// Weight of the mean squared strain over the whole box, all directions alike. It keeps shapes in shape: with
    /// little of it the lines become truer still, but filled areas shear.
    pub shape_weight: f64,
    /// Smallest side of a cell of the map, mm.
    pub cell: f64,
    /// Number of cells that the box is divided into at most.
    pub most_cells: usize,
}

impl IsometricOptions {
    /// All of the drawing's box counts evenly.
    pub const UNIFORM: Self =
        Self { line_weight: 0.0, area_weight: 0.0, shape_weight: 1.0, cell: 2.0, most_cells: 900 };
    /// What is inked counts most.
    pub const INK: Self = Self { line_weight: 1.0, area_weight: 1.0, ..Self::UNIFORM };
}

/// A bicubic B-spline map from the drawing to the view.
#[derive(Debug, Clone, PartialEq)]
pub struct IsometricMap {
    knots_s: UniformKnots,
    knots_t: UniformKnots,
    control: Vec<Vector2<f64>>,
    /// How the solution was reached.
    pub iterations: Vec<Iteration>,
}

/// One Gauss–Newton step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Weighted mean squared strain before the step.
    pub energy: f64,
    /// Largest shift of a control point, mm.
    pub step: f64,
}

/// Why no map was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IsometricError {
    /// The iteration did not settle.
    #[error("the length-true map did not settle in {} steps; the last one still moved it by {:.4} mm",
        iterations.len(), iterations.last().map_or(f64::NAN, |last| last.step))]
    NotConverged {
        /// The steps taken.
        iterations: Vec<Iteration>,
    },
    /// The equations of a step could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// A step below this, mm, ends the iteration: a thousandth of what a galvo resolves.
const SETTLED: f64 = 1e-6;
/// A step that lowers the energy by less than this share of it ends the iteration too: where strain must remain, Gauss
/// and Newton's steps shrink slowly at the end, over control points that hardly matter.
const NO_GAIN: f64 = 1e-5;
/// Steps tried before giving up.
const MOST_STEPS: usize = 40;
/// Weight of the pin against the mean strain's of 1: it holds the anchor far below what a galvo resolves.
const PIN_WEIGHT: f64 = 1e4;

/// A place where strain is measured.
struct Sample {
    s: Basis,
    t: Basis,
    kind: Kind,
}

enum Kind {
    /// Strain along a unit direction of the drawing.
    Along(Vector2<f64>, f64),
    /// Strain of the area.
    Area(f64),
    /// Strain along four directions 45° apart.
    AllRound(f64),
}

/// First-order behaviour of the map at a sample, lifted to the surface.
struct Local {
    jet: SurfaceJet,
    by_s: Vector2<f64>,
    by_t: Vector2<f64>,
    value: [f64; 16],
    value_s: [f64; 16],
    value_t: [f64; 16],
}

impl IsometricMap {
    /// The map of least strain from the drawing onto `surface`.
    ///
    /// `ink` is the placed drawing; `anchor` stays where it is in the view, and the drawing's x direction there stays
    /// the view's x direction. Strain is the relative change of length, |F_d| − 1 for a unit direction d of the drawing
    /// and F(s, t) = (φ, f(φ)); its derivatives by the control points take in how slope and curvature of the surface
    /// change where the point moves to. The steps are those of Gauss and Newton, halved where they would overshoot
    /// (Nocedal & Wright, Numerical Optimization, 2006, section 10.3).
    ///
    /// # Errors
    /// See [`IsometricError`].
    pub fn solve(
        surface: &NurbsSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
    ) -> Result<Self, IsometricError> {
        let mut extents = ink.extents;
        extents.include(anchor.coords());
        let (knots_s, knots_t) = grid_over(&extents, options);
        let mut map = Self { knots_s, knots_t, control: Vec::new(), iterations: Vec::new() };
        map.start_affine(surface, anchor);
        let samples = map.samples(ink, options);
        let solver = GridSolver::new(knots_s.control_points(), knots_t.control_points())?;
        let mut energy = map.energy(surface, &samples);
        while map.iterations.len() < MOST_STEPS {
            let equations = map.linearised(surface, &samples, anchor);
            let shifts: Vec<Vector2<f64>> =
                equations.solve(&solver)?.into_iter().map(Vector2::from).collect();
            let largest = shifts.iter().map(Vector2::norm).fold(0.0, f64::max);
            let start = map.control.clone();
            let mut fraction = 1.0;
            let reached = loop {
                for (point, (old, shift)) in map.control.iter_mut().zip(start.iter().zip(&shifts)) {
                    *point = old + shift * fraction;
                }
                let reached = map.energy(surface, &samples);
                // The pin may cost a little strain in the first step, and rounding a little in the last ones.
                if reached <= energy * (1.0 + 1e-9) + 1e-14 || fraction < 0.02 || map.iterations.is_empty() {
                    break reached;
                }
                fraction /= 2.0;
            };
            map.iterations.push(Iteration { energy, step: largest * fraction });
            let gain = energy - reached;
            energy = reached;
            if largest < SETTLED || (fraction == 1.0 && gain.abs() <= NO_GAIN * energy) {
                return Ok(map);
            }
        }
        Err(IsometricError::NotConverged { iterations: map.iterations })
    }

    /// The image of a point of the drawing; outside the drawing's box the border polynomials are continued.
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

    /// Starts from the map that is exact for the tangent plane at the anchor.
    fn start_affine(&mut self, surface: &NurbsSurface, anchor: FlatPoint) {
        let jet = surface.jet(ViewPoint::from(anchor.coords()));
        let linear = tangent_frame(&jet.gradient);
        let columns = self.knots_s.control_points();
        let count = columns * self.knots_t.control_points();
        let point = |index: usize| {
            let flat =
                Vector2::new(self.knots_s.greville(index % columns), self.knots_t.greville(index / columns));
            anchor.coords() + linear * (flat - anchor.coords())
        };
        self.control = (0..count).map(point).collect();
    }

    fn samples(&self, ink: &Ink, options: &IsometricOptions) -> Vec<Sample> {
        let mut samples = Vec::new();
        let mut add = |at: Vector2<f64>, kind: Kind| {
            samples.push(Sample { s: self.knots_s.basis(at.x), t: self.knots_t.basis(at.y), kind });
        };
        // Two Gauss points a cell and direction integrate cubics exactly.
        let (columns, rows) = (self.knots_s.spans(), self.knots_t.spans());
        let gauss = [0.5 - (1.0f64 / 12.0).sqrt(), 0.5 + (1.0f64 / 12.0).sqrt()];
        // Four Gauss points a cell, four directions each.
        let weight = options.shape_weight / (columns * rows * 16) as f64;
        for cell in 0..columns * rows {
            for (u, v) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let s = self.knots_s.start() + ((cell % columns) as f64 + gauss[u]) * self.knots_s.step();
                let t = self.knots_t.start() + ((cell / columns) as f64 + gauss[v]) * self.knots_t.step();
                add(Vector2::new(s, t), Kind::AllRound(weight));
            }
        }
        let length = ink.length();
        if options.line_weight > 0.0 {
            for piece in ink.pieces.iter().filter(|piece| piece.length() > 0.0) {
                let direction = (piece.to - piece.from).normalize();
                let weight = options.line_weight * piece.length() / length;
                add(piece.from.lerp(piece.to, 0.5).coords(), Kind::Along(direction, weight));
            }
        }
        if options.area_weight > 0.0 {
            let weight = options.area_weight / ink.squares.len() as f64;
            for square in &ink.squares {
                add(square.coords(), Kind::Area(weight));
            }
        }
        samples.sort_by_key(|sample| (sample.t.first, sample.s.first));
        samples
    }

    fn local(&self, surface: &NurbsSurface, sample: &Sample) -> Local {
        let (s, t) = (&sample.s, &sample.t);
        let value = products(&s.value, &t.value);
        let value_s = products(&s.slope, &t.value);
        let value_t = products(&s.value, &t.slope);
        let jet = surface.jet(self.sum(s, t, &value).into());
        Local { jet, by_s: self.sum(s, t, &value_s), by_t: self.sum(s, t, &value_t), value, value_s, value_t }
    }

    fn energy(&self, surface: &NurbsSurface, samples: &[Sample]) -> f64 {
        let strains = samples.iter().map(|sample| {
            let local = self.local(surface, sample);
            match sample.kind {
                Kind::Along(direction, weight) => weight * (local.stretch(&direction) - 1.0).powi(2),
                Kind::Area(weight) => weight * (local.area() - 1.0).powi(2),
                Kind::AllRound(weight) => {
                    weight * ALL_ROUND.iter().map(|turn| (local.stretch(turn) - 1.0).powi(2)).sum::<f64>()
                }
            }
        });
        strains.sum()
    }

    fn linearised(
        &self,
        surface: &NurbsSurface,
        samples: &[Sample],
        anchor: FlatPoint,
    ) -> NormalEquations<2> {
        let mut equations =
            NormalEquations::new(self.knots_s.control_points(), self.knots_t.control_points());
        for cell in samples.chunk_by(|a, b| (a.s.first, a.t.first) == (b.s.first, b.t.first)) {
            let mut sum = CellSum::default();
            for sample in cell {
                let local = self.local(surface, sample);
                match sample.kind {
                    Kind::Along(direction, weight) => local.observe_stretch(&direction, weight, &mut sum),
                    Kind::Area(weight) => local.observe_area(weight, &mut sum),
                    Kind::AllRound(weight) => {
                        ALL_ROUND.iter().for_each(|turn| local.observe_stretch(turn, weight, &mut sum));
                    }
                }
            }
            equations.add_cell(cell[0].s.first, cell[0].t.first, &sum);
        }
        self.pin(&mut equations, anchor);
        // Without ink and without a metric's pull a control point at a corner may be loose; this holds it still.
        equations.add_third_difference_penalty(1e-12);
        equations
    }

    /// Holds the anchor's image at the anchor, and the image of the drawing's x direction there on the view's.
    fn pin(&self, equations: &mut NormalEquations<2>, anchor: FlatPoint) {
        let (s, t) = (self.knots_s.basis(anchor.x), self.knots_t.basis(anchor.y));
        let (value, value_s) = (products(&s.value, &t.value), products(&s.slope, &t.value));
        let image = self.sum(&s, &t, &value);
        let direction = self.sum(&s, &t, &value_s);
        let mut sum = CellSum::default();
        sum.add(&value.map(|n| [n, 0.0]), anchor.x - image.x, PIN_WEIGHT);
        sum.add(&value.map(|n| [0.0, n]), anchor.y - image.y, PIN_WEIGHT);
        sum.add(&value_s.map(|n| [0.0, n]), -direction.y, PIN_WEIGHT);
        equations.add_cell(s.first, t.first, &sum);
    }
}

/// The directions at 0°, 45°, 90° and 135°.
const ALL_ROUND: [Vector2<f64>; 4] = {
    const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [
        Vector2::new(1.0, 0.0),
        Vector2::new(DIAGONAL, DIAGONAL),
        Vector2::new(0.0, 1.0),
        Vector2::new(-DIAGONAL, DIAGONAL),
    ]
};

impl Local {
    /// Length on the surface for each length along a unit direction of the drawing.
    fn stretch(&self, direction: &Vector2<f64>) -> f64 {
        let image = self.by_s * direction.x + self.by_t * direction.y;
        image.norm().hypot(self.jet.gradient.dot(&image))
    }

    /// Area on the surface for each area of the drawing.
    fn area(&self) -> f64 {
        (1.0 + self.jet.gradient.norm_squared()).sqrt() * self.by_s.perp(&self.by_t)
    }

    fn observe_stretch(&self, direction: &Vector2<f64>, weight: f64, sum: &mut CellSum<2>) {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let image = self.by_s * direction.x + self.by_t * direction.y;
        let climb = gradient.dot(&image);
        let stretch = image.norm().hypot(climb);
        let by_image = (image + gradient * climb) / stretch;
        let by_place = hessian * image * (climb / stretch);
        let row: CellRow<2> = std::array::from_fn(|local| {
            let along = self.value_s[local] * direction.x + self.value_t[local] * direction.y;
            (by_image * along + by_place * self.value[local]).into()
        });
        sum.add(&row, 1.0 - stretch, weight);
    }

    fn observe_area(&self, weight: f64, sum: &mut CellSum<2>) {
        let SurfaceJet { gradient, hessian, .. } = &self.jet;
        let lift = (1.0 + gradient.norm_squared()).sqrt();
        let flat_area = self.by_s.perp(&self.by_t);
        let by_place = hessian * gradient * (flat_area / lift);
        let row: CellRow<2> = std::array::from_fn(|local| {
            let (n, n_s, n_t) = (self.value[local], self.value_s[local], self.value_t[local]);
            let by_x = lift * (n_s * self.by_t.y - n_t * self.by_s.y) + by_place.x * n;
            let by_y = lift * (n_t * self.by_s.x - n_s * self.by_t.x) + by_place.y * n;
            [by_x, by_y]
        });
        sum.add(&row, 1.0 - lift * flat_area, weight);
    }
}

/// The linear map from the drawing to the view that is isometric onto a tangent plane of this slope and keeps the x
/// direction.
pub(super) fn tangent_frame(gradient: &Vector2<f64>) -> Matrix2<f64> {
    let right = 1.0 / (1.0 + gradient.x * gradient.x).sqrt();
    let lift = (1.0 + gradient.norm_squared()).sqrt();
    // The unit vector of the tangent plane at right angles to (right, 0), by the metric of the plane.
    let up = 1.0 / (right * lift);
    let across = -gradient.x * gradient.y / (1.0 + gradient.x * gradient.x) * up;
    Matrix2::new(right, across, 0.0, up)
}

fn grid_over(extents: &Extents, options: &IsometricOptions) -> (UniformKnots, UniformKnots) {
    let longest = extents.size().max();
    // A drawing that is a single line or dot gets a band round it.
    let size = extents.size().map(|side| side.max(longest * 0.05).max(options.cell));
    let cell = options.cell.max((size.x * size.y / options.most_cells as f64).sqrt());
    let along = |center: f64, length: f64| {
        let spans = (length / cell).round().max(2.0);
        UniformKnots::new(center - length / 2.0, length / spans, spans as usize)
    };
    (along(extents.center().x, size.x), along(extents.center().y, size.y))
}

fn products(s: &[f64; 4], t: &[f64; 4]) -> [f64; 16] {
    std::array::from_fn(|local| s[local % 4] * t[local / 4])
}
