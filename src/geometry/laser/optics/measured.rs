//! A lens that is known by measurements: polynomials through the points that beams were seen to hit.

use nalgebra::{DMatrix, DVector, Matrix2, Point3, Vector2};

use super::beam::{Beam, STEEPEST_BEAM};
use super::least_squares::{self, Solution};
use crate::geometry::space::{Extents, FieldPoint};

/// Highest degree of the polynomials.
const MOST_DEGREE: usize = 5;
/// The number of terms x^i·y^j with i + j up to that degree.
const TERMS: usize = terms(MOST_DEGREE);
/// A polynomial of a higher degree must predict a measurement from all others better by this share.
const BETTER: f64 = 0.9;
/// A measurement is a mistake if it differs from the prediction of the others by more than this many of their
/// standard deviations. [`MISTAKE`] must be exceeded, too.
const MISTAKE_RATIO: f64 = 8.0;
/// A measurement is a mistake if it differs from the prediction of the others by more than this, mm.
/// [`MISTAKE_RATIO`] must be exceeded, too.
const MISTAKE: f64 = 0.5;
/// Beams may grow apart by this share for each mm of height, as under a telecentric lens that is not quite parallel; the beams of
/// other lenses come together by more.
const DIVERGENCE: f64 = 7e-4;
/// A difference is significant if it is at least this many standard deviations.
const SURE: f64 = 3.0;
/// Sizes on the calibrated plane are within this share of the sizes drawn, as far as a marking software is calibrated at all.
const SCALES: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Beams are known up to this share of the measured rectangle beyond its sides.
const BEYOND: f64 = 0.1;
/// Largest number of measurements.
pub const MOST_SIGHTINGS: usize = 2000;

const fn terms(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// A beam that was aimed at a point of the field, and where it was seen to hit at a height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The point of the drawing.
    pub aim: FieldPoint,
    /// The height in the laser's frame, mm.
    pub z: f64,
    /// Where it hit, mm in the laser's frame.
    pub seen: Vector2<f64>,
}

/// A lens whose beams were measured at two or more heights.
///
/// Each beam is straight: it meets z = 0 at (X, Y) + D(X, Y) and moves sideways by S(X, Y) for each mm of height. D and S are
/// polynomials through the measurements. D is what the marking software's own correction leaves; for the two-point model it
/// is zero and S is linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredLens {
    /// The measured rectangle of the field.
    area: Extents,
    /// Lowest and highest measured height, mm.
    heights: [f64; 2],
    height: f64,
    fingerprint: u64,
    fit: MeasuredFit,
    degree: usize,
    offset: [Vector2<f64>; TERMS],
    slope: [Vector2<f64>; TERMS],
}

/// How well the polynomials meet the measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MeasuredFit {
    /// The number of measurements.
    pub count: usize,
    /// The degree of the polynomials.
    pub degree: usize,
    /// Root mean square of the distances, mm.
    pub rms: f64,
    /// The largest distance, mm.
    pub max: f64,
    /// The index of the measurement with this distance.
    pub max_at: usize,
    /// Root mean square of the distances between each measurement and what all others predict, mm. With few measurements, the
    /// polynomials pass through all of them, and only this shows what is not known about the beams between them.
    pub prediction: f64,
    /// The largest of these distances, mm.
    pub max_prediction: f64,
    /// The measurement with this distance.
    pub worst: Sighting,
}

