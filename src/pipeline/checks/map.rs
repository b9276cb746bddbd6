//! Why there is no map, and what the map leaves.

use super::{off_surface, unsolved};
use crate::formats::mesh::{NormalsUsed, PartFacts};
use crate::geometry::distances::Distances;
use crate::geometry::mapping::MapError;
use crate::geometry::mapping::cone::ConeError;
use crate::geometry::mapping::cylinder::CylinderError;
use crate::geometry::mapping::floater::FloaterError;
use crate::geometry::mapping::isometric::{Instead, IsometricError};
use crate::geometry::mapping::mapping_domain::MappingDomainError;
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::pipeline::causes::{Cause, KINK_OF_NOISE, NOISE_REACH};
use crate::pipeline::landmarks::Lift;
use crate::pipeline::{
    Aim, CachedSurface, CorrectionSettings, Distortion, Ink, JobSettings, LengthTrueMap, Method, Sku,
    Weighting,
};
use crate::reason::{Notice, Place, Reason};

/// Uncertain length errors above this, mm, are worth a notice.
const NOTABLE_UNCERTAIN: f64 = 0.05;
/// A surface is unknown if at least this share of the length of a drawing is uncertain.
const UNKNOWN_SHARE: f64 = 0.1;
/// A drawing that stretches less than this on the part as it is drawn is on a plane, or so small on a round face that flat facets
/// would change its lengths by no more than this.
const STRETCH_OF_PLANE: f64 = 1e-3;
/// CAD programs, as files name them.
const CAD: [&str; 2] = ["Open CASCADE", "FreeCAD"];
/// Remaining stretch above this is worth a warning.
const NOTABLE_STRETCH: f64 = 0.02;
/// With a method for comparison, remaining stretch above this is worth a warning: a tenth of a percent, rounded.
const TRUE_AS_DRAWN: f64 = 5e-4;
/// A correction that adds more than this share of the length of all lines to their error is worth a notice.
const NOTABLE_LOSS: f64 = 0.001;
/// A changed distance between marks is worth a notice if it changes by at least this share.
/// [`NOTABLE_DISTANCE`] must be reached, too.
const NOTABLE_CHANGE: f64 = 0.05;
/// A changed distance between marks is worth a notice if it changes by at least this, mm. [`NOTABLE_CHANGE`]
/// must be reached, too.
const NOTABLE_DISTANCE: f64 = 0.1;
/// The share of an uncertain stretch that is only the peak of what is possible. A warning needs what is likely.
const PEAK_ONLY: f64 = 2.0 / 3.0;

