//! The step to which a file's numbers are rounded.

use nalgebra::Point3;

/// At most this many positions are looked at; those of larger meshes are sampled evenly.
const SAMPLE: usize = 800;
/// The finest step is 10 to the power of minus this, mm or inches. Finer steps do not show.
const FINEST: i32 = 4;
/// A coordinate is a multiple of a step if it differs from one by at most this share of the step. If
/// [`SINGLE`] allows more, that applies.
const MULTIPLE: f64 = 0.01;
/// A coordinate is a multiple of a step if it differs from one by at most this share of the largest
/// coordinate: numbers of single precision are off by half of that.
const SINGLE: f64 = 1e-7;
/// Standard deviation of numbers that are rounded to multiples of one.
const EVEN: f64 = 0.289;

/// The step to which coordinates are rounded, mm: the largest decimal part of a millimetre or an inch of
/// which all coordinates are multiples. Far from the origin, numbers of single precision may not show whether
/// they are multiples; such a step is accepted. 0 if there is no step above 0.1 µm.
pub(super) fn step(positions: &[Point3<f64>]) -> f64 {
    let stride = positions.len().div_ceil(SAMPLE).max(1);
    let sample = || positions.iter().step_by(stride);
    let largest = sample().map(|at| at.coords.amax()).fold(0.0, f64::max);
    let is_step = |step: f64| {
        let limit = MULTIPLE.max(SINGLE * largest / step);
        sample().flat_map(|at| at.iter()).all(|coordinate| {
            let multiple = coordinate / step;
            (multiple - multiple.round()).abs() < limit
        })
    };
    let steps = (0..=FINEST).flat_map(|digits| [1.0, 25.4].map(|unit| unit / 10f64.powi(digits)));
    steps.filter(|step| is_step(*step)).fold(0.0, f64::max)
}

/// Standard deviation of a rounded coordinate, mm; 0 where coordinates are not rounded.
pub(super) fn deviation(positions: &[Point3<f64>]) -> f64 {
    EVEN * step(positions)
}
