//! From a piece of a level line to points in the field.

use nalgebra::Point3;

use super::distance::DistanceField;
use super::scan::{Interval, level};
use crate::geometry::correction::{AboveLens, Projection};
use crate::geometry::space::{FieldPoint, FlatPoint};

/// Distance of the first stations along the lines, mm: product surfaces have no waves between them.
const STATIONS: f64 = 2.0;
/// Pieces shorter than this, mm, are not divided.
const SHORTEST: f64 = 0.01;

/// Follows the lines of one field.
///
/// The points of all lines are at the same multiples of dyadic fractions of a length along the lines. The chords of neighbouring lines
/// then deviate from their curves alike, and their distance does not.
pub(super) struct Tracer<'a> {
    pub(super) field: &'a DistanceField,
    pub(super) projection: &'a Projection<'a>,
    pub(super) spacing: f64,
    /// Largest distance between a line and its chords in the field, mm.
    pub(super) tolerance: f64,
}

/// A point of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Station {
    along: f64,
    left: f64,
    pub(super) flat: FlatPoint,
    pub(super) field: FieldPoint,
    /// On the part, in the laser's frame.
    pub(super) landing: Point3<f64>,
}

impl Tracer<'_> {
    /// The points of a piece at its ends and at most 2 mm apart.
    pub(super) fn stations(&self, piece: &Interval) -> Result<Vec<Station>, AboveLens> {
        let level = level(piece.line, self.spacing);
        let mut stations = vec![self.station(level, piece.from, piece.left)?];
        let mut left = piece.left;
        let (first, last) = ((piece.from / STATIONS).floor() as i64 + 1, (piece.to / STATIONS).ceil() as i64);
        for along in (first..last).map(|number| number as f64 * STATIONS).chain([piece.to]) {
            let station = self.station(level, along, left)?;
            left = station.left;
            stations.push(station);
        }
        Ok(stations)
    }

    /// As few points of a piece as the tolerance allows; `stations` are those that were found before.
    pub(super) fn simplified(
        &self,
        piece: &Interval,
        stations: &[Station],
    ) -> Result<Vec<Station>, AboveLens> {
        let mut kept: Vec<Station> = stations.first().copied().into_iter().collect();
        self.follow(level(piece.line, self.spacing), stations, &mut kept)?;
        Ok(kept)
    }

    fn station(&self, level: f64, along: f64, guess: f64) -> Result<Station, AboveLens> {
        let (flat, left) = self.field.on_level(level, along, guess);
        let (view, landing) = self.projection.landing(flat);
        let field = self.projection.head.aim(landing).ok_or(AboveLens { at: view })?;
        Ok(Station { along, left, flat, field, landing })
    }

    /// Adds the points after the first station up to the last one.
    fn follow(&self, level: f64, stations: &[Station], kept: &mut Vec<Station>) -> Result<(), AboveLens> {
        match stations {
            [from, to] => self.divide(level, from, to, kept),
            [from, between @ .., to] if !between.is_empty() => {
                if between.iter().all(|station| self.is_near(station, from, to)) {
                    kept.push(*to);
                    return Ok(());
                }
                // The station whose number along the lines is divisible by the highest power of two.
                let rank = |station: &Station| ((station.along / STATIONS).round() as i64).trailing_zeros();
                let middle = (0..between.len()).max_by_key(|index| rank(&between[*index])).unwrap_or(0) + 1;
                self.follow(level, &stations[..=middle], kept)?;
                self.follow(level, &stations[middle..], kept)
            }
            _ => Ok(()),
        }
    }

    /// The same between two stations without others between them.
    fn divide(
        &self,
        level: f64,
        from: &Station,
        to: &Station,
        kept: &mut Vec<Station>,
    ) -> Result<(), AboveLens> {
        let span = to.along - from.along;
        let split = between(from.along, to.along).filter(|_| span > SHORTEST);
        let Some(along) = split else {
            kept.push(*to);
            return Ok(());
        };
        let share = (along - from.along) / span;
        let station = self.station(level, along, from.left + (to.left - from.left) * share)?;
        // A parabola is nearer to its chord towards the ends.
        let sag =
            distance_to_chord(station.field, from.field, to.field) / (4.0 * share * (1.0 - share)).max(0.1);
        if sag <= self.tolerance {
            kept.push(*to);
            return Ok(());
        }
        self.divide(level, from, &station, kept)?;
        self.divide(level, &station, to, kept)
    }

    fn is_near(&self, station: &Station, from: &Station, to: &Station) -> bool {
        distance_to_chord(station.field, from.field, to.field) <= self.tolerance
    }
}

/// The multiple of the largest power of two of a station's distance strictly between two places; `None` if they are too close.
fn between(from: f64, to: f64) -> Option<f64> {
    let mut step = STATIONS;
    while step > SHORTEST / 4.0 {
        let multiple = (from / step).floor() * step + step;
        if multiple < to - SHORTEST / 4.0 && multiple > from + SHORTEST / 4.0 {
            return Some(multiple);
        }
        step /= 2.0;
    }
    None
}

fn distance_to_chord(at: FieldPoint, from: FieldPoint, to: FieldPoint) -> f64 {
    let (along, offset) = (to - from, at - from);
    let length = along.norm();
    if length > 0.0 { (along.x * offset.y - along.y * offset.x).abs() / length } else { offset.norm() }
}
