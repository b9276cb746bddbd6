//! Weights that depend on the strains of the round before.

/// Strains below this share of the mean at the start are weighted as squares, those above as absolute values.
const SOFT_LINES: f64 = 0.3;
/// The same for areas.
const SOFT_AREAS: f64 = 0.5;
/// Paper becomes at most this many times as stiff.
const STIFFEST: f64 = 30.0;

/// What the even map leaves: the measure for all others.
#[derive(Debug, Clone, Copy)]
pub(super) struct EvenMap {
    /// Its largest angle error at the ink, rad.
    pub(super) angle: f64,
    /// Its largest strain over the box.
    pub(super) strain: f64,
}

/// The scales of the weights, fixed before the first round.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scales {
    /// Mean strain along the lines.
    pub(super) line: f64,
    /// Mean strain of areas.
    pub(super) area: f64,
    /// The strain from which on paper becomes stiffer.
    pub(super) paper: f64,
    /// Weight of the angles.
    pub(super) angles: f64,
    /// The largest angle error that is accepted, rad.
    pub(super) limit: f64,
}

impl Scales {
    /// The weight of a line with this strain, relative to its weight among squares.
    pub(super) fn of_line(&self, strain: f64) -> f64 {
        self.line / strain.hypot(SOFT_LINES * self.line)
    }

    /// The same for the strain of an area.
    pub(super) fn of_area(&self, strain: f64) -> f64 {
        self.area / strain.hypot(SOFT_AREAS * self.area)
    }

    /// The same for a place of the box with this largest strain.
    pub(super) fn of_paper(&self, strain: f64) -> f64 {
        (strain / self.paper).clamp(1.0, STIFFEST)
    }
}