pub(in crate::pipeline) fn map_reason(
    error: &MapError,
    place: FlatPoint,
    part: &CachedSurface,
    ink: &Ink,
) -> Reason {
    let surface = &part.surface;
    // If ink is outside the part, that is the clearer reason.
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let seen = |flat: FlatPoint| ViewPoint::from(flat.coords());
    let samples: Vec<ViewPoint> =
        ends.chain(ink.squares.iter().chain(&ink.dots).copied()).map(seen).collect();
    let beside = samples.iter().filter(|at| !surface.field.is_surface(**at)).count();
    let middle = seen(place);
    let first = samples.iter().find(|at| !surface.field.is_surface(**at));
    // The middle of a dial may be in the hole of its shaft.
    let of_middle = Some(&middle).filter(|middle| !surface.field.is_surface(**middle));
    if let Some(at) = first.map(|first| of_middle.unwrap_or(first)) {
        let percent = 100.0 * beside as f64 / samples.len() as f64;
        return off_surface(*at, part, &ink.extents).with_number(
            "ink without surface",
            percent,
            "%",
            Some(0.0),
        );
    }
    let reason = match error {
        MapError::Isometric(IsometricError::Folded { at }) => {
            return Reason::new(
                "map-folded",
                format!(
                    "The drawing would be folded over itself on the part near ({:.1}, {:.1}) mm.",
                    at.x, at.y
                ),
                "Make the drawing smaller, or place it where the part is less strongly curved.",
            )
            .at(Place { coordinate: Some(vec![at.x, at.y]), ..Place::default() });
        }
        MapError::Isometric(IsometricError::Solve(error)) => {
            let remedy = "Place the drawing where the part is smoother and less steep, make it smaller, or export the part again \
                          with a smaller deviation.";
            let (why, remedy) = unsolved(error, remedy);
            let what = format!("No length-true map was found on the part under the drawing: {why}.");
            Reason::new("map-not-found", what, remedy)
        }
        MapError::Cylinder(error) => {
            let remedy = match error {
                CylinderError::TooFewPoints { .. } => PLACE_ON_PART,
                CylinderError::AnchorBeside { .. } => PLACE_ANCHOR,
                _ => OTHER_METHOD,
            };
            Reason::new("no-cylinder", format!("The part cannot be unrolled as a cylinder: {error}."), remedy)
        }
        MapError::Cone(error) => {
            let remedy = match error {
                ConeError::TooFewPoints { .. } => PLACE_ON_PART,
                ConeError::AnchorBeside { .. } | ConeError::ApexInDrawing { .. } => PLACE_ANCHOR,
                _ => OTHER_METHOD,
            };
            Reason::new("no-cone", format!("The part cannot be unrolled as a cone: {error}."), remedy)
        }
        MapError::MappingDomain(error) => {
            let remedy = match error {
                MappingDomainError::Outside { .. } => PLACE_ON_PART,
                _ => OTHER_METHOD,
            };
            Reason::new(
                "no-mapping-domain",
                format!("No mapping domain was found for the drawing: {error}."),
                remedy,
            )
        }
        MapError::Floater(error) => {
            let remedy = match error {
                FloaterError::NoOutline { .. } | FloaterError::Outside { .. } => PLACE_ON_PART,
                _ => OTHER_METHOD,
            };
            Reason::new(
                "no-parametrisation",
                format!("The part cannot be mapped to a square: {error}."),
                remedy,
            )
        }
        _ => Reason::new(
            "map-not-found",
            format!("No length-true map was found for the drawing: {error}."),
            "Place the drawing where the part is less steep, or make it smaller.",
        ),
    };
    reason.at(Place { coordinate: Some(middle.coords().iter().copied().collect()), ..Place::default() })
}

const PLACE_ON_PART: &str = "Place the drawing on the part (`place_mm`, `--place`).";
const OTHER_METHOD: &str = "Use the method `auto` or `isometric` for this part.";
const PLACE_ANCHOR: &str = "Place the anchor on the cylinder or cone, away from its apex (`place_mm` or `anchor`, \
                            `--place` or `--anchor`).";

/// Usual maximum number of steps of the length-true map on smooth parts.
const USUAL_STEPS: usize = 11;

/// Logs a length-true map that took many steps, and warns if its search did not converge or if weights have no effect.
pub(in crate::pipeline) fn settled(
    sku: &Sku,
    map: &LengthTrueMap,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) {
    let LengthTrueMap::Isometric(map) = map else { return };
    let steps = map.iterations.len();
    if steps > USUAL_STEPS {
        tracing::info!("{sku}: the length-true map took {steps} steps: {:?}", map.iterations);
    }
    if !map.settled {
        let last = map.iterations.last();
        let text = format!(
            "the search for the length-true map did not converge in {steps} steps: the last step still moved it by \
             {:.4} mm and left a mean strain of {:.2e}; the part is rough under the drawing, and a better map may \
             exist",
            last.map_or(0.0, |last| last.step),
            last.map_or(0.0, |last| last.reached.sqrt()),
        );
        tracing::warn!("{sku}: {text}");
        notices.push(Notice::warning("map-unsettled", text));
    }
    let CorrectionSettings { weighting, aim, length_weight, angle_weight, .. } = settings.correction;
    let is_given = aim != Aim::Balanced || (length_weight, angle_weight) != (1.0, 1.0);
    if weighting == Weighting::Uniform && is_given {
        notices.push(Notice::warning(
            "weights-unused",
            format!(
                "the aim `{aim}`, the length weight of {length_weight} and the angle weight of {angle_weight} have no \
                 effect with the weighting `uniform`; they apply to `ink`"
            ),
        ));
    }
}