/// Why measurements give no lens.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasuredLensError {
    /// Too few measurements.
    #[error("the table has {count} complete rows, and {needed} are needed")]
    TooFew {
        /// Their number.
        count: usize,
        /// The smallest number that is enough.
        needed: usize,
    },
    /// All measurements have the same height.
    #[error("all rows have the height {z} mm")]
    OneHeight {
        /// The height, mm.
        z: f64,
    },
    /// The places do not span an area.
    #[error("the places of the field are on one line")]
    OnLine,
    /// The columns of x and y are interchanged.
    #[error("x and y seem swapped")]
    Swapped,
    /// A column has the wrong sign.
    #[error("the sign of {axis} seems wrong")]
    WrongSign {
        /// `x` or `y`.
        axis: char,
    },
    /// One measurement contradicts the others.
    #[error("row {index} contradicts the others by {difference:.2} mm in {axis}")]
    Mistake {
        /// Its index.
        index: usize,
        /// `x` or `y`.
        axis: char,
        /// Measured minus what the others predict, mm.
        difference: f64,
        /// What the others predict, mm.
        predicted: f64,
    },
    /// Sizes on the calibrated plane are far from those that were drawn.
    #[error("on the calibrated plane, marks are seen {scale:.4} times as long as drawn")]
    Scale {
        /// Size marked divided by size drawn.
        scale: f64,
    },
    /// The beams grow apart towards the lens.
    #[error("the beams grow apart towards the lens: marks become larger by {:.2} % in {axis} for each mm of height", growth * 100.0)]
    Diverging {
        /// `x` or `y`.
        axis: char,
        /// Growth for each mm of height.
        growth: f64,
    },
    /// A beam is tilted farther than a scan head deflects it.
    #[error("a beam would be tilted by {degrees:.0} deg, which no scan head reaches")]
    Steep {
        /// Its tilt, deg.
        degrees: f64,
    },
    /// The beams cross within the measured heights.
    #[error("the beams cross at a height of {height:.1} mm")]
    Crossing {
        /// The height, mm.
        height: f64,
    },
}

