//! Recognises that the points of a scan are on one cylinder or cone, as far as their noise allows.
//!
//! If they are, their distances from the best form are white noise. Then the mean of the points in a square
//! of the view differs from zero by no more than the scatter of that number of points explains, whether the
//! square is a few points wide or as wide as the part. Sums of the squares of such means have the χ²
//! distribution (Pearson, On the criterion that a given system of deviations …, Philosophical Magazine 1900).
//! An oval, conical, barrel-shaped, bent or wavy part fails in squares of the size of its deviation, and
//! scanner waves fail in squares of their size. A deviation that is too small to fail is within the doubt
//! that [`Recognised`] states.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::cells::Cells;
use super::penalised::Smoothed;
use super::visible::Region;
use crate::geometry::cone::Cone;
use crate::geometry::cylinder::Cylinder;
use crate::geometry::shape_fit::{ONE_WAY, fitted, principal_directions};
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::ViewPoint;

/// Points on a side steeper than this, rad, are not compared. There, points below the surface are hidden more
/// often than points above it, so that their mean is not zero.
const STEEPEST: f64 = 65.0 * PI / 180.0;
/// No form is recognised from fewer points than this.
const FEWEST: usize = 1000;
/// The first steps of a fit use at most this many points; they need no more.
const FEW: usize = 4000;
/// Number of steps of a fit to a few points ([`FEW`]), and to all points.
const STEPS: [usize; 2] = [30, 4];
/// Normals that turn by less than this, rad, do not define an axis.
const LEAST_TURN: f64 = 0.05;
/// Normals of a cone that leave a straight line by less than this, rad, do not define its axis.
const LEAST_BEND: f64 = LEAST_TURN * FRAC_1_SQRT_2 * 0.1;
/// Cones that are slimmer or flatter than this, rad, are not distinguished from cylinders and planes.
const LEAST_ANGLE: f64 = 0.5 * PI / 180.0;
/// Squares that are at most this many cells wide share one scatter of their points.
const ZONE: usize = 8;
/// A scatter is known from at least this many values.
const LEAST_FREEDOM: f64 = 30.0;
/// At least this many squares of one size are compared: the parameters of the fit explain fewer.
const FEWEST_SQUARES: usize = 16;
/// A square has at least this many points.
const IN_SQUARE: usize = 4;
/// By chance, a sum of squares may be above its mean by at most this many of its standard deviations.
const BY_CHANCE: f64 = 4.5;
/// By chance, one mean among many may differ from zero by at most this many of its standard deviations.
const ONE_BY_CHANCE: f64 = 5.5;
/// A form may be off by at most this many times the standard deviation of its parameters.
const OFF: f64 = 2.5;
/// A form is used if the slope error that the noise may hide is at most this many times that of a smoothed
/// surface, because a smoothed surface follows long waves.
const MOST_HIDDEN: f64 = 3.0;
/// A hidden deviation adds at most this many standard deviations to the sum of squares.
const HIDDEN: f64 = 2.0;
/// Amplitude of a wave whose mean over the half of its length is 1.
const OF_MEAN: f64 = PI / 2.0;

/// A cylinder or cone on which all points of a surface are, but for their noise.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ScanForm {
    /// The form, in the frame of the view.
    pub form: RoundForm,
    /// By how much the radius of a cylinder, mm, or the angle between axis and side of a cone, rad, may be off because the points
    /// scatter: two and a half standard deviations.
    pub size_off: f64,
}

/// A recognised form, with what is not known of it.
pub(super) struct Recognised {
    form: Form,
    /// Forms that differ from it by what its parameters may be off.
    others: Vec<Form>,
    /// By how much its slope may differ from that of the part, rad, because a deviation is hidden in the noise.
    hidden_slope: f64,
}

#[derive(Debug, Clone, Copy)]
enum Form {
    Cylinder(Cylinder),
    Cone(Cone),
}

impl Form {
    fn distance(&self, point: &Point3<f64>) -> f64 {
        match self {
            Self::Cylinder(cylinder) => cylinder.distance(point),
            Self::Cone(cone) => cone.distance(point),
        }
    }

