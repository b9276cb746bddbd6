//! The checks of a job: every reason for rejection and every warning, with its number and remedy.

use super::causes::Cause;
use super::landmarks::Lift;
use super::{
    CachedSurface, CorrectionSettings, Distortion, Exposure, Ink, JobSettings, LengthTrueMap, Method,
    PartSettings, Pattern, PatternFacts, Sku, Weighting,
};
use crate::config::{Align, Losses, OutsideMark, ViewSource, parse_facing};
use crate::formats::mesh::{NormalsUsed, PartFacts, SideFacts};
use crate::geometry::mapping::MapError;
use crate::geometry::mapping::cone::ConeError;
use crate::geometry::mapping::cylinder::CylinderError;
use crate::geometry::mapping::floater::FloaterError;
use crate::geometry::mapping::isometric::IsometricError;
use crate::geometry::mapping::mapping_domain::MappingDomainError;
use crate::geometry::mesh::TriMesh;
use crate::geometry::pattern::Shape;
use crate::geometry::primitive::Primitive;
use crate::geometry::sides::thickness_behind;
use crate::geometry::space::{Extents, Facing, FlatPoint, MarkingFrame, View, ViewPoint};
use crate::geometry::surface::fit::FitError;
use crate::reason::{Notice, Place, Reason};
use crate::report::RoundReport;

/// Uncertain length errors above this, mm, are worth a notice.
const NOTABLE_UNCERTAIN: f64 = 0.05;

/// How far a drawing may extend beyond the part, in diagonals of the part as the laser sees it: on a surface that is
/// nowhere steeper than 75 deg, no path is longer than 1 / cos 75 deg = 3.9 of them.
const FARTHEST_REACH: f64 = 4.0;
/// Maximum total length of all lines, mm: more than an hour of marking.
const LONGEST_INK: f64 = 5e6;
/// Remaining stretch above this is worth a warning.
const NOTABLE_STRETCH: f64 = 0.02;
/// The share of an uncertain stretch that is only the peak of what is possible. A warning needs what is likely.
const PEAK_ONLY: f64 = 2.0 / 3.0;
/// Ink this far outside the faces named `mark` is on their border, mm: about the width of a laser spot.
const OUTSIDE_MARK: f64 = 0.05;
/// A drawing this much askew on a cylinder or cone is worth a warning, deg.
const NOTABLE_SKEW: f64 = 0.5;
/// A marking frame this far below the surface may be meant for another place, mm.
const FRAME_INSIDE: f64 = 1.0;
/// A marking frame this far above the surface may be meant for another place, mm.
const FRAME_ABOVE: f64 = 10.0;
/// A drawing this many times as long as the part has stray lines or another unit.
const STRAY: f64 = 3.0;

/// A file was given for a part that the settings define by its sizes.
pub(super) fn part_not_needed(primitive: &Primitive) -> Reason {
    Reason::new(
        "part-not-needed",
        format!("The settings define this part as a {primitive}, so no file is read for it."),
        "Remove the file, or set `shape = \"mesh\"` in the SKU's settings to read the part from a file.",
    )
}

/// Another part was learned after the one that is to be restored.
pub(super) fn superseded(sku: &Sku, newer: &str) -> Reason {
    Reason::new(
        "newer-elsewhere",
        format!("Another station has learned a newer part for {sku}: {newer}."),
        format!("Drop {newer} here too."),
    )
}