impl MeasuredLens {
    /// The lens with these measurements, of the degree that predicts each of them best from all others.
    ///
    /// # Errors
    /// When the measurements do not determine a lens or contradict each other; see [`MeasuredLensError`].
    pub fn fit(rows: &[Sighting]) -> Result<(Self, MeasuredFit), MeasuredLensError> {
        let needed = 2 * terms(1) + 2;
        if rows.len() < needed {
            return Err(MeasuredLensError::TooFew { count: rows.len(), needed });
        }
        let heights = rows
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], row| [low.min(row.z), high.max(row.z)]);
        if heights[1] - heights[0] < 0.1 {
            return Err(MeasuredLensError::OneHeight { z: heights[0] });
        }
        let area = Extents::of(rows.iter().map(|row| row.aim.coords()));
        check_directions(rows, &area)?;
        check_growth(rows, &area)?;
        let candidates = (1..=MOST_DEGREE).filter_map(|degree| Candidate::new(rows, &area, degree));
        let best = candidates
            .reduce(|best, next| if next.prediction < BETTER * best.prediction { next } else { best });
        let best = best.ok_or(MeasuredLensError::OnLine)?;
        best.check_mistakes(rows)?;
        let fit = best.fit(rows);
        let mut lens = Self {
            area,
            heights,
            height: f64::INFINITY,
            fingerprint: fingerprint(rows),
            fit,
            degree: best.degree,
            offset: [Vector2::zeros(); TERMS],
            slope: [Vector2::zeros(); TERMS],
        };
        let [x, y] = &best.solutions;
        for term in 0..terms(best.degree) {
            let of = |index: usize| Vector2::new(x.unknowns[index], y.unknowns[index]);
            (lens.offset[term], lens.slope[term]) = (of(term), of(terms(best.degree) + term));
        }
        lens.height = lens.crossing();
        if lens.height <= heights[1] {
            return Err(MeasuredLensError::Crossing { height: lens.height });
        }
        let steepest = rows.iter().map(|row| lens.beam(row.aim).slope.norm()).fold(0.0, f64::max).atan();
        if steepest > STEEPEST_BEAM {
            return Err(MeasuredLensError::Steep { degrees: steepest.to_degrees() });
        }
        Ok((lens, fit))
    }

    /// How well the beams meet the measurements.
    pub fn residuals(&self) -> MeasuredFit {
        self.fit
    }

    /// The measured rectangle of the field, mm.
    pub fn area(&self) -> Extents {
        self.area
    }

    /// Lowest and highest measured height, mm.
    pub fn heights(&self) -> [f64; 2] {
        self.heights
    }

    /// Lowest height above the calibrated plane at which beams cross, mm.
    pub fn height(&self) -> f64 {
        self.height
    }

    /// A number for these measurements: the same for the same ones, and another for others.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The rectangle of the field in which beams are known, mm.
    pub fn known_area(&self) -> Extents {
        self.area.scaled(1.0 + 2.0 * BEYOND)
    }

    /// The beam of a point of the drawing; outside [`known_area`](Self::known_area) it is extrapolated.
    pub fn beam(&self, aim: FieldPoint) -> Beam {
        let (mut foot, mut slope) = (aim.coords(), Vector2::zeros());
        let powers = powers(scaled(aim, &self.area), self.degree);
        for (term, power) in powers.iter().enumerate() {
            foot += self.offset[term] * *power;
            slope += self.slope[term] * *power;
        }
        Beam { foot, slope }
    }

    /// The point of the drawing whose beam meets a point of the laser's frame, by Newton's method; `None` at or above
    /// [`height`](Self::height), and far outside the measured area.
    pub fn aim(&self, at: Point3<f64>) -> Option<FieldPoint> {
        if !(at.z < self.height) {
            return None;
        }
        let reach = self.area.scaled(2.0);
        let mut aim = FieldPoint::from(at.xy().coords);
        for _ in 0..50 {
            let miss = at.xy().coords - self.beam(aim).at(at.z).xy().coords;
            let step = self.jacobian(aim, at.z).try_inverse()? * miss;
            aim = aim + step;
            if !aim.is_finite() {
                return None;
            }
            if step.norm() < 1e-12 * (1.0 + aim.coords().norm()) {
                return Some(aim).filter(|aim| reach.contains(aim.coords()));
            }
        }
        // The last digits may flicker.
        let miss = (at.xy().coords - self.beam(aim).at(at.z).xy().coords).norm();
        Some(aim).filter(|aim| miss < 1e-9 && reach.contains(aim.coords()))
    }

    /// How the point hit at height `z` moves with the aim.
    fn jacobian(&self, aim: FieldPoint, z: f64) -> Matrix2<f64> {
        let [offset, slope] = self.derivatives(aim);
        Matrix2::identity() + offset + slope * z
    }

    /// The derivatives of D and S by the aim.
    fn derivatives(&self, aim: FieldPoint) -> [Matrix2<f64>; 2] {
        let half = self.area.size() / 2.0;
        let at = scaled(aim, &self.area);
        let mut found = [Matrix2::zeros(); 2];
        let powers = powers(at, self.degree);
        for (term, (i, j)) in exponents(self.degree).enumerate() {
            // The term before this one in its row or column has one power less.
            let before = |i: usize, j: usize| powers[terms(i + j) - 1 - i];
            let dx = if i > 0 { i as f64 * before(i - 1, j) / half.x } else { 0.0 };
            let dy = if j > 0 { j as f64 * before(i, j - 1) / half.y } else { 0.0 };
            for (sum, of) in found.iter_mut().zip([self.offset[term], self.slope[term]]) {
                *sum += of * nalgebra::RowVector2::new(dx, dy);
            }
        }
        found
    }

    /// The lowest height above z = 0 at which neighbouring beams of the known area meet.
    fn crossing(&self) -> f64 {
        let known = self.known_area();
        let share = |step: usize| step as f64 / 20.0;
        let places = (0..=20).flat_map(|i| (0..=20).map(move |j| Vector2::new(share(i), share(j))));
        let first = |place: Vector2<f64>| {
            let [offset, slope] =
                self.derivatives(FieldPoint::from(known.min + known.size().component_mul(&place)));
            // det(A + z·S) = det S·z² + (…)·z + det A, which is positive at z = 0.
            let a = Matrix2::identity() + offset;
            let (square, constant) = (slope.determinant(), a.determinant());
            let linear = (a + slope).determinant() - square - constant;
            if constant <= 0.0 {
                return 0.0;
            }
            let root = linear * linear - 4.0 * square * constant;
            if root < 0.0 {
                return f64::INFINITY;
            }
            // The form that stays exact for a small square.
            let sum = -linear - root.sqrt().copysign(linear);
            let roots = [2.0 * constant / sum, sum / (2.0 * square)];
            roots.into_iter().filter(|z| z.is_finite() && *z > 0.0).fold(f64::INFINITY, f64::min)
        };
        places.map(first).fold(f64::INFINITY, f64::min)
    }
}

/// The fit of one degree.
struct Candidate {
    degree: usize,
    solutions: [Solution; 2],
    /// Root mean square of the differences between each measurement and the prediction of all others, mm.
    prediction: f64,
}

