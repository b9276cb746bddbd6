//! From a part's shape to its surface; a scan is smoothed first, and its facts record how.

use nalgebra::{Point3, Vector3};

use super::causes::NOISE_REACH;
use super::checks;
use super::landmarks::Lift;
use crate::config::PartSettings;
use crate::cores::Cores;
use crate::formats::mesh::{NormalsUsed, PartFacts, RoundFacts, ScanFacts, ScanSurface, Shape, SolidPart};
use crate::geometry::facing_part::FacingPart;
use crate::geometry::height_field::{Grid, HeightField, Node};
use crate::geometry::mesh::TriMesh;
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::shading::{self, WildNormals};
use crate::geometry::solid::rays::{SeenFace, SeenSolid};
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::{View, ViewPoint};
use crate::geometry::surface::fit::{FitError, FitOptions, FittedSurface};
use crate::geometry::surface::scan::{ScanError, ScanForm, SmoothedScan};
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
/// A point this close to the sampled surface is on it, mm.
const NEAR_SURFACE: f64 = 1.0;

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
    let settings = &settings.for_part_with(facts.marking_frame());
    let view = View::new(settings.facing, settings.roll);
    if let Shape::Mesh(mesh) = shape
        && matches!(facts.normals_used, Some(NormalsUsed::File | NormalsUsed::Mixed))
        && let Some(wild) = shading::wild_normals(mesh, &view.part_vector(Vector3::z()))
    {
        return Err(wild_normals(&wild));
    }
    let fitted = match shape {
        Shape::Mesh(mesh) if facts.normals_used == Some(NormalsUsed::Smoothed) => {
            noisy_mesh(mesh, facts, settings, fit)
        }
        Shape::Mesh(mesh) => FittedSurface::of_part(&FacingPart::with_fork(mesh, &view, &Cores), fit),
        Shape::Solid(part) => return exact_faces(part, &view, facts, settings, fit),
        Shape::Scan(cloud) => {
            let scan = SmoothedScan::bridged(cloud, &view, settings.smoothing, settings.bridge, &Cores)
                .map_err(|error| scan_reason(&error, settings))?;
            let known: Vec<RoundForm> = scan.known.iter().map(|known| known.form).collect();
            facts.round_faces = known.iter().copied().map(RoundFacts::from).collect();
            fit_scan(scan, facts, settings).map(|surface| surface.with_known(known))
        }
    };
    let surface = fitted.map_err(|error| checks::fit_reason(&error, settings))?;
    // A defect behind the marked side is only warned about.
    match facts.one_sided_at_mm {
        Some(at) if is_on(&surface, view.point(at.into())) => Err(one_sided(at)),
        _ => Ok(surface),
    }
}

/// The surface of exact faces.
fn exact_faces(
    part: &SolidPart,
    view: &View,
    facts: &mut PartFacts,
    settings: &PartSettings,
    fit: &FitOptions,
) -> Result<FittedSurface, Reason> {
    let facing = FacingPart::of_solid(&part.solid, &part.mesh, view, &Cores);
    if let Some(face) = facing.faces().and_then(SeenSolid::unread) {
        return Err(face_unread(face));
    }
    let known = facing.faces().map(SeenSolid::round_forms).unwrap_or_default();
    facts.round_faces = known.iter().copied().map(RoundFacts::from).collect();
    let surface =
        FittedSurface::of_part(&facing, fit).map_err(|error| checks::fit_reason(&error, settings))?;
    Ok(surface.with_known(known))
}

/// The reason for a face that the laser sees and that cannot be read.
fn face_unread(face: &SeenFace) -> Reason {
    let kind = face.unread().unwrap_or_default();
    Reason::new(
        "step-face-unread",
        format!("The laser sees face #{} of the STEP file, which cannot be read: {kind}.", face.id()),
        "Turn another side to the laser (`--facing`), set `converter = \"freecad\"` under [part] where FreeCAD is installed, or open the \
         file in FreeCAD (File > Open), select the body and export it as GLB (File > Export), which isomark reads.",
    )
    .at(Place { item: Some(format!("#{}", face.id())), ..Place::default() })
}

/// Whether a point of the view is on the sampled surface.
fn is_on(surface: &FittedSurface, at: Point3<f64>) -> bool {
    let near = surface.field.step().max(NEAR_SURFACE);
    let height = surface.sampled_height(ViewPoint::new(at.x, at.y));
    // Beside the surface, at a rim, nothing hides the place.
    height.is_none_or(|height| (height - at.z).abs() < near)
}

fn fit_scan(
    scan: SmoothedScan,
    facts: &mut PartFacts,
    settings: &PartSettings,
) -> Result<FittedSurface, FitError> {
    let found = ScanFacts::new(&scan.quality, settings.smoothing);
    let surface = FittedSurface::of_field(scan.field);
    let lift = surface.as_ref().ok().map(|surface| Lift::new(surface, settings));
    facts.notices.extend(scan.known.iter().map(recognised));
    facts.notices.extend(notices(&found, lift));
    facts.scan = Some(found);
    Ok(surface?.doubted(Vec::new(), scan.uncertainties).measured(true))
}

