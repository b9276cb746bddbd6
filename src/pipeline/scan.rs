//! From a part's shape to its surface; a scan is smoothed first, and its facts record how.

use nalgebra::Vector3;

use super::checks;
use crate::config::PartSettings;
use crate::formats::mesh::{NormalsUsed, PartFacts, ScanFacts, ScanSurface, Shape};
use crate::geometry::height_field::{FacingPart, Grid, HeightField};
use crate::geometry::mesh::TriMesh;
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::space::View;
use crate::geometry::surface::fit::{FitError, FitOptions, FittedSurface};
use crate::geometry::surface::scan::{ScanError, SmoothedScan};
use crate::reason::{Notice, Place, Reason};

/// Noise above this is worth a warning, mm: typical of depth cameras; scanners made for parts have a tenth of it.
const NOTABLE_NOISE: f64 = 0.5;
/// A departure of the surface from the scan above this is worth a warning, mm.
const NOTABLE_DEPARTURE: f64 = 0.05;
/// A share of dropped points above this is worth a warning.
const NOTABLE_LOSS: f64 = 0.1;
/// Steps along the longer side of a part at which it is held against its smoothed vertices.
const COVERAGE_STEPS: f64 = 64.0;
/// Share of its surface that these must cover; they end before its rims.
const COVERED: f64 = 0.75;

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
    if let Some(at) = facts.one_sided_at_mm {
        return Err(one_sided(at));
    }
    let view = View::new(settings.facing, settings.roll);
    let fitted = match shape {
        Shape::Mesh(mesh) if facts.normals_used == Some(NormalsUsed::Smoothed) => {
            noisy_mesh(mesh, facts, settings, fit)
        }
        Shape::Mesh(mesh) => FittedSurface::of_part(&FacingPart::new(mesh, &view), fit),
        Shape::Scan(cloud) => {
            let scan = SmoothedScan::bridged(cloud, &view, settings.smoothing, settings.bridge)
                .map_err(|error| scan_reason(&error, settings))?;
            fit_scan(scan, facts, settings)
        }
    };
    fitted.map_err(|error| checks::fit_reason(&error, settings))
}

fn fit_scan(
    scan: SmoothedScan,
    facts: &mut PartFacts,
    settings: &PartSettings,
) -> Result<FittedSurface, FitError> {
    let found = ScanFacts::new(&scan.quality, settings.smoothing);
    facts.notices.extend(notices(&found));
    facts.scan = Some(found);
    FittedSurface::of_field(scan.field)
}

/// The surface of a mesh whose vertices scatter: that of the points of a scan, as long as it covers what the mesh does.
fn noisy_mesh(
    mesh: &TriMesh,
    facts: &mut PartFacts,
    settings: &PartSettings,
    fit: &FitOptions,
) -> Result<FittedSurface, FitError> {
    let view = View::new(settings.facing, settings.roll);
    let part = FacingPart::new(mesh, &view);
    let normals = mesh.facet_normals();
    // Vertices of no facet are strays.
    let vertices = mesh.positions().iter().zip(normals).filter(|(_, normal)| *normal != Vector3::zeros());
    let (positions, normals) = vertices.map(|(at, normal)| (*at, normal)).unzip();
    let cloud = PointCloud::new(positions, normals);
    let scan = SmoothedScan::bridged(&cloud, &view, settings.smoothing, settings.bridge).ok();
    match scan.filter(|scan| covers(&scan.field, &part)) {
        Some(scan) => fit_scan(scan, facts, settings),
        None => {
            facts.normals_used = Some(NormalsUsed::Estimated);
            let text = "the vertices of the noisy mesh are too sparse to be smoothed as a scan, so its normals are estimated";
            facts.notices.push(Notice::warning("mesh-not-smoothed", text.to_owned()));
            FittedSurface::of_part(&part, fit)
        }
    }
}

/// Whether there is surface nearly everywhere that a part has any.
fn covers(field: &HeightField, part: &FacingPart) -> bool {
    let size = part.extents().size();
    let step = size.x.max(size.y) / COVERAGE_STEPS;
    if !(step > 0.0) {
        return false;
    }
    let sampled = part.sample(&Grid::over(&part.extents(), step)).field;
    let (mut all, mut covered) = (0usize, 0usize);
    for (column, row, _) in sampled.surface_nodes() {
        all += 1;
        covered += usize::from(field.is_surface(sampled.position(column, row)));
    }
    covered as f64 >= COVERED * all as f64
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

/// The reason for a part like a Möbius strip, which has no outside.
fn one_sided(at: [f64; 3]) -> Reason {
    Reason::new(
        "winding-contradicts",
        "The part has only one side, like a Möbius strip: its triangles cannot all be oriented alike.",
        "Repair the mesh where its sides meet (in Blender, Mesh > Normals > Recalculate Outside shows the place), and export it again.",
    )
    .at(Place { coordinate: Some(at.to_vec()), ..Place::default() })
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
