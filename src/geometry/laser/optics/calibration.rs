//! The two lens distances and the axis, from measurements on marked plates.
//!
//! A plate at height z shows the drawing smaller by g = s·(1 − z/L), with L and s for x and y; s is 1 if the
//! marking software's own calibration is true. It is not known where the zero of the drawing is on a plate,
//! or how the plate was turned, so every plate has its own rotation and shift. Distances between crosses do
//! not depend on them. The axis shows only as the shift between plates: it can be found if all of them were
//! held against the same stops.

use nalgebra::{DMatrix, DVector, Rotation2, Vector2};

use super::beam::STEEPEST_BEAM;
use super::least_squares::{self, Solution};
use crate::geometry::space::{Extents, FieldPoint};

/// Plates whose heights differ by less are one plate, mm.
const SAME_HEIGHT: f64 = 0.05;
/// A value contradicts the others if its residual is more than this many of their standard deviations.
/// [`CONTRADICTS`] must be exceeded, too.
const CONTRADICTS_RATIO: f64 = 5.0;
/// A value contradicts the others if its residual is longer than this, mm. [`CONTRADICTS_RATIO`] must be
/// exceeded, too.
const CONTRADICTS: f64 = 0.3;
/// At most one in this number of values is excluded.
const MOST_LEFT_OUT: usize = 8;
/// Values that deviate by more than this many standard deviations of the readings do not measure a lens.
const MOST_DEVIATION: f64 = 10.0;
/// At most this number of values is excluded.
const MOST_MISTAKES: usize = 10;
/// Largest number of readings, and of plates.
const MOST: (usize, usize) = (500, 20);
/// How well plates return to the same stops, mm.
const STOPS: f64 = 0.1;
/// Plates that are turned less against each other may have been held against the same stops, rad.
const SAME_TURN: f64 = 0.005;
/// Lenses that are not telecentric are nearer than this, mm: those of F = 1000 mm are the longest.
const FARTHEST_LENS: f64 = 1000.0;
/// With this number of spare values, their residuals show how well was measured.
const ENOUGH_SPARE: usize = 6;
/// A difference is significant if it is at least this many standard deviations.
const SURE: f64 = 3.0;

/// Where a cross was measured on a plate, in mm from any zero and in any direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossReading {
    /// The cross in the drawing.
    pub aim: FieldPoint,
    /// The height of the plate above the calibrated plane, mm.
    pub z: f64,
    /// Measured x and y; a value that is missing is not used.
    pub measured: [Option<f64>; 2],
}

/// A measured distance between two crosses of a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceReading {
    /// The two crosses in the drawing.
    pub ends: [FieldPoint; 2],
    /// The height of the plate above the calibrated plane, mm.
    pub z: f64,
    /// The distance, mm.
    pub measured: f64,
}

/// What was measured, and how.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LensReadings {
    /// Positions of crosses.
    pub crosses: Vec<CrossReading>,
    /// Distances between crosses.
    pub distances: Vec<DistanceReading>,
    /// Whether all plates were held against the same stops and measured from the same edges.
    pub same_stops: bool,
    /// Whether the lens may be of a kind that two distances do not describe. Then no value is excluded
    /// because it does not fit them.
    pub any_lens: bool,
    /// Standard deviation of one reading, mm; used while too few values show it.
    pub reading: f64,
}

/// A number with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertain {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// Which value was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadingPlace {
    /// x (0) or y (1) of a cross, by its index in [`LensReadings::crosses`].
    Cross(usize, usize),
    /// An index in [`LensReadings::distances`].
    Distance(usize),
}

/// A value that contradicts the others and was left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// Which one.
    pub place: ReadingPlace,
    /// Measured minus what the others predict, mm.
    pub difference: f64,
    /// What the others predict, mm.
    pub predicted: f64,
}

/// A plate as it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PlateFit {
    /// Its height, mm.
    pub z: f64,
    /// By how much the measured axes are turned against the field, rad, from −π to π.
    pub rotation: f64,
}

/// The lens that fits the readings best.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LensCalibration {
    /// 1/L for x and y, 1/mm: 0 for a telecentric lens.
    pub convergence: [Uncertain; 2],
    /// Size marked at z = 0 divided by size drawn, for x and y.
    pub scale: [Uncertain; 2],
    /// Where the axis meets the field, mm; `None` if the readings do not show it, or for a telecentric lens, which needs none.
    pub axis: Option<[Uncertain; 2]>,
    /// How far all beams move sideways for each mm of height, to x and y, under a telecentric lens; `None` if the readings do not
    /// show it. The axis of another lens contains it.
    pub tilt: Option<[Uncertain; 2]>,
    /// The plates whose crosses were measured by position.
    pub plates: Vec<PlateFit>,
    /// For each reading of a cross, measured minus fitted in the directions of the field, mm; NaN where nothing was measured.
    /// Values that were left out are compared with the fit to the others.
    pub residuals: Vec<Vector2<f64>>,
    /// For each distance, measured minus fitted, mm.
    pub distance_residuals: Vec<f64>,
    /// Standard deviation of one reading, mm.
    pub reading: f64,
    /// The number of values beyond those that are needed.
    pub spare: usize,
    /// The values that were left out.
    pub left_out: Vec<LeftOut>,
}