/// Rejects ink outside the faces named `mark`, or warns of it, as the settings ask.
pub(super) fn mark_region(
    map: &LengthTrueMap,
    part: &CachedSurface,
    ink: &Ink,
    settings: &JobSettings,
) -> Result<Option<Notice>, Reason> {
    let Some(region) = &part.mark else { return Ok(None) };
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let (mut samples, mut outside, mut worst) = (0usize, 0usize, None);
    for flat in ends.chain(ink.squares.iter().chain(&ink.dots).copied()) {
        let at = map.point(flat);
        let distance = region.distance(at);
        samples += 1;
        if distance < -OUTSIDE_MARK {
            outside += 1;
            if worst.is_none_or(|(_, farthest)| distance < farthest) {
                worst = Some((at, distance));
            }
        }
    }
    let Some((at, distance)) = worst else { return Ok(None) };
    let percent = 100.0 * outside as f64 / samples as f64;
    let known = region.farthest() * 0.99;
    let by = match -distance < known {
        true => format!("up to {:.2} mm", -distance),
        false => format!("more than {known:.2} mm"),
    };
    let what = format!("{percent:.1} % of the ink is outside the faces of the part named `mark`, by {by}");
    if settings.placement.outside_mark == OutsideMark::Warn {
        let message = format!("{what}, as at ({:.2}, {:.2}) mm of the view", at.x, at.y);
        return Ok(Some(Notice::warning("outside-mark", message)));
    }
    Err(Reason::new(
        "outside-mark",
        format!("{what}."),
        "Move the drawing (`place_mm`, `--place`, the marking frame), make it smaller, or change the faces; or set \
         `outside_mark = \"warn\"` under [placement].",
    )
    .at(Place { coordinate: Some(at.coords().iter().copied().collect()), ..Place::default() })
    .with_number("ink outside", percent, "%", Some(0.0)))
}

/// Whether the marking frame in the part's file is used, where settings give another place or view.
pub(super) fn frame_of_file(of_file: Option<&MarkingFrame>, settings: &JobSettings) -> Option<Notice> {
    let frame = of_file?;
    let replaces = settings.part.facing != Facing::TOP || settings.part.roll != 0.0;
    let is_placed = settings.placement.place.is_some() && !settings.placement.is_place_given;
    let (facing, [x, y, z]) = (frame.facing().direction(), frame.origin().coords.into());
    let found = format!(
        "the part's file has a marking frame (node `isomark`) at ({x:.2}, {y:.2}, {z:.2}) mm that faces ({:.3}, {:.3}, {:.3})",
        facing.x, facing.y, facing.z
    );
    let message = match settings.part.view_source {
        ViewSource::Sides => {
            format!("{found}; it is not used, because `facing` or `roll_deg` is given for this part")
        }
        ViewSource::Frame(_) => format!("{found}; it is not used, because the settings give another `frame`"),
        ViewSource::Station | ViewSource::FrameOfFile(_) if replaces || is_placed => {
            format!("{found}; it is used instead of the station's `facing`, `roll_deg` and `place_mm`")
        }
        ViewSource::Station | ViewSource::FrameOfFile(_) => return None,
    };
    Some(Notice::note("frame-chosen", message))
}

/// Warns of a flat side that faces the laser only by default, where a curved one is probably meant.
pub(super) fn flat_side(facts: &PartFacts, settings: &PartSettings) -> Option<Notice> {
    let is_default = settings.view_source == ViewSource::Station && settings.primitive.is_none();
    let faces = |side: &&SideFacts| parse_facing(&side.side).is_ok_and(|facing| facing == settings.facing);
    let seen = facts.sides.iter().find(faces).filter(|side| is_default && !side.curved && !side.meant)?;
    let meant: Vec<&SideFacts> = facts.sides.iter().filter(|side| side.meant && side.curved).collect();
    let largest = meant.first()?;
    let names: Vec<&str> = meant.iter().map(|side| side.side.as_str()).collect();
    let message = format!(
        "the laser looks at the flat side {} of the part ({:.0} mm2 can be marked); a curved side is larger: {} ({:.0} mm2). \
         `facing` (`--facing`) names the side; `isomark inspect PART` lists all of them",
        seen.side,
        seen.area_mm2,
        names.join(", "),
        largest.area_mm2
    );
    Some(Notice::warning("flat-side", message))
}