    fn outward(&self, point: &Point3<f64>) -> Vector3<f64> {
        match self {
            Self::Cylinder(cylinder) => cylinder.outward(point),
            Self::Cone(cone) => cone.outward(point),
        }
    }

    /// Its point on the line of sight through `at` that is nearest to a height, mm.
    fn on_sight(&self, at: ViewPoint, height: f64) -> Option<Point3<f64>> {
        match self {
            Self::Cylinder(cylinder) => {
                let [lower, upper] = cylinder.heights(at)?;
                let z = if (lower - height).abs() < (upper - height).abs() { lower } else { upper };
                Some(Point3::new(at.x, at.y, z))
            }
            Self::Cone(cone) => cone.on_sight(at, height),
        }
    }

    fn known(&self) -> RoundForm {
        match *self {
            Self::Cylinder(Cylinder { center, axis, radius }) => RoundForm::Cylinder { center, axis, radius },
            Self::Cone(Cone { apex, axis, half_angle }) => RoundForm::Cone { apex, axis, half_angle },
        }
    }
}

impl Recognised {
    /// The cylinder, or else the cone, that all used points of a surface are on. `None` if there is none, if
    /// they define it worse than the `slope` of the smoothed surface is known, rad, or if their noise may
    /// hide much more than that.
    pub(super) fn of(region: &Region, smoothed: &Smoothed, cells: &Cells, slope: f64) -> Option<Self> {
        let normal = |point: &Point3<f64>| {
            let gradient = smoothed.nurbs.gradient(ViewPoint::new(point.x, point.y));
            Vector3::new(-gradient.x, -gradient.y, 1.0).normalize()
        };
        let all = region.points.iter().zip(&region.cells).zip(&smoothed.is_used);
        let used = all.filter(|(_, is_used)| **is_used).map(|((point, cell), _)| (*point, *cell));
        let (points, places): (Vec<Point3<f64>>, Vec<usize>) =
            used.filter(|(point, _)| normal(point).z > STEEPEST.cos()).unzip();
        if points.len() < FEWEST || points.len() * 2 < smoothed.used {
            return None;
        }
        let few: Vec<Point3<f64>> = points.iter().step_by(points.len().div_ceil(FEW)).copied().collect();
        let normals: Vec<Vector3<f64>> = few.iter().map(normal).collect();
        let reach = smoothed.wavelength / 2.0;
        let judged = |form: Form, off: Vec<Form>| {
            let found = Self { form, others: off, hidden_slope: 0.0 };
            let off = few.iter().filter_map(|point| found.at(ViewPoint::new(point.x, point.y), point.z));
            let off: Vec<f64> = off.map(|(_, off)| off).collect();
            if off.is_empty() || off.iter().sum::<f64>() > slope * off.len() as f64 {
                return None;
            }
            let hidden_slope = hidden_slope(&form, &points, &places, cells, reach)?;
            (hidden_slope <= MOST_HIDDEN * slope).then_some(Self { hidden_slope, ..found })
        };
        let cylinder = first_cylinder(&few, &normals).map(|first| {
            let few = fitted(STEPS[0], &few, first, Cylinder::distances_and_derivatives, Cylinder::moved);
            fitted(STEPS[1], &points, few, Cylinder::distances_and_derivatives, Cylinder::moved)
        });
        let of_cylinder = cylinder.filter(|found| found.radius.is_finite()).and_then(|found| {
            let steps = possible_steps(&points, found.distances_and_derivatives())?;
            judged(
                Form::Cylinder(found),
                steps.iter().map(|step| Form::Cylinder(found.moved(step))).collect(),
            )
        });
        of_cylinder.or_else(|| {
            let first = first_cone(&few, &normals)?;
            let few = fitted(STEPS[0], &few, first, Cone::distances_and_derivatives, Cone::moved);
            let found = fitted(STEPS[1], &points, few, Cone::distances_and_derivatives, Cone::moved);
            let is_cone = (LEAST_ANGLE..=PI / 2.0 - LEAST_ANGLE).contains(&found.half_angle);
            let steps = is_cone.then(|| possible_steps(&points, found.distances_and_derivatives()))??;
            judged(Form::Cone(found), steps.iter().map(|step| Form::Cone(found.moved(step))).collect())
        })
    }