/// Warns if the part does not match the requested cylinder or cone.
pub(in crate::pipeline) fn unrolled(map: &LengthTrueMap, notices: &mut Vec<Notice>) {
    if let Some(residual) = map.fit_residual().filter(|residual| *residual > Method::EXACT_TOLERANCE) {
        notices.push(Notice::warning(
            "no-true-figure",
            format!(
                "under the drawing, the part deviates from the cylinder or cone by up to {residual:.3} mm; the method \
                 `auto` may keep lengths better"
            ),
        ));
    }
}

/// Rejects a surface that is not known well enough for true lengths, and adds a notice if most of the reported length error
/// is what the facets leave uncertain, or of exact faces their samples, which are `step` apart, mm.
pub(in crate::pipeline) fn uncertain(
    after: &Distortion,
    facts: &PartFacts,
    step: f64,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let uncertain = &after.uncertain;
    let limit = UNKNOWN_SHARE * after.length;
    // Of exact faces nothing is unknown except between the samples, where the slope jumps.
    let is_exact = !facts.faces.is_empty() || facts.scan.is_none() && facts.triangles == 0;
    let of_mesh = match is_exact {
        true => Some(Cause::Detail(step)),
        false => cause_of_uncertainty(facts, uncertain.max_slope),
    };
    if uncertain.length_error > limit {
        let remedy = match &facts.scan {
            Some(_) => {
                "Scan with less noise, more points and without outliers, or use a model of the part from CAD."
            }
            None => of_mesh.map_or_else(|| finer_facets(facts), Cause::remedy),
        };
        let because = of_mesh.map_or(String::new(), |cause| format!(", because {}", cause.clause()));
        return Err(Reason::new(
            "surface-unknown",
            format!(
                "The shape of the part under the drawing is not known: its slope may be wrong by {:.1} degrees, and with it the \
                 lengths of the mark{because}.",
                uncertain.max_slope.to_degrees()
            ),
            remedy,
        )
        .with_number("uncertain length", uncertain.length_error, "mm", Some(limit)));
    }
    let is_shown = notices_of_part(facts, || None, after).any(|notice| notice.code == "facets-flat");
    if uncertain.length_error > NOTABLE_UNCERTAIN
        && uncertain.length_error > after.length_error / 2.0
        && !is_shown
    {
        let (cause, remedy) = match &facts.scan {
            // Smoothing leaves less of the noise than there is.
            Some(scan) if scan.surfaces.iter().all(|surface| uncertain.max_height > surface.noise_mm) => (
                "the points of the scan are sparse where the part bends".to_owned(),
                "Scan with more points.",
            ),
            Some(_) => ("the points of the scan scatter".to_owned(), "Scan with less noise or more points."),
            None => of_mesh.map_or_else(
                || ("the part's facets are coarse".to_owned(), finer_facets(facts)),
                |cause| (cause.clause(), cause.remedy()),
            ),
        };
        notices.push(Notice::warning(
            "facets-coarse",
            format!(
                "{:.3} mm of the reported length error of {:.3} mm is uncertain, because {cause}: under the drawing the \
                 surface may be wrong by {:.3} mm and {:.2} degrees. {remedy}",
                uncertain.length_error,
                after.length_error,
                uncertain.max_height,
                uncertain.max_slope.to_degrees()
            ),
        ));
    }
    Ok(())
}