/// Warns of a drawing that is slightly askew on a cylinder or cone, and of a surface without the axis that the settings
/// align it to.
pub(super) fn alignment(round: Option<&RoundReport>, settings: &JobSettings) -> Option<Notice> {
    let Some(round) = round else {
        return (settings.placement.align == Align::Axis).then(|| {
            let message = "`align = \"axis\"` has no effect: the surface under the drawing was not unrolled as a cylinder or cone";
            Notice::warning("align-without-axis", message)
        });
    };
    let skew = |angle: f64| angle - 90.0 * (angle / 90.0).round();
    // An angle that a person gave is meant.
    let askew = skew(round.angle_deg - settings.placement.rotate.to_degrees());
    if askew.abs() < NOTABLE_SKEW || skew(round.angle_deg).abs() < NOTABLE_SKEW {
        return None;
    }
    let [frame, by] = match settings.part.view_source.frame() {
        Some(_) => ["; it follows the marking frame", ""],
        None => ["", ", as it is horizontal in the laser's view"],
    };
    let message = format!(
        "the drawing's x is {:.2} deg off the direction round the axis of the part, or along it{by}{frame}; `align = \"axis\"` \
         (`--align axis`) turns it along the direction round the axis",
        askew.abs()
    );
    Some(match frame {
        "" => Notice::warning("drawing-askew", message),
        _ => Notice::note("drawing-askew", message),
    })
}

/// Refuses a marking frame on the surface whose z axis points into the part.
pub(super) fn frame_direction(frame: &MarkingFrame, mesh: &TriMesh) -> Result<(), Reason> {
    let Some(thickness) = thickness_behind(frame, mesh) else { return Ok(()) };
    let (origin, z): (Vec<f64>, [f64; 3]) = (frame.origin().iter().copied().collect(), frame.z().into());
    Err(Reason::new(
        "frame-into-part",
        format!(
            "The marking frame points into the part: at its origin ({:.2}, {:.2}, {:.2}) mm, its z axis ({:.3}, {:.3}, {:.3}) \
             runs through {thickness:.2} mm of the part.",
            origin[0], origin[1], origin[2], z[0], z[1], z[2]
        ),
        "Turn the frame by half a turn about its x axis, until its z axis points out of the part, to the laser.",
    )
    .at(Place { coordinate: Some(origin), ..Place::default() })
    .with_number("part behind the frame", thickness, "mm", Some(0.0)))
}

/// Mentions a marking frame that is far from the surface where the drawing lands.
pub(super) fn frame_on_surface(
    frame: &MarkingFrame,
    part: &CachedSurface,
    settings: &PartSettings,
) -> Option<Notice> {
    let at = View::new(settings.facing, settings.roll).point(frame.origin());
    let depth = part.surface.sampled_height(ViewPoint::new(at.x, at.y))? - at.z;
    let message = |distance: f64, side: &str| {
        format!(
            "the marking frame's origin is {distance:.2} mm {side} the surface that the laser sees; the drawing is placed on \
             that surface"
        )
    };
    if depth > FRAME_INSIDE {
        Some(Notice::warning("frame-inside", message(depth, "below")))
    } else {
        (-depth > FRAME_ABOVE).then(|| Notice::note("frame-above", message(-depth, "above")))
    }
}

pub(super) fn fit_reason(error: &FitError, settings: &PartSettings) -> Reason {
    let facing = settings.facing.direction();
    let side = format!("the side that faces the laser ({}, {}, {})", facing.x, facing.y, facing.z);
    match error {
        FitError::NoSurface { nodes, all, limit } => Reason::new(
            "part-without-surface",
            format!("Almost nothing of {side} can be marked."),
            "Check `facing`: it must name the side of the part that faces the laser.",
        )
        .with_number(
            "samples on the surface",
            *nodes as f64,
            &format!("of {all} below {:.0} deg", limit.to_degrees()),
            None,
        ),
        FitError::TooSmall { width, height } => Reason::new(
            "part-too-thin",
            format!("The part is too small or too thin: {width:.4} x {height:.4} mm as the laser sees it."),
            "Check the part's unit and `facing`.",
        )
        .with_number("shorter side", width.min(*height), "mm", None),
        FitError::TwoSkins(skins) => Reason::new(
            "part-two-skins",
            format!("Two surfaces of the part face the laser, one {:.3} mm behind the other.", skins.gap),
            "Remove the copy that is not meant (in Blender: Mesh, Merge by Distance, or delete the second object), and \
             export the part again.",
        )
        .at(Place { coordinate: Some(vec![skins.at.x, skins.at.y]), ..Place::default() })
        .with_number("share of the side with two surfaces", skins.share * 100.0, "%", None),
        FitError::Solve(error) => Reason::new(
            "surface-fit-failed",
            format!("No surface could be fitted to {side}: {error}."),
            "Export the part with a finer mesh, or mark another side.",
        ),
    }
}