impl Candidate {
    /// `None` if the measurements do not determine this degree.
    fn new(rows: &[Sighting], area: &Extents, degree: usize) -> Option<Self> {
        let count = terms(degree);
        // A few rows more than unknowns, so that there is something to predict.
        if rows.len() < 2 * count + 2 {
            return None;
        }
        let mut matrix = DMatrix::zeros(rows.len(), 2 * count);
        for (index, row) in rows.iter().enumerate() {
            for (term, power) in powers(scaled(row.aim, area), degree).into_iter().enumerate() {
                (matrix[(index, term)], matrix[(index, count + term)]) = (power, row.z * power);
            }
        }
        let solve = |axis: usize| {
            let beside = rows.iter().map(|row| row.seen[axis] - row.aim.coords()[axis]);
            least_squares::linear(&matrix, &DVector::from_iterator(rows.len(), beside))
        };
        let solutions = [solve(0)?, solve(1)?];
        let of = |solution: &Solution| {
            let differences = (0..rows.len()).map(|row| solution.difference_from_others(row));
            differences.map(|difference| difference.map_or(f64::INFINITY, |value| value * value)).sum::<f64>()
        };
        let sum = of(&solutions[0]) + of(&solutions[1]);
        let prediction = (sum / rows.len() as f64).sqrt() + 1e-9;
        prediction.is_finite().then_some(Self { degree, solutions, prediction })
    }

    fn fit(&self, rows: &[Sighting]) -> MeasuredFit {
        let [x, y] = &self.solutions;
        let residual = |row: usize| x.residuals[row].hypot(y.residuals[row]);
        let difference = |row: usize| {
            let of = |solution: &Solution| solution.difference_from_others(row).unwrap_or(f64::INFINITY);
            of(x).hypot(of(y))
        };
        let greatest = |of: &dyn Fn(usize) -> f64| {
            (0..rows.len()).max_by(|one, other| of(*one).total_cmp(&of(*other))).unwrap_or(0)
        };
        let (max_at, worst) = (greatest(&residual), greatest(&difference));
        let squares: f64 = (0..rows.len()).map(|row| residual(row).powi(2)).sum();
        MeasuredFit {
            count: rows.len(),
            degree: self.degree,
            rms: (squares / rows.len() as f64).sqrt(),
            max: residual(max_at),
            max_at,
            prediction: self.prediction,
            max_prediction: difference(worst),
            worst: rows[worst],
        }
    }

    fn check_mistakes(&self, rows: &[Sighting]) -> Result<(), MeasuredLensError> {
        for (axis, solution) in self.solutions.iter().enumerate() {
            let Some(odd) = solution.most_contradicting() else { continue };
            if odd.ratio > MISTAKE_RATIO && odd.difference.abs() > MISTAKE {
                return Err(MeasuredLensError::Mistake {
                    index: odd.index,
                    axis: ['x', 'y'][axis],
                    difference: odd.difference,
                    predicted: rows[odd.index].seen[axis] - odd.difference,
                });
            }
        }
        Ok(())
    }
}

/// Checks that the points seen follow the aims: neither interchanged nor mirrored.
fn check_directions(rows: &[Sighting], area: &Extents) -> Result<(), MeasuredLensError> {
    let matrix = DMatrix::from_fn(rows.len(), 3, |row, column| match column {
        0 => 1.0,
        column => rows[row].aim.coords()[column - 1] - area.center()[column - 1],
    });
    let along = |axis: usize| {
        let seen = DVector::from_iterator(rows.len(), rows.iter().map(|row| row.seen[axis]));
        least_squares::linear(&matrix, &seen).map(|found| [found.unknowns[1], found.unknowns[2]])
    };
    let (Some(x), Some(y)) = (along(0), along(1)) else { return Err(MeasuredLensError::OnLine) };
    if x[1].abs() > x[0].abs() && y[0].abs() > y[1].abs() {
        return Err(MeasuredLensError::Swapped);
    }
    match [x[0] < 0.0, y[1] < 0.0] {
        [true, _] => Err(MeasuredLensError::WrongSign { axis: 'x' }),
        [_, true] => Err(MeasuredLensError::WrongSign { axis: 'y' }),
        _ => Ok(()),
    }
}