/// Why readings give no lens.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// No reading has a measured value.
    #[error("nothing is measured")]
    NothingMeasured,
    /// All plates have the same height.
    #[error("all measurements are at one height")]
    OneHeight,
    /// The readings do not determine all unknowns.
    #[error("{count} measured values do not determine the lens")]
    NotDetermined {
        /// Their number.
        count: usize,
    },
    /// More readings or plates than a person measures.
    #[error("there are {readings} readings on {plates} plates, and at most 500 on 20 plates are used")]
    TooMany {
        /// The number of crosses and distances.
        readings: usize,
        /// The number of heights.
        plates: usize,
    },
    /// x and y are interchanged on a plate.
    #[error("x and y seem swapped on the plate at {z} mm")]
    Swapped {
        /// Its height, mm.
        z: f64,
    },
    /// A coordinate has the wrong sign on a plate.
    #[error("the sign of {axis} seems wrong on the plate at {z} mm")]
    WrongSign {
        /// `x` or `y`.
        axis: char,
        /// The plate's height, mm.
        z: f64,
    },
    /// Marks become larger on a raised plate.
    #[error("the marks become larger in {axis} on the higher plate")]
    Diverging {
        /// `x` or `y`.
        axis: char,
        /// Growth for each mm of height.
        growth: f64,
        /// Size marked at z = 0 divided by size drawn.
        scale: f64,
    },
    /// No scan head deflects a beam as far as these lens distances need.
    #[error(
        "the lens distances would be {:.1} and {:.1} mm, and the beam to a corner of the crosses tilted by {degrees:.0} deg, which no \
         scan head reaches", distances[0], distances[1]
    )]
    Steep {
        /// The lens distances for x and y, mm.
        distances: [f64; 2],
        /// The tilt of the beam, deg.
        degrees: f64,
        /// The height of the highest plate, mm.
        z: f64,
        /// Size marked on this plate divided by size drawn.
        size: f64,
    },
    /// A plate was measured above the lens.
    #[error("the plate at {z} mm would be above the lens at {distance:.1} mm")]
    AboveLens {
        /// The plate's height, mm.
        z: f64,
        /// The lens distance, mm.
        distance: f64,
    },
    /// The same stops cannot be used, because positions were measured on fewer than two plates.
    #[error("positions were measured on fewer than two plates ({plates})")]
    StopsOfOnePlate {
        /// The number of plates with positions: 0 or 1.
        plates: usize,
    },
    /// Plates that were held against the same stops are turned against each other.
    #[error("the plates at {} and {} mm are turned against each other by {:.2} deg", z[0], z[1], turn.to_degrees())]
    StopsTurned {
        /// Their heights, mm.
        z: [f64; 2],
        /// The angle, rad.
        turn: f64,
    },
    /// The shifts of plates that were held against the same stops do not fit any lens axis.
    #[error("the shifts of the plates contradict each other by {deviation:.2} mm{}", most_at(*worst))]
    StopsShifted {
        /// Standard deviation of a shift, mm.
        deviation: f64,
        /// The height of the plate that contradicts the others most, mm; `None` for three plates, as each of them then contradicts
        /// the other two as much.
        worst: Option<f64>,
    },
    /// Too many values contradict each other.
    #[error("the measured values contradict each other by {deviation:.2} mm")]
    Contradictory {
        /// Standard deviation of a value, mm.
        deviation: f64,
        /// The value that contradicts the others most.
        worst: LeftOut,
    },
}

fn most_at(worst: Option<f64>) -> String {
    worst.map_or_else(String::new, |z| format!(", most on the plate at {z} mm"))
}

/// Whether a lens with this convergence for x and y is telecentric as far as the readings show.
fn is_telecentric(convergence: &[Uncertain; 2]) -> bool {
    convergence.iter().all(|k| k.value.abs() < SURE * k.deviation)
}

impl LensCalibration {
    /// Whether the lens is telecentric as far as the readings show.
    pub fn is_telecentric(&self) -> bool {
        is_telecentric(&self.convergence)
    }

    /// The distance of the nearest lens that the readings of a telecentric one do not exclude, mm, if such lenses exist.
    pub fn not_excluded(&self) -> Option<f64> {
        let most = self.convergence.map(|k| k.value + SURE * k.deviation);
        let most = most[0].max(most[1]);
        (self.is_telecentric() && most > 1.0 / FARTHEST_LENS).then(|| 1.0 / most)
    }

    /// The lens distances for x and y, mm; `None` for a telecentric lens.
    pub fn distances(&self) -> Option<[Uncertain; 2]> {
        let distance =
            |k: Uncertain| Uncertain { value: 1.0 / k.value, deviation: k.deviation / k.value.powi(2) };
        (!self.is_telecentric() && self.convergence.iter().all(|k| k.value > 0.0))
            .then(|| self.convergence.map(distance))
    }