/// The length of all lines, mm. Rejects, before any work is done, ink that is too far away to be on the part, and
/// unreasonable amounts of it.
pub(super) fn reach(
    placed: &Pattern,
    is_ink: impl Fn(&str) -> bool,
    part: &CachedSurface,
) -> Result<f64, Reason> {
    let domain = part.surface.nurbs.domain();
    let area = domain.grown(FARTHEST_REACH * domain.size().norm());
    let inked =
        placed.paths.iter().filter(|path| placed.layers.get(path.layer).is_some_and(|l| is_ink(&l.name)));
    let (mut length, mut drawn, mut far) = (0.0, Extents::EMPTY, None);
    let mut visit = |point: FlatPoint| {
        drawn.include(point.coords());
        if !area.contains(point.coords()) {
            far.get_or_insert(point);
        }
    };
    for path in inked {
        if let Shape::Dot(point) = path.shape {
            visit(point);
        }
        for segment in path.shape.segments() {
            let points = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(|t| segment.point(t));
            points.iter().for_each(|point| visit(*point));
            length += points.windows(2).map(|pair| pair[0].distance(pair[1])).sum::<f64>();
        }
    }
    if let Some(far) = far {
        return Err(off_surface(far.coords().into(), part, &drawn));
    }
    if length > LONGEST_INK {
        return Err(Reason::new(
            "too-much-ink",
            "The lines of the drawing are too long to be marked.",
            "Check the drawing's unit; fill areas with HATCH instead of single lines.",
        )
        .with_number("length of all lines", length, "mm", Some(LONGEST_INK)));
    }
    Ok(length)
}

/// Rejects a drawing with visible ink, on an ink layer, that cannot be marked, unless the settings only warn.
pub(super) fn lost_ink(facts: &PatternFacts, settings: &JobSettings) -> Result<(), Reason> {
    let lost = facts.lost_ink(|layer| settings.pattern.counts_as_ink(layer));
    let (Losses::Refuse, Some(first)) = (settings.pattern.losses, lost.0.first()) else { return Ok(()) };
    let count = lost.0.len();
    let entities = if count == 1 { "visible entity" } else { "visible entities" };
    let item = first
        .handle
        .as_ref()
        .map_or_else(|| first.entity.clone(), |handle| format!("{} {handle}", first.entity));
    Err(Reason::new(
        "ink-lost",
        format!("{count} {entities} cannot be marked: {lost}."),
        "Convert them to curves or outlines in the drawing program; hide their layer if they are not to be marked; or \
         set `losses = \"warn\"` under [pattern] (`--losses warn`) to mark the drawing without them.",
    )
    .at(Place { item: Some(item), layer: Some(first.layer.clone()), ..Place::default() })
    .with_number("entities not marked", count as f64, "", None))
}

pub(super) fn anything_inked(ink: &Ink, pattern: &Pattern, settings: &JobSettings) -> Result<(), Reason> {
    if !ink.extents.is_empty() {
        return Ok(());
    }
    let named = settings.pattern.ink_layers.clone().unwrap_or_default().join(", ");
    let layers: Vec<&str> = pattern.layers.iter().map(|layer| layer.name.as_str()).collect();
    Err(Reason::new(
        "no-ink",
        format!("The drawing has nothing on the ink layers {named}."),
        format!("Set `ink_layers` to layers of the drawing: {}.", layers.join(", ")),
    ))
}