    /// The form, in the frame of the view.
    pub(super) fn known(&self) -> ScanForm {
        let size = |form: &Form| match form {
            Form::Cylinder(cylinder) => cylinder.radius,
            Form::Cone(cone) => cone.half_angle,
        };
        let off = self.others.iter().map(|other| (size(other) - size(&self.form)).powi(2));
        ScanForm { form: self.form.known(), size_off: off.sum::<f64>().sqrt() }
    }

    /// Its height on a line of sight, mm, next to that of the smoothed surface, and by how much its slope may be off there, rad.
    pub(super) fn at(&self, at: ViewPoint, near: f64) -> Option<(f64, f64)> {
        let point = self.form.on_sight(at, near)?;
        let normal = self.form.outward(&point);
        let off = self.others.iter().filter_map(|other| {
            let point = other.on_sight(at, point.z)?;
            Some(other.outward(&point).angle(&normal).powi(2))
        });
        let off = off.sum::<f64>() + self.hidden_slope.powi(2);
        Some((point.z, off.sqrt()))
    }
}

/// The steps of the parameters of a fit that the scatter of its points leaves open, one along each of their independent directions;
/// `None` if the points do not define them.
fn possible_steps<const PARAMETERS: usize>(
    points: &[Point3<f64>],
    distance_of: impl Fn(&Point3<f64>) -> (f64, [f64; PARAMETERS]),
) -> Option<[[f64; PARAMETERS]; PARAMETERS]> {
    let mut matrix = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    let mut squares = 0.0;
    for point in points {
        let (distance, derivatives) = distance_of(point);
        let derivatives = SVector::from(derivatives);
        matrix += derivatives * derivatives.transpose();
        squares += distance * distance;
    }
    let variance = squares / points.len().saturating_sub(PARAMETERS).max(1) as f64;
    // The columns of a root of the covariance.
    let root = (matrix.try_inverse()? * variance).cholesky()?.l();
    let steps = std::array::from_fn(|column| std::array::from_fn(|row| OFF * root[(row, column)]));
    root.iter().all(|value| value.is_finite()).then_some(steps)
}

