//! How well a lens table describes the beams.

use serde::{Deserialize, Serialize};

use crate::geometry::correction::Exposure;
use crate::geometry::optics::measured::MeasuredFit;
use crate::geometry::space::Extents;
use crate::reason::Notice;

/// A table that predicts its own measurements worse than this, mm, is worth a notice.
const NOTABLE: f64 = 0.1;

/// Standard f-theta lenses that are not telecentric are this many times as far away as their field is wide: F = 160 mm over a field
/// of 110 mm at about 176 mm.
const TYPICAL_DISTANCE: f64 = 1.6;
/// The width of a field that is not known, mm.
const TYPICAL_FIELD: f64 = 110.0;
/// Marks that such a lens would move by less than this, mm, need no lens.
const MATTERS: f64 = 0.1;

/// A note that the lens was assumed to be telecentric, if that matters for this ink: if a standard lens over the field would move a
/// mark by more than a tenth of a mm against another one, because their heights differ.
pub(crate) fn lens_assumed(ink: &Exposure, field: Option<&Extents>) -> Option<Notice> {
    let width = field.map_or(TYPICAL_FIELD, |field| field.size().max());
    let distance = TYPICAL_DISTANCE * width;
    let middle = field.map_or(ink.field.center(), Extents::center);
    let farthest = (ink.field.min - middle).abs().sup(&(ink.field.max - middle).abs()).norm();
    let span = ink.highest - ink.lowest;
    let shift = farthest * span / distance;
    (shift > MATTERS).then(|| {
        let message = format!(
            "the settings state no lens, so that a telecentric one is assumed, under which height does not shift marks. Standard f-theta \
             lenses are not telecentric: one over this field, about {distance:.0} mm away, would move marks of this drawing by up to \
             {shift:.1} mm against each other, as its heights span {span:.1} mm. Measure the lens with `isomark calibrate lens`; or \
             state `kind = \"telecentric\"` under [optics], if it is one"
        );
        Notice::note("lens-assumed", message)
    })
}

/// How well the beams of a lens table meet its measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct LensTableReport {
    /// The number of measurements.
    pub rows: usize,
    /// The degree of the polynomials through them.
    pub degree: usize,
    /// Root mean square of the residuals, mm.
    pub residual_rms_mm: f64,
    /// The largest residual, mm.
    pub residual_max_mm: f64,
    /// Root mean square of the distances between each measurement and what all others predict, mm: how well the beams between
    /// the measurements are known.
    pub prediction_rms_mm: f64,
    /// The largest of these distances, mm.
    pub prediction_max_mm: f64,
    /// The measurement with this distance: x and y of its aim and the height of the plate, mm.
    pub worst_mm: [f64; 3],
}

impl From<MeasuredFit> for LensTableReport {
    fn from(fit: MeasuredFit) -> Self {
        Self {
            rows: fit.count,
            degree: fit.degree,
            residual_rms_mm: fit.rms,
            residual_max_mm: fit.max,
            prediction_rms_mm: fit.prediction,
            prediction_max_mm: fit.max_prediction,
            worst_mm: [fit.worst.aim.x, fit.worst.aim.y, fit.worst.z],
        }
    }
}

impl LensTableReport {
    /// A line for people, without its label.
    pub(crate) fn summary(&self) -> String {
        format!(
            "degree {} through {} rows, residual {:.3} mm rms, {:.3} mm at most; the beams are known to about {:.3} mm",
            self.degree, self.rows, self.residual_rms_mm, self.residual_max_mm, self.prediction_rms_mm,
        )
    }

    /// A warning if the beams are not known well.
    pub(crate) fn notice(&self) -> Option<Notice> {
        let [x, y, z] = self.worst_mm;
        (self.prediction_rms_mm > NOTABLE).then(|| {
            let message = format!(
                "the beams of the lens table are known to about {:.2} mm only: each measurement differs by that from what all \
                 others predict (root mean square), and by up to {:.2} mm at ({x:.1}, {y:.1}) mm, z = {z:.1} mm. The errors in \
                 the report do not contain it: lengths and positions of the mark can be off by as much, and by more beyond the \
                 measured heights",
                self.prediction_rms_mm, self.prediction_max_mm,
            );
            Notice::warning("lens-table-residual", message)
        })
    }
}