/// What makes the slope of a mesh uncertain by `slope`, rad, other than the size of its facets.
fn cause_of_uncertainty(facts: &PartFacts, slope: f64) -> Option<Cause> {
    if let Some(lean) = facts.normals_lean_deg.filter(|lean| slope <= NOISE_REACH * lean.to_radians()) {
        return Some(Cause::Normals(lean));
    }
    let seen = facts.noise.or(facts.scatter).filter(|_| facts.normals_used != Some(NormalsUsed::Smoothed))?;
    // So far facets of such vertices lean from one another.
    let leans = NOISE_REACH * KINK_OF_NOISE * seen.noise_mm / seen.spacing_mm;
    let cause = if facts.noise.is_some() { Cause::Noise } else { Cause::Scatter };
    (slope.tan() <= leans).then_some(cause(seen.noise_mm))
}

/// The notices of the part's file that matter for a drawing: doubts about its facets only where the drawing is on them. `as_seen`
/// gives the errors of the drawing as it is, seen along the view.
pub(in crate::pipeline) fn notices_of_part<'a>(
    facts: &'a PartFacts,
    as_seen: impl Fn() -> Option<Distortion> + 'a,
    after: &'a Distortion,
) -> impl Iterator<Item = &'a Notice> {
    facts.notices.iter().filter(move |notice| match notice.code.as_str() {
        "facets-flat" => after.uncertain.length_error > NOTABLE_UNCERTAIN,
        // Facets that are taken for a round face curve the surface.
        "facets-rounded" => as_seen().is_none_or(|seen| seen.max_stretch > STRETCH_OF_PLANE),
        _ => true,
    })
}

/// What determines the surface between the vertices of a mesh better, in the program that wrote the file; for both kinds of
/// programs where the file does not name it.
fn finer_facets(facts: &PartFacts) -> &'static str {
    let has_normals = facts.normals_used == Some(NormalsUsed::File);
    match facts.producer.as_deref() {
        _ if facts.notices.iter().any(|notice| notice.code == "facets-flat") => {
            "If facets that are shaded flat are flat, set `normals = \"file\"` (`--normals file`); if they are round, shade them \
             smooth, too, and export the part again."
        }
        Some(producer) if producer.contains("Blender") => {
            "In Blender, apply the Subdivision modifier and export the part again, or export the part from CAD as STEP, which has \
             no facets."
        }
        Some(producer) if CAD.iter().any(|name| producer.contains(name)) && has_normals => {
            "Export the part as STEP, which has no facets, or with a smaller deviation."
        }
        Some(producer) if CAD.iter().any(|name| producer.contains(name)) => {
            "Export the part as STEP, which has no facets, or as glTF with its normals."
        }
        _ => {
            "Export the part from CAD as STEP, which has no facets, or as glTF with its normals, or with finer facets; in Blender, \
             apply the Subdivision modifier."
        }
    }
}

/// Reports a map other than the one that the aim asks for. Warns of lines that the correction makes less true than they are in
/// the drawing as it is, because it keeps areas, shapes and distances too.
pub(in crate::pipeline) fn traded(
    map: &LengthTrueMap,
    before: Option<&Distortion>,
    after: &Distortion,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) {
    let CorrectionSettings { weighting, aim, .. } = settings.correction;
    let instead = if let LengthTrueMap::Isometric(map) = map { map.instead } else { None };
    match instead {
        Some(Instead::LengthsAlone) => notices.push(Notice::note(
            "lengths-alone",
            "the usual map for the aim `lengths` would make the lines less true than they are without a correction, so this one \
             keeps hardly anything but their lengths: shapes and distances change more",
        )),
        Some(Instead::AsDrawn) => {
            let what = match (weighting, aim) {
                (Weighting::Ink, Aim::Lengths) => "the lengths of the lines",
                (Weighting::Ink, Aim::Areas) => "the sizes of the areas",
                (Weighting::Ink, Aim::Shapes) => "the angles",
                (Weighting::Ink, Aim::Balanced) | (Weighting::Uniform, _) => "lengths, areas and angles",
            };
            let message = format!(
                "the drawing is marked as it is drawn: no correction was found that keeps {what} as well"
            );
            notices.push(Notice::warning("marked-as-drawn", message));
            return;
        }
        _ => {}
    }
    let Some(before) = before.filter(|_| !map.is_for_comparison()) else { return };
    let [was, is] = [before, after].map(|figures| figures.length_error);
    // What is not known of the part is in both errors, and what the correction gains elsewhere is worth a little.
    if is - after.uncertain.length_error <= was + NOTABLE_LOSS * after.length {
        return;
    }
    let remedy = if weighting == Weighting::Uniform || aim != Aim::Lengths {
        "For truer lines, try `aim = \"lengths\"` under [correction] (`--aim lengths`, with the weighting `ink`)."
    } else {
        "For truer lines, make the drawing smaller, or split it into several jobs."
    };
    notices.push(Notice::warning(
        "lengths-traded",
        format!(
            "the correction makes the lines less true: they would be wrong by {was:.3} mm in all without it, and are wrong by \
             {is:.3} mm with it, because it also keeps areas, shapes and distances. {remedy}"
        ),
    ));
}