/// Mentions that the points of a surface are on a cylinder or cone.
fn recognised(known: &ScanForm) -> Notice {
    let what = match known.form {
        RoundForm::Cylinder { radius, .. } => {
            format!("a cylinder with a radius of {radius:.3} mm (uncertain by {:.3} mm)", known.size_off)
        }
        RoundForm::Cone { half_angle, .. } => format!(
            "a cone with an angle of {:.3} deg (uncertain by {:.3} deg) between axis and side",
            half_angle.to_degrees(),
            known.size_off.to_degrees()
        ),
    };
    let text =
        format!("the points do not differ from {what} by more than their noise, so the surface is this form");
    Notice::note("scan-smoothed", text)
}

/// The surface of a mesh whose vertices scatter: that of the points of a scan, as long as it covers what the mesh does.
fn noisy_mesh(
    mesh: &TriMesh,
    facts: &mut PartFacts,
    settings: &PartSettings,
    fit: &FitOptions,
) -> Result<FittedSurface, FitError> {
    let view = View::new(settings.facing, settings.roll);
    let part = FacingPart::with_fork(mesh, &view, &Cores);
    let normals = mesh.facet_normals();
    // Vertices of no facet are strays.
    let vertices = mesh.positions().iter().zip(normals).filter(|(_, normal)| *normal != Vector3::zeros());
    let (positions, normals) = vertices.map(|(at, normal)| (*at, normal)).unzip();
    let cloud = PointCloud::new(positions, normals);
    let scan = SmoothedScan::bridged(&cloud, &view, settings.smoothing, settings.bridge, &Cores).ok();
    match scan.filter(|scan| covers(&scan.field, &part)) {
        Some(scan) => {
            let noise = facts.noise.map_or(0.0, |noise| noise.noise_mm);
            let uncertainties = scan.uncertainties.clone();
            let surface = fit_scan(scan, facts, settings)?;
            let facets = FacingPart::with_fork(&mesh.clone().with_flat_facets(), &view, &Cores);
            let field = beyond_noise(&surface, [&part, &facets], noise);
            Ok(FittedSurface::compare(surface.nurbs, field).doubted(Vec::new(), uncertainties).measured(true))
        }
        None => {
            facts.normals_used = Some(NormalsUsed::Estimated);
            let text = "the vertices of the noisy mesh are too sparse to be smoothed as a scan, so its normals are estimated";
            facts.notices.push(Notice::warning("mesh-not-smoothed", text.to_owned()));
            FittedSurface::of_part(&part, fit)
        }
    }
}

/// The smoothed heights, and where the mesh is farther from them than its noise explains, as at edges that were rounded, those
/// of the mesh less its noise: what a drawing there is checked against. Of the `seen` curved patches, which noise bends, and flat
/// facets, which curvature leaves, the nearer ones count.
fn beyond_noise(surface: &FittedSurface, seen: [&FacingPart; 2], noise: f64) -> HeightField {
    let sampled = seen.map(|part| part.sample(surface.field.grid()).field);
    let mut field = surface.field.clone();
    field.adjust(|index, height| {
        let of_mesh = sampled.each_ref().map(|field| match field.nodes().get(index) {
            Some(Node::Surface(of_mesh)) => Some(of_mesh - height),
            _ => None,
        });
        let nearest = of_mesh.into_iter().flatten().min_by(|one, other| one.abs().total_cmp(&other.abs()));
        nearest.map_or(height, |off| height + off.signum() * (off.abs() - NOISE_REACH * noise).max(0.0))
    });
    field
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

fn notices(facts: &ScanFacts, lift: Option<Lift>) -> Vec<Notice> {
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
        let place = lift.and_then(|lift| lift.point(ViewPoint::new(x, y)));
        notices.push(Notice::warning("scan-rounded", text).at_places(place));
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

/// The reason for a part with normals that are unrelated to its facets.
fn wild_normals(wild: &WildNormals) -> Reason {
    Reason::new(
        "mesh-normals-wild",
        format!(
            "{:.0} % of the side that faces the laser has normals that lean more than 66 deg from its facets.",
            wild.share * 100.0
        ),
        "Recalculate the normals (in Blender: Mesh > Normals > Reset Vectors) and export the part again, or set \
         `normals = \"estimate\"` (`--normals estimate`), which takes them from the facets.",
    )
    .at(Place { coordinate: Some(wild.at.coords.iter().copied().collect()), ..Place::default() })
    .with_number("area with such normals", wild.share * 100.0, "%", Some(shading::WILD * 100.0))
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
        _ => Reason::new(
            "scan-not-smoothed",
            format!("The scan could not be smoothed: {what}."),
            "Set `smoothing = \"low-pass\"` for this part, or scan it again.",
        ),
    }
}