/// Warns of ink layers that the drawing does not have: because of a typing error, a layer may not be marked.
pub(super) fn ink_layers(pattern: &Pattern, settings: &JobSettings, notices: &mut Vec<Notice>) {
    let layers: Vec<&str> = pattern.layers.iter().map(|layer| layer.name.as_str()).collect();
    let missing = settings.pattern.ink_layers_missing_in(&layers);
    if !missing.is_empty() {
        notices.push(Notice::warning(
            "ink-layer-missing",
            format!(
                "the drawing has no ink layer {}; its layers are {}",
                missing.join(", "),
                layers.join(", ")
            ),
        ));
    }
}

pub(super) fn map_reason(error: &MapError, place: FlatPoint, part: &CachedSurface, ink: &Ink) -> Reason {
    let surface = &part.surface;
    // If ink is outside the part, that is the clearer reason.
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let seen = |flat: FlatPoint| ViewPoint::from(flat.coords());
    let samples: Vec<ViewPoint> =
        ends.chain(ink.squares.iter().chain(&ink.dots).copied()).map(seen).collect();
    let beside = samples.iter().filter(|at| !surface.field.is_surface(**at)).count();
    let middle = seen(place);
    let first = samples.iter().find(|at| !surface.field.is_surface(**at));
    if let Some(at) = if surface.field.is_surface(middle) { first } else { Some(&middle) } {
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
        MapError::Isometric(error) => Reason::new(
            "map-not-found",
            format!("No length-true map was found for the drawing: {error}."),
            "Place the drawing where the part is less steep, or make it smaller.",
        ),
        MapError::Cylinder(error) => {
            let remedy = match error {
                CylinderError::TooFewPoints { .. } => PLACE_ON_PART,
                CylinderError::NoAxis { .. } => OTHER_METHOD,
                CylinderError::AnchorBeside { .. } => PLACE_ANCHOR,
            };
            Reason::new("no-cylinder", format!("The part cannot be unrolled as a cylinder: {error}."), remedy)
        }
        MapError::Cone(error) => {
            let remedy = match error {
                ConeError::TooFewPoints { .. } => PLACE_ON_PART,
                ConeError::NoApex { .. } => OTHER_METHOD,
                ConeError::AnchorBeside { .. } | ConeError::ApexInDrawing { .. } => PLACE_ANCHOR,
            };
            Reason::new("no-cone", format!("The part cannot be unrolled as a cone: {error}."), remedy)
        }
        MapError::MappingDomain(error) => {
            let remedy = match error {
                MappingDomainError::Outside { .. } => PLACE_ON_PART,
                MappingDomainError::AnchorNotMet { .. } => OTHER_METHOD,
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
                FloaterError::Unsolved { .. } => OTHER_METHOD,
            };
            Reason::new(
                "no-parametrisation",
                format!("The part cannot be mapped to a square: {error}."),
                remedy,
            )
        }
    };
    reason.at(Place { coordinate: Some(middle.coords().iter().copied().collect()), ..Place::default() })
}

const PLACE_ON_PART: &str = "Place the drawing on the part (`place_mm`, `--place`).";
const OTHER_METHOD: &str = "Use the method `auto` or `isometric` for this part.";
const PLACE_ANCHOR: &str = "Place the anchor on the cylinder or cone, away from its apex (`place_mm` or `anchor`, \
                            `--place` or `--anchor`).";

pub(super) fn above_lens(at: ViewPoint) -> Reason {
    let place = Place { coordinate: Some(at.coords().iter().copied().collect()), ..Place::default() };
    Reason::new(
        "part-above-lens",
        format!("The part is as high as the lens at ({:.3}, {:.3}) mm.", at.x, at.y),
        "Check the fixture's `z_mm` and the lens distances of the station.",
    )
    .at(place)
}