/// Warns of distances between marks that change, because the space between lines gives way.
pub(in crate::pipeline) fn distances(
    map: &LengthTrueMap,
    found: Option<&Distances>,
    lift: Lift,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) {
    let Some(Distances { worst, .. }) = found.filter(|_| !map.is_for_comparison()) else { return };
    let share = worst.share();
    if share.abs() < NOTABLE_CHANGE || (worst.marked - worst.drawn).abs() < NOTABLE_DISTANCE {
        return;
    }
    let remedy = match settings.correction.weighting {
        Weighting::Ink => {
            "The space between lines gives way, so that lines and areas are true. Where distances matter as much, set \
             `weighting = \"uniform\"` under [correction] (`--weighting uniform`)."
        }
        Weighting::Uniform => {
            "The part is curved in two directions there. Make the drawing smaller, or split it into several jobs."
        }
    };
    let text = format!(
        "near ({:.1}, {:.1}) mm of the placed drawing, the distance between two marks is {:.2} mm in the drawing and {:.2} mm on \
         the part ({:+.1} %). {remedy}",
        worst.at.x,
        worst.at.y,
        worst.drawn,
        worst.marked,
        share * 100.0
    );
    notices.push(Notice::warning("distance-changes", text).at_places(lift.point(map.point(worst.at))));
}

/// Warns of errors that even the best map leaves, and of maps that are only for comparison.
pub(in crate::pipeline) fn quality(
    map: &LengthTrueMap,
    after: &Distortion,
    part: &CachedSurface,
    lift: Lift,
    drawn: &Extents,
    notices: &mut Vec<Notice>,
) {
    let place = lift.point(map.point(after.max_stretch_at));
    let likely = after.max_stretch - PEAK_ONLY * after.uncertain.max_stretch;
    if map.is_for_comparison() {
        if likely <= TRUE_AS_DRAWN {
            return;
        }
        let method = match map {
            LengthTrueMap::Plain => "the method `none` places the drawing without a correction",
            _ => "this method is only for comparison",
        };
        let text = format!(
            "{method}: line lengths are wrong by up to {:.1} %; `isomark evaluate` shows what other methods leave",
            after.max_stretch * 100.0
        );
        notices.push(Notice::warning("not-length-true", text).at_places(place));
    } else if likely > NOTABLE_STRETCH {
        let at = after.max_stretch_at;
        let length = drawn.size().max();
        let is_uncertain = after.uncertain.max_stretch > after.max_stretch / 2.0;
        let cause = Cause::of_stretch(part, map.point(at), likely, is_uncertain, length);
        let is_wrong = if is_uncertain { "may be wrong by up to" } else { "is wrong by" };
        let text = format!(
            "the length of a line near ({:.1}, {:.1}) mm of the placed drawing {is_wrong} {:.1} %: {}. {}",
            at.x,
            at.y,
            after.max_stretch * 100.0,
            cause.clause(),
            cause.remedy()
        );
        notices.push(Notice::warning("stretch-remains", text).at_places(place));
    }
}
