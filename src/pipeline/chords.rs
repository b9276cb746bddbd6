//! The chords of marked polylines: how a map bends a drawing, and by how much its curves get shorter.

use super::fill;
use crate::config::{JobSettings, Vertices};
use crate::geometry::correction::{AboveLens, Bent, Projection, Subdivision};
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::quality::Shortening;
use crate::geometry::pattern::Pattern;

/// The placed drawing through a projection, divided as the settings demand.
pub(super) fn bend(
    projection: &Projection<'_>,
    placed: &Pattern,
    settings: &JobSettings,
) -> Result<Bent, AboveLens> {
    let subdivision = match settings.correction.vertices {
        Vertices::Adaptive => Subdivision::Adaptive,
        Vertices::Keep => Subdivision::Keep,
    };
    projection.bend(placed, fill::tolerance(settings), subdivision)
}

/// What the chords of ink cost without isomark: the marking program divides each curve by the same tolerance, with points on it,
/// and marks the drawn lines as they are.
pub(super) fn as_drawn(
    projection: &Projection<'_>,
    placed: &Pattern,
    settings: &JobSettings,
) -> Result<Vec<Shortening>, AboveLens> {
    let plain = Projection { map: &LengthTrueMap::Plain, ..*projection };
    let bent = plain.bend(placed, fill::tolerance(settings), Subdivision::Keep)?;
    Ok(of_ink(placed, &bent.inscribed, settings))
}

/// What the chords of a bent drawing cost, of those paths that are ink.
pub(super) fn of_ink(placed: &Pattern, chords: &[Shortening], settings: &JobSettings) -> Vec<Shortening> {
    let ink = placed.paths.iter().zip(chords).filter(|(path, _)| {
        placed.layers.get(path.layer).is_some_and(|layer| settings.pattern.counts_as_ink(&layer.name))
    });
    ink.map(|(_, shortening)| *shortening).filter(|shortening| shortening.lost > 0.0).collect()
}