/// Checks that sizes are about right on the calibrated plane and do not grow towards the lens. Both show as the linear part of the
/// points seen, whatever the lens.
fn check_growth(rows: &[Sighting], area: &Extents) -> Result<(), MeasuredLensError> {
    let matrix = DMatrix::from_fn(rows.len(), 6, |row, column| {
        let Sighting { aim, z, .. } = rows[row];
        let beside = aim.coords() - area.center();
        [1.0, z, beside.x, beside.y, z * beside.x, z * beside.y][column]
    });
    for axis in 0..2 {
        let seen = DVector::from_iterator(rows.len(), rows.iter().map(|row| row.seen[axis]));
        let Some(found) = least_squares::linear(&matrix, &seen) else { continue };
        let (scale, growth) = (found.unknowns[2 + axis], found.unknowns[4 + axis]);
        if !SCALES.contains(&scale) {
            return Err(MeasuredLensError::Scale { scale });
        }
        let known = found.uncertainty(4 + axis, found.deviation().unwrap_or(0.0));
        if growth > DIVERGENCE && growth > SURE * known {
            return Err(MeasuredLensError::Diverging { axis: ['x', 'y'][axis], growth });
        }
    }
    Ok(())
}

/// A point of the field with the measured rectangle as the square from −1 to 1.
fn scaled(aim: FieldPoint, area: &Extents) -> Vector2<f64> {
    (aim.coords() - area.center()).component_div(&(area.size() / 2.0))
}

/// The exponents of x and y in each term: first by their sum, then by rising power of y.
fn exponents(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..=degree).flat_map(|sum| (0..=sum).map(move |j| (sum - j, j)))
}

fn powers(at: Vector2<f64>, degree: usize) -> Vec<f64> {
    exponents(degree).map(|(i, j)| at.x.powi(i as i32) * at.y.powi(j as i32)).collect()
}

/// The FNV-1a hash of all numbers.
fn fingerprint(rows: &[Sighting]) -> u64 {
    let numbers = rows.iter().flat_map(|row| [row.aim.x, row.aim.y, row.z, row.seen.x, row.seen.y]);
    let bytes = numbers.flat_map(|number| (number + 0.0).to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a lens with distances of 300 and 285 mm shows of 5 × 5 crosses at two heights.
    fn rows() -> Vec<Sighting> {
        let place = |index: u8| f64::from(index) * 25.0 - 50.0;
        let crosses = (0..25).map(|cross| FieldPoint::new(place(cross % 5), place(cross / 5)));
        let seen = |z: f64| {
            crosses.clone().map(move |aim| {
                let seen = Vector2::new(aim.x * (1.0 - z / 300.0), aim.y * (1.0 - z / 285.0));
                Sighting { aim, z, seen }
            })
        };
        seen(0.0).chain(seen(30.0)).collect()
    }

    #[test]
    fn tables_of_beams_that_no_lens_sends_are_refused_with_their_cause() {
        let fit = |change: &dyn Fn(Sighting) -> Sighting| {
            let rows: Vec<Sighting> = rows().into_iter().map(change).collect();
            MeasuredLens::fit(&rows).map(|(lens, _)| lens.heights()).map_err(|error| error.to_string())
        };
        assert_eq!(fit(&|row| row), Ok([0.0, 30.0]));
        let refused = |change: &dyn Fn(Sighting) -> Sighting, words: &str| {
            let error = fit(change).unwrap_err();
            assert!(error.contains(words), "{error}");
        };
        refused(&|row| Sighting { z: -row.z, ..row }, "marks become larger by 0.33 % in x for each mm");
        let exchanged = |row: Sighting| Sighting { aim: row.seen.into(), seen: row.aim.coords(), ..row };
        refused(&exchanged, "marks become larger by");
        refused(&|row| Sighting { seen: row.seen / 25.4, ..row }, "0.0394 times as long as drawn");
        // Typed 3 for 30 mm: the corner at 70 mm would be seen from 30 mm.
        refused(&|row| Sighting { z: row.z / 10.0, ..row }, "tilted by 68 deg");
        // Beams of a telecentric lens may be a little apart.
        let apart = |row: Sighting| Sighting { seen: row.aim.coords() * (1.0 + 4e-4 * row.z), ..row };
        assert!(fit(&apart).is_ok());
    }
}
