//! What a misplaced part does to the mark.

use serde::{Deserialize, Serialize};

use crate::geometry::sensitivity::{Effect, MISPLACEMENTS, Misplacement, PoseUncertainty, Sensitivity};

/// What a misplaced part does to the mark: the drawing stays in the field, and the part is not where the settings place it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SensitivityReport {
    /// One movement of the part each.
    pub misplaced: Vec<MisplacedReport>,
    /// How well the position is known (`uncertainty_mm` and others under `[fixture]`); absent if the settings state nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintyReport>,
    /// The error of the mark to expect from it, one standard deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected: Option<EffectReport>,
}

/// The effect of one movement of the part.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct MisplacedReport {
    /// The movement.
    pub movement: Movement,
    /// How far the part is shifted, mm; absent for a turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_mm: Option<f64>,
    /// How far the part is turned, degrees; absent for a shift.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_deg: Option<f64>,
    /// What that does to the mark.
    #[serde(flatten)]
    pub effect: EffectReport,
}

/// A movement of the part in the laser's frame. Turns are about the middle of the ink on the part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Movement {
    /// To the right in the field.
    X,
    /// Upwards in the field.
    Y,
    /// Towards the laser.
    Z,
    /// About the field's x.
    TiltX,
    /// About the field's y.
    TiltY,
    /// About the laser's axis.
    Rotation,
}

/// What a movement of the part does to the mark.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct EffectReport {
    /// Sum over all lines of |change of length|, mm.
    pub length_mm: f64,
    /// Sum over the inked area of |change of area|, mm².
    pub area_mm2: f64,
    /// Largest movement of the mark on the part, mm.
    pub moved_mm: f64,
}

/// How well the position of the part is known: one standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct UncertaintyReport {
    /// Along x and along y, mm.
    pub sideways_mm: f64,
    /// In height, mm.
    pub height_mm: f64,
    /// Of turns about each axis, degrees.
    pub turn_deg: f64,
}

impl From<Misplacement> for Movement {
    fn from(misplacement: Misplacement) -> Self {
        match misplacement {
            Misplacement::Shift(0) => Self::X,
            Misplacement::Shift(1) => Self::Y,
            Misplacement::Shift(_) => Self::Z,
            Misplacement::Turn(0) => Self::TiltX,
            Misplacement::Turn(1) => Self::TiltY,
            Misplacement::Turn(_) => Self::Rotation,
        }
    }
}

impl From<&Effect> for EffectReport {
    fn from(effect: &Effect) -> Self {
        Self { length_mm: effect.length, area_mm2: effect.area, moved_mm: effect.moved }
    }
}

impl SensitivityReport {
    /// The report of a sensitivity under this uncertainty of the position.
    #[must_use]
    pub fn new(sensitivity: &Sensitivity, uncertainty: &PoseUncertainty) -> Self {
        let misplaced = |(misplacement, effect): (Misplacement, &Effect)| {
            let amount = misplacement.amount();
            let (by_mm, by_deg) = match misplacement {
                Misplacement::Shift(_) => (Some(amount), None),
                Misplacement::Turn(_) => (None, Some(amount.to_degrees())),
            };
            MisplacedReport { movement: misplacement.into(), by_mm, by_deg, effect: effect.into() }
        };
        Self {
            misplaced: MISPLACEMENTS.into_iter().zip(&sensitivity.effects).map(misplaced).collect(),
            uncertainty: uncertainty.is_stated().then(|| UncertaintyReport {
                sideways_mm: uncertainty.sideways,
                height_mm: uncertainty.height,
                turn_deg: uncertainty.turn.to_degrees(),
            }),
            expected: sensitivity.expected.as_ref().map(EffectReport::from),
        }
    }

    /// The worst effect of these movements.
    fn worst(&self, of: &[Movement]) -> Option<EffectReport> {
        let effects = self.misplaced.iter().filter(|one| of.contains(&one.movement)).map(|one| one.effect);
        effects.reduce(|a, b| EffectReport {
            length_mm: a.length_mm.max(b.length_mm),
            area_mm2: a.area_mm2.max(b.area_mm2),
            moved_mm: a.moved_mm.max(b.moved_mm),
        })
    }

    /// The worst effect of a shift along x or y.
    #[must_use]
    pub fn sideways(&self) -> Option<EffectReport> {
        self.worst(&[Movement::X, Movement::Y])
    }

    /// The lines of the summary: the worst of each kind of movement, and the error to expect.
    pub(super) fn lines(&self) -> Vec<String> {
        let height = self.worst(&[Movement::Z]);
        let turn = self.worst(&[Movement::TiltX, Movement::TiltY, Movement::Rotation]);
        let mut lines = Vec::new();
        if let (Some(sideways), Some(height), Some(turn)) = (self.sideways(), height, turn) {
            lines.push(format!(
                "misplacement  a part 0.1 mm to the side: at most {:.3} mm more length error, and the mark moves by {:.2} mm; 0.1 mm \
                 too high or low: {:.3} and {:.2} mm; turned by 0.1 deg: {:.3} and {:.2} mm",
                sideways.length_mm,
                sideways.moved_mm,
                height.length_mm,
                height.moved_mm,
                turn.length_mm,
                turn.moved_mm,
            ));
        }
        lines.extend(self.expected.map(|expected| {
            format!(
                "to expect     {:.3} mm of length, {:.3} mm2 of area and {:.2} mm of position, from the uncertainty of the \
                 fixture (one standard deviation)",
                expected.length_mm, expected.area_mm2, expected.moved_mm,
            )
        }));
        lines
    }
}