pub(super) fn off_surface(at: ViewPoint, part: &CachedSurface, drawn: &Extents) -> Reason {
    let field = &part.surface.field;
    let extents = field.extents();
    // The part ends less than a step beyond its last node.
    let around = extents.grown(field.step());
    let is_inside = [drawn.min, drawn.max].iter().all(|corner| around.contains(*corner));
    let what = match (around.contains(at.coords()), is_inside) {
        (false, _) => "The drawing extends beyond the part.",
        (true, true) => {
            "There is no surface to mark under the drawing: a hole, an edge, or a side steeper than 75 deg."
        }
        (true, false) => {
            "The drawing extends beyond the part, or there is no surface to mark under it: a hole, an edge, or a side steeper \
             than 75 deg."
        }
    };
    let sides = |extents: &Extents| (extents.max - extents.min).max();
    let unit = &part.facts.unit;
    let remedy = match sides(drawn) > STRAY * sides(&extents) {
        true if part.facts.has_doubtful_unit() => format!(
            "Check the unit of the part: its numbers are taken as {} because {} (`--part-unit`, `unit` under [part]). \
             If that is correct, check the drawing's unit, and delete stray lines far from the drawing.",
            unit.value, unit.why
        ),
        true => "Delete stray lines far from the drawing, or check its unit; `isomark inspect` shows its content."
            .to_owned(),
        false => "Move the drawing (`place_mm`, `--place`), make it smaller, or check which side of the part faces the \
                  laser (`facing`)."
            .to_owned(),
    };
    Reason::new(
        "off-surface",
        format!(
            "{what} As the laser sees it, the part spans x {} and y {} mm, the drawing x {} and y {} mm.",
            span(&extents, 0),
            span(&extents, 1),
            span(drawn, 0),
            span(drawn, 1)
        ),
        remedy,
    )
    .at(Place { coordinate: Some(at.coords().iter().copied().collect()), ..Place::default() })
}

fn span(extents: &Extents, axis: usize) -> String {
    format!("{:.1} to {:.1}", extents.min[axis], extents.max[axis])
}

/// The reason with the drawing's unit as its likely cause first, where the size of the drawing decides and its unit is in
/// doubt.
pub(super) fn doubting_unit(reason: Reason, facts: &PatternFacts) -> Reason {
    let is_by_size = matches!(
        reason.code.as_str(),
        "off-surface" | "too-much-ink" | "map-folded" | "too-steep" | "outside-field"
    );
    if !(is_by_size && facts.notices.iter().any(|notice| notice.code == "unit-pixels")) {
        return reason;
    }
    let remedy = format!(
        "Check the drawing's unit: Inkscape wrote none, and the numbers are probably pixels. Set \
         `unit_if_unitless = \"px\"` under [pattern] (`--pattern-unit px`). {}",
        reason.remedy
    );
    Reason { remedy, ..reason }
}

/// Rejects ink that cannot be marked, and adds notices for ink that should be checked.
pub(super) fn exposure(
    seen: &Exposure,
    part: &CachedSurface,
    lift: Lift,
    ink: &Ink,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let lens = settings.scan_head().lens.height();
    if seen.highest >= lens {
        return Err(above_lens(seen.highest_at).with_number(
            "height of the ink",
            seen.highest,
            "mm",
            Some(lens),
        ));
    }
    if let Some((_, at)) = seen.first_off_surface {
        let percent = 100.0 * seen.off_surface as f64 / seen.samples as f64;
        return Err(off_surface(at, part, &ink.extents).with_number(
            "ink without surface",
            percent,
            "%",
            Some(0.0),
        ));
    }
    incidence(seen, lift, settings, notices)?;
    focus(seen, settings, notices);
    field(seen, settings)?;
    doubt(seen, lift, settings, notices)?;
    residual(seen, part, lift, settings, notices)
}

