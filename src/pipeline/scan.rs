//! From a part's shape to its surface; a scan is smoothed first, and its facts record how.

use super::checks;
use crate::config::PartSettings;
use crate::formats::mesh::{PartFacts, ScanFacts, ScanSurface, Shape};
use crate::geometry::height_field::FacingPart;
use crate::geometry::space::View;
use crate::geometry::surface::fit::{FitOptions, FittedSurface};
use crate::geometry::surface::scan::{ScanError, SmoothedScan};
use crate::reason::{Notice, Reason};

/// Noise above this is worth a warning, mm: typical of depth cameras; scanners made for parts have a tenth of it.
const NOTABLE_NOISE: f64 = 0.5;
/// A departure of the surface from the scan above this is worth a warning, mm.
const NOTABLE_DEPARTURE: f64 = 0.05;
/// A share of dropped points above this is worth a warning.
const NOTABLE_LOSS: f64 = 0.1;

/// The fitted surface of a shape. Measurements of a scan are added to `facts`, with notices.
///
/// # Errors
/// When nothing of the part that faces the laser can be marked.
pub fn surface_of(
    shape: &Shape,
    facts: &mut PartFacts,
    settings: &PartSettings,
    fit: &FitOptions,
) -> Result<FittedSurface, Reason> {
    let view = View::new(settings.facing, settings.roll);
    let fitted = match shape {
        Shape::Mesh(mesh) => FittedSurface::of_part(&FacingPart::new(mesh, &view), fit),
        Shape::Scan(cloud) => {
            let scan = SmoothedScan::new(cloud, &view, settings.smoothing)
                .map_err(|error| scan_reason(&error, settings))?;
            let found = ScanFacts::new(&scan.quality, settings.smoothing);
            facts.notices.extend(notices(&found));
            facts.scan = Some(found);
            FittedSurface::of_field(scan.field)
        }
    };
    fitted.map_err(|error| checks::fit_reason(&error, settings))
}

fn notices(facts: &ScanFacts) -> Vec<Notice> {
    let mut notices = Vec::new();
    let Some(main) = facts.surfaces.first() else { return notices };
    notices.push(Notice::note("scan-smoothed", facts.summary()));
    if main.noise_mm > NOTABLE_NOISE {
        let text = format!(
            "the points of the scan scatter by {:.2} mm about the surface; lengths may be inaccurate by that amount",
            main.noise_mm
        );
        notices.push(Notice::warning("scan-noisy", text));
    }
    let departs = |surface: &&ScanSurface| surface.departure_mm > NOTABLE_DEPARTURE;
    if let Some(surface) = facts.surfaces.iter().find(departs) {
        let [x, y] = surface.departure_at_mm;
        let text = format!(
            "the smoothed surface deviates from the scan by {:.3} mm at ({x:.1}, {y:.1}) mm, more than the noise \
             explains: an edge there was rounded; mark away from it, or smooth less",
            surface.departure_mm
        );
        notices.push(Notice::warning("scan-rounded", text));
    }
    if facts.dropped as f64 > NOTABLE_LOSS * facts.points as f64 {
        let text = format!("{} of {} points were dropped as outliers or strays", facts.dropped, facts.points);
        notices.push(Notice::warning("scan-points-dropped", text));
    }
    notices
}

fn scan_reason(error: &ScanError, settings: &PartSettings) -> Reason {
    let what = error.to_string();
    match error {
        ScanError::TooFewPoints { points, needed } => Reason::new(
            "scan-too-few-points",
            what,
            "Scan the part with a smaller point distance; check `facing` if the points have normals.",
        )
        .with_number("points", *points as f64, "", Some(*needed as f64)),
        ScanError::NoArea { width, .. } => Reason::new(
            "scan-without-area",
            what,
            "Check `facing`, the part's unit and the order of the columns; a single profile is not a surface.",
        )
        .with_number("width", *width, "mm", None),
        ScanError::NoSurface { points } => {
            let facing = settings.facing.direction();
            Reason::new(
                "scan-without-surface",
                what,
                format!(
                    "Check the part's unit and `facing` ({}, {}, {}), or scan with a smaller point distance.",
                    facing.x, facing.y, facing.z
                ),
            )
            .with_number("points", *points as f64, "", None)
        }
        ScanError::Solve(_) => Reason::new(
            "scan-not-smoothed",
            format!("The scan could not be smoothed: {what}."),
            "Set `smoothing = \"low-pass\"` for this part, or scan it again.",
        ),
    }
}