    /// The fit.
    ///
    /// # Errors
    /// When the readings do not determine the lens or contradict each other.
    pub fn fit(readings: &LensReadings) -> Result<Self, CalibrationError> {
        let problem = Problem::new(readings)?;
        let (mut places, mut left_out) = (problem.places.clone(), Vec::new());
        let most = problem.places.len().div_ceil(MOST_LEFT_OUT).min(MOST_MISTAKES);
        let solution = loop {
            let solution = problem.solve(&places)?;
            let odd = solution.most_contradicting().filter(|_| !readings.any_lens);
            let Some(odd) = odd else { break solution };
            let contradicts = odd.ratio > CONTRADICTS_RATIO && odd.difference.abs() > CONTRADICTS;
            let deviation = solution.deviation().unwrap_or(0.0);
            let is_lost = deviation > MOST_DEVIATION * readings.reading;
            if !contradicts && !is_lost {
                break solution;
            }
            let place = places[odd.index];
            let predicted = problem.measured(place) - odd.difference;
            let worst = LeftOut { place, difference: odd.difference, predicted };
            if !contradicts || left_out.len() == most {
                return Err(CalibrationError::Contradictory { deviation, worst });
            }
            left_out.push(worst);
            places.remove(odd.index);
        };
        problem.calibration(&solution, left_out)
    }
}

/// The readings with the plates that they are on.
struct Problem<'a> {
    readings: &'a LensReadings,
    /// The heights of plates whose crosses were measured by position, in rising order.
    plates: Vec<f64>,
    /// The plate of each cross.
    plate_of: Vec<usize>,
    /// The middle of the crosses, about which plates are turned.
    middle: Vector2<f64>,
    /// All values.
    places: Vec<ReadingPlace>,
    start: Vec<f64>,
    steps: Vec<f64>,
}

/// The unknowns before those of the plates: convergence and scale for x and y.
const LENS: usize = 4;