fn incidence(
    seen: &Exposure,
    lift: Lift,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let limits = &settings.optics.incidence;
    let degrees = seen.steepest.to_degrees();
    let at = seen.steepest_at;
    let text =
        format!("the beam hits the part at {degrees:.1} deg to its normal at ({:.2}, {:.2}) mm", at.x, at.y);
    if seen.steepest > limits.refuse {
        let remedy = "Make the drawing narrower, place it where the part faces the laser, or turn the part.";
        let (what, remedy) = if degrees < 90.0 {
            (format!("The beam would hit the part at {degrees:.1} deg to its normal."), remedy.to_owned())
        } else {
            (
                format!(
                    "The beam cannot reach the part: the surface faces away from it, at {degrees:.1} deg to its normal."
                ),
                format!("Check the lens distances of the station and the fixture's `z_mm`. {remedy}"),
            )
        };
        return Err(Reason::new("too-steep", what, remedy)
            .at(Place { coordinate: Some(vec![at.x, at.y]), ..Place::default() })
            .with_number("incidence angle", degrees, "deg", Some(limits.refuse.to_degrees())));
    }
    if seen.steepest > limits.warn {
        let text = format!("{text}; marks are paler and wider there");
        notices.push(Notice::warning("steep", text).at_places(lift.point(at)));
    } else if seen.steepest > limits.note {
        notices.push(Notice::note("inclined", text).at_places(lift.point(at)));
    }
    Ok(())
}

fn focus(seen: &Exposure, settings: &JobSettings, notices: &mut Vec<Notice>) {
    let (range, best) = (seen.highest - seen.lowest, (seen.highest + seen.lowest) / 2.0);
    if let Some(depth) = settings.optics.focus_depth.filter(|depth| range > *depth) {
        notices.push(Notice::warning(
            "out-of-focus",
            format!(
                "the ink spans {range:.2} mm of height, but the depth of focus is only {depth:.2} mm; focus at z = \
                 {best:.2} mm for the least blur"
            ),
        ));
    }
}

fn field(seen: &Exposure, settings: &JobSettings) -> Result<(), Reason> {
    let Some(field) = settings.field else { return Ok(()) };
    let area = field.extents();
    if area.contains(seen.field.min) && area.contains(seen.field.max) {
        return Ok(());
    }
    let beyond = (area.min - seen.field.min).sup(&(seen.field.max - area.max)).max();
    let (drawn, there) = (seen.field.size(), area.size());
    // Without a lens model the drawing moves with the part; through a lens, nearly so.
    let shift = area.center() - seen.field.center();
    let [x, y] = [settings.fixture.x + shift.x, settings.fixture.y + shift.y]
        .map(|value| (value * 10.0).round() / 10.0 + 0.0);
    let fits = drawn.x <= there.x && drawn.y <= there.y;
    let remedy = match fits {
        true => format!(
            "Move the drawing (`place_mm`, `--place`), or move the part: `x_mm = {x:.1}` and `y_mm = {y:.1}` under [fixture] put \
             the drawing into the middle of the field."
        ),
        false => format!(
            "Make the drawing smaller: it is {:.1} x {:.1} mm in the field, which has {:.1} x {:.1} mm.",
            drawn.x, drawn.y, there.x, there.y
        ),
    };
    Err(Reason::new(
        "outside-field",
        format!(
            "The corrected drawing is not inside the field: it spans x {} and y {} mm, the field x {} and y {} mm.",
            span(&seen.field, 0),
            span(&seen.field, 1),
            span(&area, 0),
            span(&area, 1)
        ),
        remedy,
    )
    .with_number("overhang", beyond, "mm", Some(0.0)))
}

/// Checks for normals that contradict the facets: then the shape of the part between its vertices is not known.
fn doubt(
    seen: &Exposure,
    lift: Lift,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let (largest, limit) = (seen.max_doubt, settings.correction.max_residual);
    let at = seen.max_doubt_at;
    if largest > limit {
        return Err(Reason::new(
            "normals-contradict-facets",
            "Under the drawing, the part's normals contradict its facets, as with smooth shading next to a flat side. \
             The surface between the vertices is not known accurately enough.",
            "Export the part from CAD with its own normals or with a smaller deviation; in Blender, use a finer bevel \
             or flat shading; or raise `max_residual_mm`.",
        )
        .at(Place { coordinate: Some(vec![at.x, at.y]), ..Place::default() })
        .with_number("uncertainty of the height", largest, "mm", Some(limit)));
    }
    if largest > limit / 5.0 {
        let text = format!(
            "the part's normals contradict its facets: near ({:.1}, {:.1}) mm its surface may be wrong by \
             {largest:.3} mm; export it with a smaller deviation",
            at.x, at.y
        );
        notices.push(Notice::warning("normals-contradict-facets", text).at_places(lift.point(at)));
    }
    Ok(())
}