/// A cylinder whose axis is perpendicular to all normals, and on which the points are as their normals say.
fn first_cylinder(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<Cylinder> {
    let spread: Matrix3<f64> = normals.iter().map(|normal| normal * normal.transpose()).sum();
    let (axis, [thin, turn, _]) = principal_directions(&(spread / normals.len() as f64));
    if turn < LEAST_TURN || thin > turn / ONE_WAY {
        return None;
    }
    Some(Cylinder::from_normals(axis, points, normals))
}

/// A cone whose axis is the middle of the circle of all normals, and whose apex is on all tangent planes.
fn first_cone(points: &[Point3<f64>], normals: &[Vector3<f64>]) -> Option<Cone> {
    let count = normals.len() as f64;
    let mean = normals.iter().sum::<Vector3<f64>>() / count;
    let off = normals.iter().map(|normal| normal - mean);
    let spread: Matrix3<f64> = off.map(|off| off * off.transpose()).sum();
    let (axis, [thin, bend, _]) = principal_directions(&(spread / count));
    if bend < LEAST_BEND || thin > bend / ONE_WAY {
        return None;
    }
    let center = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count;
    let planes = points.iter().copied().zip(normals.iter().copied());
    Cone::from_tangent_planes(axis, &mean, planes, &center.into())
}

/// Sums over the points of a square.
#[derive(Debug, Clone, Copy, Default)]
struct Square {
    count: f64,
    sum: f64,
    squares: f64,
    /// Of the cells in it: their number, and the sum of the squares of their sums by their numbers of points.
    cells: f64,
    of_cells: f64,
}

/// The largest slope, rad, of a deviation from a form that is hidden in the scatter of the points, among those whose half length is about
/// `reach`, mm, or more; `None` if the distances of the points from it are not noise, or if none of these waves can be seen.
fn hidden_slope(
    form: &Form,
    points: &[Point3<f64>],
    places: &[usize],
    cells: &Cells,
    reach: f64,
) -> Option<f64> {
    let [columns, rows] = cells.size();
    let mut narrow = vec![Square::default(); columns * rows];
    for (point, place) in points.iter().zip(places) {
        let distance = form.distance(point);
        let square = &mut narrow[*place];
        square.count += 1.0;
        square.sum += distance;
        square.squares += distance * distance;
    }
    for square in narrow.iter_mut().filter(|square| square.count > 0.0) {
        (square.cells, square.of_cells) = (1.0, square.sum * square.sum / square.count);
    }
    let zones = wider(&narrow, [columns, rows], ZONE);
    let zone_columns = columns.div_ceil(ZONE);
    let overall = scatter(&sum_of(&zones))?;
    // With few points, the scatter in a zone is not known better than that of all.
    let variance = |column: usize, row: usize| {
        let zone = zones[row * zone_columns + column];
        let freedom = zone.count - zone.cells;
        // The mean of the inverse of a variance from this number of values is larger than the inverse of the
        // variance.
        scatter(&zone).map_or(overall, |variance| variance * freedom / (freedom - 2.0))
    };
    let mut largest = 0.0f64;
    let mut width = 1;
    loop {
        let squares = wider(&narrow, [columns, rows], width);
        let across = columns.div_ceil(width);
        let (mut sum, mut number, mut off, mut count) = (0.0, 0usize, 0.0f64, 0.0);
        for (index, square) in
            squares.iter().enumerate().filter(|(_, square)| square.count >= IN_SQUARE as f64)
        {
            let [column, row] = [index % across, index / across].map(|at| (at * width + width / 2) / ZONE);
            let variance = variance(column.min(zone_columns - 1), row.min(rows.div_ceil(ZONE) - 1));
            let score = square.sum * square.sum / (square.count * variance);
            sum += score;
            number += 1;
            count += square.count;
            off = off.max(score);
        }
        if number < FEWEST_SQUARES {
            return (largest > 0.0).then_some(largest);
        }
        let mean = number as f64;
        let by_chance = BY_CHANCE * (2.0 * mean).sqrt();
        if sum > mean + by_chance || off > ONE_BY_CHANCE * ONE_BY_CHANCE {
            return None;
        }
        let length = width as f64 * cells.side();
        // A wave whose half length is between this width and twice that is seen best in these squares.
        if 2.0 * length > reach {
            // The part of the sum that chance does not explain, plus the part that chance may hide.
            let hidden = HIDDEN * (2.0 * mean).sqrt();
            let left = ((sum - mean).max(0.0) + hidden) * overall / count;
            largest = largest.max(OF_MEAN * left.sqrt() * PI / length);
        }
        width *= 2;
    }
}

/// The variance of points within cells, mm².
fn scatter(square: &Square) -> Option<f64> {
    let freedom = square.count - square.cells;
    let variance = (square.squares - square.of_cells) / freedom;
    (freedom >= LEAST_FREEDOM && variance > 0.0).then_some(variance)
}

/// The sums of all squares.
fn sum_of(squares: &[Square]) -> Square {
    squares.iter().fold(Square::default(), |mut sum, square| {
        sum.add(square);
        sum
    })
}

impl Square {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.cells += other.cells;
        self.of_cells += other.of_cells;
    }
}

/// Squares that are `width` cells wide.
fn wider(narrow: &[Square], [columns, rows]: [usize; 2], width: usize) -> Vec<Square> {
    let across = columns.div_ceil(width);
    let mut squares = vec![Square::default(); across * rows.div_ceil(width)];
    for (index, square) in narrow.iter().enumerate() {
        squares[index / columns / width * across + index % columns / width].add(square);
    }
    squares
}