impl<'a> Problem<'a> {
    fn new(readings: &'a LensReadings) -> Result<Self, CalibrationError> {
        let LensReadings { crosses, distances, .. } = readings;
        let used = |cross: &&CrossReading| cross.measured.iter().any(Option::is_some);
        let used_crosses = || crosses.iter().filter(used);
        let all = used_crosses().map(|cross| cross.z).chain(distances.iter().map(|distance| distance.z));
        if all.clone().next().is_none() {
            return Err(CalibrationError::NothingMeasured);
        }
        let [low, high] =
            all.clone().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [low.min(z), high.max(z)]);
        if !(high - low > SAME_HEIGHT) {
            return Err(CalibrationError::OneHeight);
        }
        let mut plates: Vec<f64> = used_crosses().map(|cross| cross.z).collect();
        plates.sort_by(f64::total_cmp);
        plates.dedup_by(|one, other| (*one - *other).abs() <= SAME_HEIGHT);
        let count = crosses.len() + distances.len();
        if count > MOST.0 || plates.len() > MOST.1 {
            return Err(CalibrationError::TooMany { readings: count, plates: plates.len() });
        }
        let plate_of = crosses
            .iter()
            .map(|cross| plates.iter().position(|z| (z - cross.z).abs() <= SAME_HEIGHT).unwrap_or(0));
        let aims = used_crosses().map(|cross| cross.aim.coords());
        let area = Extents::of(aims);
        let middle = if area.is_empty() { Vector2::zeros() } else { area.center() };
        let mut places = Vec::new();
        for (index, cross) in crosses.iter().enumerate() {
            places.extend(
                (0..2)
                    .filter(|axis| cross.measured[*axis].is_some())
                    .map(|axis| ReadingPlace::Cross(index, axis)),
            );
        }
        places.extend((0..distances.len()).map(ReadingPlace::Distance));
        let mut problem = Self {
            readings,
            plate_of: plate_of.collect(),
            plates,
            middle,
            places,
            start: vec![1e-3, 1e-3, 1.0, 1.0],
            steps: vec![1e-7, 1e-7, 1e-5, 1e-5],
        };
        for plate in 0..problem.plates.len() {
            let start = problem.plate_start(plate)?;
            problem.start.extend(start);
            problem.steps.extend([1e-6, 1e-4, 1e-4]);
        }
        Ok(problem)
    }

    /// The rotation and shift of a plate, roughly.
    fn plate_start(&self, plate: usize) -> Result<[f64; 3], CalibrationError> {
        let crosses = self.readings.crosses.iter().zip(&self.plate_of).filter(|(_, of)| **of == plate);
        let pairs: Vec<(Vector2<f64>, Vector2<f64>)> = crosses
            .filter_map(|(cross, _)| {
                let [Some(x), Some(y)] = cross.measured else { return None };
                Some((cross.aim.coords() - self.middle, Vector2::new(x, y)))
            })
            .collect();
        let matrix = DMatrix::from_fn(pairs.len(), 3, |row, column| match column {
            0 => 1.0,
            column => pairs[row].0[column - 1],
        });
        let along = |axis: usize| {
            let values =
                DVector::from_iterator(pairs.len(), pairs.iter().map(|(_, measured)| measured[axis]));
            least_squares::linear(&matrix, &values).map(|found| found.unknowns)
        };
        let (Some(x), Some(y)) = (along(0), along(1)) else {
            // Too few crosses to see how the plate is turned: about as the field.
            let mean = |of: fn(&CrossReading) -> Option<f64>| {
                let crosses =
                    self.readings.crosses.iter().zip(&self.plate_of).filter(|(_, found)| **found == plate);
                let values: Vec<f64> = crosses.filter_map(|(cross, _)| of(cross)).collect();
                values.iter().sum::<f64>() / values.len().max(1) as f64
            };
            return Ok([0.0, mean(|cross| cross.measured[0]), mean(|cross| cross.measured[1])]);
        };
        let z = self.plates[plate];
        if x[1] * y[2] - x[2] * y[1] < 0.0 {
            return Err(match x[2].abs() + y[1].abs() > x[1].abs() + y[2].abs() {
                true => CalibrationError::Swapped { z },
                false => CalibrationError::WrongSign { axis: if x[1] < 0.0 { 'x' } else { 'y' }, z },
            });
        }
        Ok([(y[1] - x[2]).atan2(x[1] + y[2]), x[0], y[0]])
    }

    fn measured(&self, place: ReadingPlace) -> f64 {
        match place {
            ReadingPlace::Cross(index, axis) => {
                self.readings.crosses[index].measured[axis].unwrap_or(f64::NAN)
            }
            ReadingPlace::Distance(index) => self.readings.distances[index].measured,
        }
    }

    /// Size marked divided by size drawn, at a height.
    fn shrink(unknowns: &[f64], z: f64) -> Vector2<f64> {
        Vector2::new(unknowns[2] * (1.0 - z * unknowns[0]), unknowns[3] * (1.0 - z * unknowns[1]))
    }

    fn predicted(&self, unknowns: &[f64], place: ReadingPlace) -> f64 {
        match place {
            ReadingPlace::Cross(index, axis) => {
                let cross = &self.readings.crosses[index];
                let plate = LENS + 3 * self.plate_of[index];
                let on_plate =
                    (cross.aim.coords() - self.middle).component_mul(&Self::shrink(unknowns, cross.z));
                (Rotation2::new(unknowns[plate]) * on_plate)[axis] + unknowns[plate + 1 + axis]
            }
            ReadingPlace::Distance(index) => {
                let DistanceReading { ends: [from, to], z, .. } = self.readings.distances[index];
                (to - from).component_mul(&Self::shrink(unknowns, z)).norm()
            }
        }
    }

    fn residual(&self, unknowns: &[f64], place: ReadingPlace) -> f64 {
        self.measured(place) - self.predicted(unknowns, place)
    }

    fn solve(&self, places: &[ReadingPlace]) -> Result<Solution, CalibrationError> {
        let residuals =
            |unknowns: &[f64]| Some(places.iter().map(|place| self.residual(unknowns, *place)).collect());
        let count = places.len();
        let solved = least_squares::nonlinear(&self.start, &self.steps, residuals);
        solved.ok_or(CalibrationError::NotDetermined { count })
    }

    fn calibration(
        &self,
        solution: &Solution,
        left_out: Vec<LeftOut>,
    ) -> Result<LensCalibration, CalibrationError> {
        let unknowns = solution.unknowns.as_slice();
        let spare = solution.spare();
        let reading = match solution.deviation() {
            Some(deviation) if spare >= ENOUGH_SPARE => deviation,
            _ => self.readings.reading,
        };
        let known = |index: usize| Uncertain {
            value: unknowns[index],
            deviation: solution.uncertainty(index, reading),
        };
        let convergence = [known(0), known(1)];
        let highest = self.readings.crosses.iter().map(|cross| cross.z);
        let highest = highest.chain(self.readings.distances.iter().map(|distance| distance.z));
        let highest = highest.fold(f64::NEG_INFINITY, f64::max);
        for (axis, k) in ['x', 'y'].into_iter().zip(convergence) {
            if k.value < -SURE * k.deviation.max(1e-7) {
                let scale = unknowns[if axis == 'x' { 2 } else { 3 }];
                return Err(CalibrationError::Diverging { axis, growth: -k.value, scale });
            }
            if k.value * highest >= 1.0 {
                return Err(CalibrationError::AboveLens { z: highest, distance: 1.0 / k.value });
            }
        }
        self.check_steepness(unknowns, highest)?;
        let plates = self.plates.iter().enumerate().map(|(index, z)| {
            let turn = unknowns[LENS + 3 * index];
            PlateFit { z: *z, rotation: turn.sin().atan2(turn.cos()) }
        });
        let residuals = self.readings.crosses.iter().enumerate().map(|(index, _)| {
            let of = |axis| self.residual(unknowns, ReadingPlace::Cross(index, axis));
            let turned = Vector2::new(of(0), of(1));
            // A missing value has no residual; the other one keeps its own.
            let full = turned.map(|value| if value.is_nan() { 0.0 } else { value });
            let back = Rotation2::new(-unknowns[LENS + 3 * self.plate_of[index]]) * full;
            if turned.iter().all(|value| value.is_nan()) { turned } else { back }
        });
        let is_telecentric = is_telecentric(&convergence);
        Ok(LensCalibration {
            convergence,
            scale: [known(2), known(3)],
            axis: match self.readings.same_stops && !is_telecentric {
                true => self.axis(solution, reading)?,
                false => None,
            },
            tilt: match self.readings.same_stops && is_telecentric {
                true => self.tilt(solution, reading),
                false => None,
            },
            plates: plates.collect(),
            residuals: residuals.collect(),
            distance_residuals: (0..self.readings.distances.len())
                .map(|index| self.residual(unknowns, ReadingPlace::Distance(index)))
                .collect(),
            reading,
            spare,
            left_out,
        })
    }

    /// Checks that a scan head can send a beam to all crosses.
    fn check_steepness(&self, unknowns: &[f64], highest: f64) -> Result<(), CalibrationError> {
        let crosses = self.readings.crosses.iter().map(|cross| cross.aim.coords());
        let ends = self.readings.distances.iter().flat_map(|distance| distance.ends.map(FieldPoint::coords));
        let half = Extents::of(crosses.chain(ends)).size() / 2.0;
        let tilt = Vector2::new(half.x * unknowns[0], half.y * unknowns[1]).norm().atan();
        if tilt <= STEEPEST_BEAM {
            return Ok(());
        }
        let size = Self::shrink(unknowns, highest);
        Err(CalibrationError::Steep {
            distances: [1.0 / unknowns[0], 1.0 / unknowns[1]],
            degrees: tilt.to_degrees(),
            z: highest,
            size: (size.x + size.y) / 2.0,
        })
    }

    /// The shifts of the plates under a telecentric lens, whose beams are parallel but may be tilted. `None` unless plates against
    /// the same stops show a tilt.
    fn tilt(&self, solution: &Solution, reading: f64) -> Option<[Uncertain; 2]> {
        let unknowns = solution.unknowns.as_slice();
        let plates = self.plates.len();
        if plates < 2 || self.are_turned_alike(solution, reading).is_err() {
            return None;
        }
        let mut found = [Uncertain { value: 0.0, deviation: 0.0 }; 2];
        for axis in 0..2 {
            let matrix = DMatrix::from_fn(
                plates,
                2,
                |plate, column| if column == 0 { 1.0 } else { self.plates[plate] },
            );
            let shift = |plate: usize| {
                let at = LENS + 3 * plate;
                (Rotation2::new(-unknowns[LENS]) * Vector2::new(unknowns[at + 1], unknowns[at + 2]))[axis]
            };
            let shifts = DVector::from_iterator(plates, (0..plates).map(shift));
            let fitted = least_squares::linear(&matrix, &shifts)?;
            let of_shift = solution.uncertainty(LENS + 1 + axis, reading).hypot(STOPS);
            // Beams shift the drawing evenly with the height. Other shifts have another cause.
            if fitted.deviation().is_some_and(|deviation| deviation > SURE * of_shift) {
                return None;
            }
            found[axis] = Uncertain { value: fitted.unknowns[1], deviation: fitted.uncertainty(1, of_shift) };
        }
        found.iter().any(|tilt| tilt.value.abs() > SURE * tilt.deviation).then_some(found)
    }

    /// The axis: the point of the drawing that all plates show at the same place. The middle of the crosses is at t + a·(1 − g) of
    /// each plate, with the axis at a beside it.
    ///
    /// # Errors
    /// When the plates cannot have been held against the same stops.
    fn axis(&self, solution: &Solution, reading: f64) -> Result<Option<[Uncertain; 2]>, CalibrationError> {
        let unknowns = solution.unknowns.as_slice();
        let plates = self.plates.len();
        if plates < 2 {
            return Err(CalibrationError::StopsOfOnePlate { plates });
        }
        let turn = (0..plates).map(|plate| Rotation2::new(unknowns[LENS + 3 * plate]) * Vector2::x());
        let turn = turn.fold(Vector2::zeros(), |sum, direction| sum + direction);
        self.are_turned_alike(solution, reading)?;
        let back = Rotation2::new(-turn.y.atan2(turn.x));
        let mut found = [Uncertain { value: 0.0, deviation: 0.0 }; 2];
        for axis in 0..2 {
            let matrix = DMatrix::from_fn(plates, 2, |plate, column| match column {
                0 => 1.0,
                _ => 1.0 - Self::shrink(unknowns, self.plates[plate])[axis],
            });
            let shifts = (0..plates).map(|plate| {
                let at = LENS + 3 * plate;
                (back * Vector2::new(unknowns[at + 1], unknowns[at + 2]))[axis]
            });
            let shifts = DVector::from_iterator(plates, shifts);
            let Some(fitted) = least_squares::linear(&matrix, &shifts) else { return Ok(None) };
            let of_shift = solution.uncertainty(LENS + 1 + axis, reading).hypot(STOPS);
            if let Some(deviation) = fitted.deviation().filter(|deviation| *deviation > SURE * of_shift) {
                return Err(CalibrationError::StopsShifted { deviation, worst: self.worst_plate(&fitted) });
            }
            found[axis] = Uncertain {
                value: fitted.unknowns[1] + self.middle[axis],
                deviation: fitted.uncertainty(1, of_shift),
            };
        }
        Ok(Some(found))
    }

    /// The height of the plate whose shift differs most from what the others predict, in its own standard deviations, mm.
    fn worst_plate(&self, shifts: &Solution) -> Option<f64> {
        let difference = |plate: &usize| {
            let free = (1.0 - shifts.leverages[*plate]).max(f64::MIN_POSITIVE);
            shifts.difference_from_others(*plate).map_or(0.0, |difference| difference.abs() * free.sqrt())
        };
        let worst = (0..self.plates.len())
            .max_by(|one, other| difference(one).total_cmp(&difference(other)))
            .filter(|_| shifts.spare() > 1);
        worst.map(|plate| self.plates[plate])
    }

    /// Checks that no plate is turned against the first one.
    fn are_turned_alike(&self, solution: &Solution, reading: f64) -> Result<(), CalibrationError> {
        let angle = |plate: usize| {
            let index = LENS + 3 * plate;
            (solution.unknowns[index], solution.uncertainty(index, reading))
        };
        let (first, of_first) = angle(0);
        for plate in 1..self.plates.len() {
            let (turned, of_this) = angle(plate);
            let turn = (turned - first).sin().atan2((turned - first).cos()).abs();
            if turn > SAME_TURN + SURE * of_first.hypot(of_this) {
                return Err(CalibrationError::StopsTurned { z: [self.plates[0], self.plates[plate]], turn });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::optics::tests::Noise;
    use crate::geometry::optics::{Lens, ScanHead};

    const DISTANCES: [f64; 2] = [300.0, 285.0];

    /// Nine crosses on plates at 0 and 30 mm, each turned and shifted; the axis is at (104, 77).
    fn crosses(noise: &mut Noise, deviation: f64, stops: bool) -> LensReadings {
        let [x, y] = DISTANCES;
        let head = ScanHead { lens: Lens::Perspective { x, y }, axis: FieldPoint::new(104.0, 77.0) };
        let plates = if stops {
            [(0.0, 0.01, 4.0), (30.0, 0.01, 4.0)]
        } else {
            [(0.0, -0.03, 4.0), (30.0, 0.05, -7.0)]
        };
        let mut readings = LensReadings { same_stops: stops, reading: 0.1, ..LensReadings::default() };
        for (z, turn, shift) in plates {
            for (i, j) in (0..9).map(|n| (n % 3, n / 3)) {
                let aim = FieldPoint::new(20.0 + 80.0 * f64::from(i), 16.0 + 64.0 * f64::from(j));
                let on_plate =
                    Rotation2::new(turn) * head.cast(aim, z).coords.xy() + Vector2::new(shift, 2.0 * shift);
                let measured = [on_plate.x, on_plate.y].map(|value| Some(value + deviation * noise.next()));
                readings.crosses.push(CrossReading { aim, z, measured });
            }
        }
        readings
    }

    fn off(found: &LensCalibration) -> f64 {
        let distances = found.distances().unwrap();
        let off = |axis: usize| (distances[axis].value / DISTANCES[axis] - 1.0).abs();
        off(0).max(off(1))
    }

    #[test]
    fn noisy_crosses_on_two_turned_plates_give_both_distances() {
        for seed in 0..200 {
            let readings = crosses(&mut Noise(seed), 0.02, seed % 2 == 0);
            let found = LensCalibration::fit(&readings).unwrap();
            assert!(off(&found) < 0.005, "seed {seed}: {:?}", found.distances());
            assert!(found.left_out.is_empty() && (0.01..0.03).contains(&found.reading), "{found:?}");
            match found.axis {
                None => assert_eq!(seed % 2, 1),
                Some(axis) => {
                    for (found, truth) in axis.iter().zip([104.0, 77.0]) {
                        assert!(
                            (found.value - truth).abs() < 0.5 && found.deviation < 2.0,
                            "seed {seed}: {axis:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_uncertainty_is_that_of_repeated_measurements() {
        let found: Vec<LensCalibration> = (0..300)
            .map(|seed| LensCalibration::fit(&crosses(&mut Noise(seed), 0.02, false)).unwrap())
            .collect();
        for axis in 0..2 {
            let distances = found.iter().map(|found| found.distances().unwrap()[axis]);
            let square: f64 = distances.clone().map(|l| (l.value - DISTANCES[axis]).powi(2)).sum();
            let claimed: f64 = distances.map(|l| l.deviation.powi(2)).sum();
            assert!((0.8..1.25).contains(&(square / claimed)), "{}", square / claimed);
        }
    }

    #[test]
    fn one_mistyped_value_is_named_and_left_out() {
        for seed in 0..36 {
            let mut readings = crosses(&mut Noise(seed as u64), 0.02, seed % 2 == 0);
            let (cross, axis) = (seed / 2, seed % 2);
            let value = readings.crosses[cross].measured[axis].as_mut().unwrap();
            *value += if seed % 3 == 0 { 5.0 } else { -5.0 };
            let truth = *value - if seed % 3 == 0 { 5.0 } else { -5.0 };
            let found = LensCalibration::fit(&readings).unwrap();
            let [left_out] = found.left_out[..] else { panic!("{:?}", found.left_out) };
            assert_eq!(left_out.place, ReadingPlace::Cross(cross, axis));
            assert!((left_out.predicted - truth).abs() < 0.2, "{left_out:?}");
            assert!(off(&found) < 0.006, "{:?}", found.distances());
        }
    }

    fn distances(noise: &mut Noise, deviation: f64) -> LensReadings {
        let crosses = crosses(noise, 0.0, false).crosses;
        let pairs = [(0, 2), (3, 5), (6, 8), (0, 6), (1, 7), (2, 8), (0, 8), (2, 6)];
        let distance = |plate: usize, (i, j): (usize, usize)| {
            let ends = [crosses[9 * plate + i], crosses[9 * plate + j]];
            let [a, b] = ends.map(|cross| Vector2::from(cross.measured.map(Option::unwrap)));
            let measured = (a - b).norm() + deviation * noise.next();
            DistanceReading { ends: ends.map(|cross| cross.aim), z: ends[0].z, measured }
        };
        let distances = (0..2).flat_map(|plate| pairs.map(|pair| (plate, pair)));
        let distances: Vec<_> = distances
            .map({
                let mut distance = distance;
                move |(plate, pair)| distance(plate, pair)
            })
            .collect();
        LensReadings { distances, reading: 0.1, ..LensReadings::default() }
    }

    #[test]
    fn distances_alone_give_both_lens_distances_and_no_axis() {
        for seed in 0..100 {
            let mut readings = distances(&mut Noise(seed), 0.02);
            let found = LensCalibration::fit(&readings).unwrap();
            assert!(off(&found) < 0.01 && found.axis.is_none(), "seed {seed}: {:?}", found.distances());
            let wrong = seed as usize % 16;
            readings.distances[wrong].measured += 5.0;
            let found = LensCalibration::fit(&readings).unwrap();
            let places: Vec<_> = found.left_out.iter().map(|left_out| left_out.place).collect();
            assert_eq!(places, [ReadingPlace::Distance(wrong)], "seed {seed}");
        }
    }

    #[test]
    fn readings_that_cannot_be_a_lens_are_refused_with_their_plate() {
        let swap = |readings: &mut LensReadings| {
            readings.crosses[9..].iter_mut().for_each(|cross| cross.measured.swap(0, 1));
        };
        let mirror = |readings: &mut LensReadings| {
            let y = |cross: &mut CrossReading| cross.measured[1] = cross.measured[1].map(|y| -y);
            readings.crosses[..9].iter_mut().for_each(y);
        };
        let sink =
            |readings: &mut LensReadings| readings.crosses[9..].iter_mut().for_each(|cross| cross.z = -30.0);
        let flat = |readings: &mut LensReadings| readings.crosses.truncate(9);
        let gaps = |readings: &mut LensReadings| {
            readings.crosses[2..].iter_mut().for_each(|cross| cross.measured[0] = None);
        };
        // Typed 3 for 30 mm.
        let low =
            |readings: &mut LensReadings| readings.crosses[9..].iter_mut().for_each(|cross| cross.z = 3.0);
        let inches = |readings: &mut LensReadings| {
            let measured = readings.crosses[9..].iter_mut().flat_map(|cross| &mut cross.measured);
            measured.flatten().for_each(|value| *value /= 25.4);
        };
        let lost = |readings: &mut LensReadings| {
            let wrong = readings.crosses.iter_mut().step_by(2).zip(1..);
            wrong.for_each(|(cross, by)| {
                cross.measured[0] = cross.measured[0].map(|x| x + f64::from(by * by % 7) * 4.0)
            });
        };
        type Spoil = fn(&mut LensReadings);
        let cases: [(Spoil, &str); 8] = [
            (low, "would be 30.0 and 28."),
            (inches, "which no scan head reaches"),
            (swap, "x and y seem swapped on the plate at 30 mm"),
            (mirror, "the sign of y seems wrong on the plate at 0 mm"),
            (sink, "the marks become larger in x on the higher plate"),
            (flat, "all measurements are at one height"),
            (gaps, "do not determine the lens"),
            (lost, "contradict each other"),
        ];
        for (spoil, words) in cases {
            let mut readings = crosses(&mut Noise(1), 0.02, false);
            spoil(&mut readings);
            let error = LensCalibration::fit(&readings).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn plates_that_were_not_held_against_the_same_stops_are_refused() {
        let fit = |readings: &LensReadings| LensCalibration::fit(readings).map(|found| found.axis);
        // Two plates that were turned freely.
        let turned = LensReadings { same_stops: true, ..crosses(&mut Noise(1), 0.02, false) };
        let error = fit(&turned).unwrap_err();
        let CalibrationError::StopsTurned { z: [0.0, 30.0], turn } = error else { panic!("{error}") };
        assert!((turn - 0.08).abs() < 1e-3, "{turn}");
        // Three plates and four, of which one was shifted by 3 mm.
        let head = ScanHead {
            lens: Lens::Perspective { x: DISTANCES[0], y: DISTANCES[1] },
            axis: FieldPoint::new(104.0, 77.0),
        };
        let plate = |z: f64, shift: f64| {
            let place = Vector2::new(4.0 + shift, 8.0);
            crosses(&mut Noise(4), 0.02, true).crosses.into_iter().take(9).map(move |cross| {
                let at = Rotation2::new(0.01) * head.cast(cross.aim, z).coords.xy() + place;
                CrossReading { z, measured: [Some(at.x), Some(at.y)], ..cross }
            })
        };
        let with = |plates: &[(f64, f64)]| {
            let mut readings = crosses(&mut Noise(3), 0.02, true);
            readings.crosses.extend(plates.iter().flat_map(|(z, shift)| plate(*z, *shift)));
            fit(&readings)
        };
        assert!(with(&[(15.0, 0.0)]).unwrap().is_some());
        let error = with(&[(15.0, 3.0)]).unwrap_err();
        assert!(matches!(error, CalibrationError::StopsShifted { worst: None, .. }), "{error}");
        for (plates, z) in [([(10.0, 3.0), (20.0, 0.0)], 10.0), ([(20.0, 0.0), (45.0, -3.0)], 45.0)] {
            let error = with(&plates).unwrap_err();
            assert!(
                matches!(error, CalibrationError::StopsShifted { worst: Some(at), .. } if at == z),
                "{error}"
            );
            assert!(error.to_string().ends_with(&format!(", most on the plate at {z} mm")), "{error}");
        }
        // Positions on one plate, and distances on both.
        let mut one = LensReadings { same_stops: true, ..distances(&mut Noise(2), 0.02) };
        assert_eq!(fit(&one), Err(CalibrationError::StopsOfOnePlate { plates: 0 }));
        one.crosses = crosses(&mut Noise(2), 0.02, true).crosses[..9].to_vec();
        assert_eq!(fit(&one), Err(CalibrationError::StopsOfOnePlate { plates: 1 }));
    }

    #[test]
    fn a_telecentric_lens_needs_no_plates_against_the_same_stops() {
        for (turn, shift) in [(0.0, 0.0), (0.02, 0.0), (0.0, 3.0)] {
            let mut readings = crosses(&mut Noise(5), 0.02, true);
            let mut noise = Noise(6);
            let third = readings.crosses[..9].iter().map(|cross| CrossReading { z: 15.0, ..*cross });
            readings.crosses.extend(third.collect::<Vec<_>>());
            for cross in &mut readings.crosses {
                let moved = if cross.z == 15.0 { 1.0 } else { 0.0 };
                let at = Rotation2::new(turn * moved) * cross.aim.coords() + Vector2::repeat(shift * moved);
                cross.measured = [at.x, at.y].map(|value| Some(value + 0.02 * noise.next()));
            }
            let found = LensCalibration::fit(&readings).unwrap();
            assert!(found.is_telecentric() && found.axis.is_none(), "{turn}, {shift}: {found:?}");
        }
    }

    #[test]
    fn the_tilt_of_parallel_beams_is_found_from_plates_against_the_same_stops() {
        let mut readings = crosses(&mut Noise(5), 0.02, true);
        let mut noise = Noise(7);
        let tilt = Vector2::new(0.02, -0.01);
        for cross in &mut readings.crosses {
            let at = Rotation2::new(0.6) * (cross.aim.coords() + tilt * cross.z) + Vector2::new(3.0, 5.0);
            cross.measured = [at.x, at.y].map(|value| Some(value + 0.02 * noise.next()));
        }
        let found = LensCalibration::fit(&readings).unwrap();
        let [x, y] = found.tilt.unwrap();
        assert!(found.is_telecentric() && found.axis.is_none(), "{found:?}");
        assert!((x.value - 0.02).abs() < 0.001 && (y.value + 0.01).abs() < 0.001, "{found:?}");
        // Without a tilt, and without stops, there is none to report.
        readings.same_stops = false;
        assert!(LensCalibration::fit(&readings).unwrap().tilt.is_none());
        readings.same_stops = true;
        for cross in &mut readings.crosses {
            cross.measured = [cross.aim.x, cross.aim.y].map(|value| Some(value + 0.02 * noise.next()));
        }
        assert!(LensCalibration::fit(&readings).unwrap().tilt.is_none());
    }

    #[test]
    fn readings_that_do_not_exclude_a_near_lens_do_not_show_a_telecentric_one() {
        for (height, excluded) in [(30.0, true), (0.5, false)] {
            let mut readings = crosses(&mut Noise(5), 0.02, false);
            let mut noise = Noise(8);
            for cross in &mut readings.crosses {
                cross.z = if cross.z > 0.0 { height } else { 0.0 };
                cross.measured = [cross.aim.x, cross.aim.y].map(|value| Some(value + 0.02 * noise.next()));
            }
            let found = LensCalibration::fit(&readings).unwrap();
            assert!(found.is_telecentric());
            assert_eq!(found.not_excluded().is_none(), excluded, "{height}: {found:?}");
        }
    }

    #[test]
    fn a_telecentric_lens_and_an_untrue_scale_are_recognised() {
        let mut readings = crosses(&mut Noise(5), 0.02, false);
        let mut noise = Noise(6);
        for cross in &mut readings.crosses {
            let aim = cross.aim.coords() * 1.004;
            cross.measured = [aim.x, aim.y].map(|value| Some(value + 0.02 * noise.next()));
        }
        let found = LensCalibration::fit(&readings).unwrap();
        assert!(found.is_telecentric() && found.distances().is_none());
        assert!(found.scale.iter().all(|scale| (scale.value - 1.004).abs() < 4.0 * scale.deviation));
    }
}