fn residual(
    seen: &Exposure,
    part: &CachedSurface,
    lift: Lift,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let (largest, limit) = (seen.max_difference, settings.correction.max_residual);
    let at = seen.max_difference_at;
    if largest <= limit / 5.0 {
        return Ok(());
    }
    let cause = Cause::of_misfit(part, at);
    if largest > limit {
        return Err(Reason::new(
            "surface-not-met",
            format!("The fitted surface does not match the part under the drawing: {}.", cause.clause()),
            format!("{} Or raise `max_residual_mm`.", cause.remedy()),
        )
        .at(Place { coordinate: Some(vec![at.x, at.y]), ..Place::default() })
        .with_number("distance to the part", largest, "mm", Some(limit)));
    }
    let text = format!(
        "the fitted surface is up to {largest:.4} mm from the part under the ink, near ({:.1}, {:.1}) mm (up to {:.4} mm on the whole \
         side): {}. {}",
        at.x,
        at.y,
        part.surface.residual.max,
        cause.clause(),
        cause.remedy()
    );
    notices.push(Notice::warning("surface-loose", text).at_places(lift.point(at)));
    Ok(())
}

/// Usual maximum number of steps of the length-true map on smooth parts.
const USUAL_STEPS: usize = 6;

/// Logs a length-true map that took many steps, and warns if its search did not converge or if weights have no effect.
pub(super) fn settled(sku: &Sku, map: &LengthTrueMap, settings: &JobSettings, notices: &mut Vec<Notice>) {
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
    let CorrectionSettings { weighting, length_weight, angle_weight, .. } = settings.correction;
    if weighting == Weighting::Uniform && (length_weight, angle_weight) != (1.0, 1.0) {
        notices.push(Notice::warning(
            "weights-unused",
            format!(
                "the length weight of {length_weight} and the angle weight of {angle_weight} have no effect with the \
                 weighting `uniform`; they apply to `ink`"
            ),
        ));
    }
}

/// Warns if the part does not match the requested cylinder or cone.
pub(super) fn unrolled(map: &LengthTrueMap, notices: &mut Vec<Notice>) {
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

/// Adds a notice if most of the reported length error is what the facets leave uncertain.
pub(super) fn uncertain(after: &Distortion, facts: &PartFacts, notices: &mut Vec<Notice>) {
    let uncertain = &after.uncertain;
    if uncertain.length_error > NOTABLE_UNCERTAIN && uncertain.length_error > after.length_error / 2.0 {
        let (cause, remedy) = match (&facts.scan, facts.normals_used) {
            (Some(_), _) => ("the points of the scan scatter", "scan with less noise or more points"),
            (_, Some(NormalsUsed::File)) => {
                ("the part's facets are coarse", "export the part with a deviation of at most 0.05 mm")
            }
            _ => (
                "the part's facets are coarse",
                "export the part as glTF from CAD with its normals, or with a deviation of at most 0.05 mm",
            ),
        };
        notices.push(Notice::warning(
            "facets-coarse",
            format!(
                "{:.3} mm of the reported length error of {:.3} mm is uncertain, because {cause}: under the drawing the \
                 surface may be wrong by {:.3} mm and {:.2} degrees; {remedy}",
                uncertain.length_error,
                after.length_error,
                uncertain.max_height,
                uncertain.max_slope.to_degrees()
            ),
        ));
    }
}

/// Warns of errors that even the best map leaves, and of maps that are only for comparison.
pub(super) fn quality(
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
        let text = format!(
            "this method is only for comparison: line lengths are wrong by up to {:.1} %, and `auto` keeps them \
             better",
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
