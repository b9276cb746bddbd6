//! The checks of a job: every reason for rejection and every warning, with its number and remedy.

mod exposure;
mod lines;
mod map;
mod rotary;

pub(super) use exposure::{exposure, hidden, on_surface, outside_lens_table};
pub(super) use lines::close_lines;
pub(super) use map::{distances, map_reason, notices_of_part, quality, settled, traded, uncertain, unrolled};

pub(super) use rotary::{
    not_round, rotary_count, rotary_hollow, rotary_method, rotary_no_room, rotary_overlap, wider_than_round,
};

use nalgebra::Vector2;

use super::{CachedSurface, Ink, JobSettings, LengthTrueMap, PartSettings, Pattern, PatternFacts, Sku};
use crate::config::{Align, Losses, OutsideMark, ViewSource, parse_facing};
use crate::formats::mesh::{PartFacts, ScanFacts, SideFacts};
use crate::geometry::mesh::TriMesh;
use crate::geometry::normal_equations::SolveError;
use crate::geometry::optics::Lens;
use crate::geometry::pattern::Shape;
use crate::geometry::primitive::Primitive;
use crate::geometry::sides::thickness_behind;
use crate::geometry::space::{Extents, Facing, FlatPoint, MarkingFrame, ViewPoint};
use crate::geometry::surface::fit::FitError;
use crate::reason::{Notice, Place, Reason};
use crate::report::RoundReport;

/// How far a drawing may extend beyond the part, in diagonals of the part as the laser sees it: on a surface that is
/// nowhere steeper than 75 deg, no path is longer than 1 / cos 75 deg = 3.9 of them.
const FARTHEST_REACH: f64 = 4.0;
/// Maximum total length of all lines, mm: more than an hour of marking.
const LONGEST_INK: f64 = 5e6;
/// Ink this far outside the faces named `mark` is on their border, mm: about the width of a laser spot.
const OUTSIDE_MARK: f64 = 0.05;
/// A drawing this much askew on a cylinder or cone is worth a warning, deg.
const NOTABLE_SKEW: f64 = 0.5;
/// A marking frame this far below the surface may be meant for another place, mm.
const FRAME_INSIDE: f64 = 1.0;
/// A marking frame this far above the surface may be meant for another place, mm.
const FRAME_ABOVE: f64 = 10.0;
/// A share of the points of a scan above this is mentioned if it was dropped and there is no surface under the drawing.
const NOTABLE_DROPPED: f64 = 0.005;
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

/// Steps between the last nodes on a part and its rim, at most; the steep side of a rim has no nodes.
const RIM_STEPS: f64 = 4.0;

/// Another part was learned after the one that is to be restored.
pub(super) fn superseded(sku: &Sku, newer: &str) -> Reason {
    Reason::new(
        "newer-elsewhere",
        format!("Another station has fitted a newer part for SKU `{sku}`: {newer}."),
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

/// Mentions outlines that nothing fills round places that cannot be marked.
pub(super) fn open_areas(places: &[FlatPoint], map: &LengthTrueMap) -> Notice {
    let first = places.first().map_or(ViewPoint::new(0.0, 0.0), |at| map.point(*at));
    let outlines = match places.len() {
        1 => "an outline that nothing fills encloses a place".to_owned(),
        count => format!("outlines that nothing fills enclose {count} places"),
    };
    let message = format!(
        "{outlines} that cannot be marked (a hole, an edge or a steep side), as at ({:.2}, {:.2}) mm; such outlines are only          lines, and what they enclose does not count as an area. Do not fill them in the marking program",
        first.x, first.y
    );
    Notice::note("outline-only", message)
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
            format!("{found}; it is not used, because `facing` is given for this part")
        }
        // A roll names no side, so the side that faces the laser may not be the intended one.
        ViewSource::Rolled => {
            let [x, y, z] = settings.part.facing.direction().into();
            let message = format!(
                "{found}; it is not used, because `roll_deg` is given for this part: the laser looks at the side ({x:.3}, {y:.3}, \
                 {z:.3}). Give `facing` with `roll_deg`, or turn the drawing with `rotate_deg` in the frame"
            );
            return Some(Notice::warning("frame-chosen", message));
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
    let is_unnamed = matches!(settings.view_source, ViewSource::Station | ViewSource::Rolled);
    let is_default = is_unnamed && settings.primitive.is_none();
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
        "the drawing is turned {:.2} deg from the axis of the part, or from the direction round it{by}{frame}; set `align = \"axis\"` \
         (`--align axis`) to align it with the part",
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

/// How far the origin of a marking frame is under the surface that the laser sees, mm; 0 beside it.
pub(super) fn depth_of(frame: &MarkingFrame, part: &CachedSurface, settings: &PartSettings) -> f64 {
    let at = settings.view().point(frame.origin());
    part.surface.sampled_height(ViewPoint::new(at.x, at.y)).map_or(0.0, |height| height - at.z)
}

/// Mentions a marking frame that is far from the surface where the drawing lands.
pub(super) fn frame_on_surface(
    frame: &MarkingFrame,
    part: &CachedSurface,
    settings: &PartSettings,
) -> Option<Notice> {
    let depth = depth_of(frame, part, settings);
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
        FitError::Solve(error) => {
            let (why, remedy) = unsolved(error, "Export the part with a finer mesh, or mark another side.");
            Reason::new("surface-fit-failed", format!("No surface could be fitted to {side}: {why}."), remedy)
        }
        _ => Reason::new(
            "surface-fit-failed",
            format!("No surface could be fitted to {side}: {error}."),
            "Export the part with a finer mesh, or mark another side.",
        ),
    }
}

/// Why equations could not be solved, for people, and what helps; `remedy` is that for a part that is too rough.
fn unsolved<'r>(error: &SolveError, remedy: &'r str) -> (&'static str, &'r str) {
    match error {
        SolveError::OutOfMemory { .. } => (
            "there is not enough memory",
            "Close other programs, or use a computer with more memory. A smaller drawing and a coarser part need less.",
        ),
        _ => ("too little of it is smooth, or it is broken up by edges, steps and damaged facets", remedy),
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

/// No map stretches a drawing by more than this factor before it is refused for another reason.
const MOST_STRETCHED: f64 = 1.25;

/// Rejects, before it is sampled, a drawing that cannot reach the part from the place of its anchor: the laser sees no line longer
/// than it is.
pub(super) fn beside_part(
    placed: &Pattern,
    is_ink: impl Fn(&str) -> bool,
    place: FlatPoint,
    part: &CachedSurface,
) -> Result<(), Reason> {
    let field = &part.surface.field;
    let seen = ViewPoint::from(place.coords());
    if field.is_surface(seen) {
        return Ok(());
    }
    let inked =
        placed.paths.iter().filter(|path| placed.layers.get(path.layer).is_some_and(|l| is_ink(&l.name)));
    let mut drawn = Extents::EMPTY;
    for Extents { min, max } in inked.map(|path| path.shape.extents()).filter(|extents| !extents.is_empty()) {
        drawn.include(min);
        drawn.include(max);
    }
    if drawn.is_empty() {
        return Ok(());
    }
    let farthest = (drawn.max - place.coords()).sup(&(place.coords() - drawn.min)).norm();
    if field.has_surface_near(seen, MOST_STRETCHED * farthest + 2.0 * field.step()) {
        return Ok(());
    }
    Err(off_surface(seen, part, &drawn).with_number("ink without surface", 100.0, "%", Some(0.0)))
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

/// No beam reaches a point of the part.
pub(super) fn not_reached(at: ViewPoint, settings: &JobSettings) -> Reason {
    match settings.optics.lens {
        Lens::Measured(_) => outside_lens_table(),
        Lens::Telecentric | Lens::Perspective { .. } => above_lens(at),
    }
}

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
            "There is no surface to mark under the drawing: a hole, an edge, or a side too steep to be measured (over 75 deg)."
        }
        (true, false) => {
            "The drawing extends beyond the part, or there is no surface to mark under it: a hole, an edge, or a side too \
             steep to be measured (over 75 deg)."
        }
    };
    let seen = seen_extents(part, &extents, field.step());
    let sides = |extents: &Extents| (extents.max - extents.min).max();
    let unit = &part.facts.unit;
    let remedy = match sides(drawn) > STRAY * sides(&extents) {
        true if part.facts.has_doubtful_unit() => format!(
            "Check the unit of the part: its numbers are read as {} because {} (`--part-unit`, `unit` under [part]). \
             If that is correct, check the drawing's unit, and delete stray lines far from the drawing.",
            unit.value, unit.why
        ),
        true => "Delete stray lines far from the drawing, or check its unit; `isomark inspect` shows its content."
            .to_owned(),
        false if part.facts.scan.is_some() && around.contains(at.coords()) => {
            "Move the drawing (`place_mm`, `--place`), or, if only points are missing there, bridge the gap: `bridge_mm` under [part] \
             (`--bridge`) is the width of the widest gap that is bridged."
                .to_owned()
        }
        false => "Move the drawing (`place_mm`, `--place`), make it smaller, or check which side of the part faces the \
                  laser (`facing`)."
            .to_owned(),
    };
    let dropped = |scan: &&ScanFacts| scan.dropped as f64 > NOTABLE_DROPPED * scan.points as f64;
    let remedy = match part.facts.scan.as_ref().filter(dropped) {
        Some(ScanFacts { points, dropped, .. }) => format!(
            "{remedy} {dropped} of {points} points of the scan were dropped as outliers or strays: if the part is where they are, scan \
             it again with points there that are as close as elsewhere."
        ),
        None => remedy,
    };
    Reason::new(
        "off-surface",
        format!(
            "{what} As the laser sees it, the part spans x {} and y {} mm, the drawing x {} and y {} mm.",
            span(&seen, 0),
            span(&seen, 1),
            span(drawn, 0),
            span(drawn, 1)
        ),
        remedy,
    )
    .at(Place { coordinate: Some(at.coords().iter().copied().collect()), ..Place::default() })
}

/// The extents of the part as the laser sees it, from those of the `nodes` on it, which end a few steps before it does: those of
/// the side that is seen, if they are known; otherwise symmetric, if they may be.
fn seen_extents(part: &CachedSurface, nodes: &Extents, step: f64) -> Extents {
    // How far the extents are beyond the nodes; negative where they end before.
    let beyond = |seen: &Extents| {
        let sides = [nodes.min - seen.min, seen.max - nodes.max];
        (sides[0].min().min(sides[1].min()), sides[0].max().max(sides[1].max()))
    };
    // The sides are seen without a roll; with one, mostly by quarter turns.
    let sides = part.facts.sides.iter().flat_map(|side| {
        let [left, bottom, right, top] = side.extents_mm;
        [
            [left, bottom, right, top],
            [-top, left, -bottom, right],
            [-right, -top, -left, -bottom],
            [bottom, -right, top, -left],
        ]
        .map(|[left, bottom, right, top]| Extents {
            min: Vector2::new(left, bottom),
            max: Vector2::new(right, top),
        })
    });
    let near = sides.map(|seen| (seen, beyond(&seen)));
    let near = near.filter(|(_, (least, most))| *least > -step * 1e-6 && *most < RIM_STEPS * step);
    if let Some((seen, _)) = near.min_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b)) {
        return seen;
    }
    let mut seen = *nodes;
    for axis in 0..2 {
        let reach = nodes.min[axis].abs().max(nodes.max[axis].abs());
        if reach + nodes.min[axis] < step && reach - nodes.max[axis] < step {
            (seen.min[axis], seen.max[axis]) = (-reach, reach);
        }
    }
    seen
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::mesh::{self, MeshFormat, MeshOptions};
    use crate::geometry::mapping::quality;

    /// STEP files have no facets, and no deviation to export them with.
    #[test]
    fn what_samples_of_exact_faces_leave_open_is_not_blamed_on_facets() {
        let facts_of = |bytes: &[u8], format| {
            mesh::read(bytes, format, &MeshOptions::default(), &std::collections::BTreeMap::new())
                .unwrap()
                .facts
        };
        let step = include_bytes!("../../tests/data/parts/step/barrel.step");
        let glb = include_bytes!("../../tests/data/parts/can/fc020-coarse.glb");
        let ink = Ink::sample(&Pattern::default(), |_| true, 1.0, 1.0);
        let flat = |at: FlatPoint| ViewPoint::new(at.x, at.y);
        let mut after = quality::measure(&ink, flat, |_| Some(0.0)).unwrap();
        (after.length, after.length_error) = (187.6, 0.173);
        (after.uncertain.length_error, after.uncertain.max_slope) = (0.160, 0.06);
        let warning = |facts: &PartFacts| {
            let mut notices = Vec::new();
            uncertain(&after, facts, 0.25, &mut notices).unwrap();
            notices.pop().unwrap().message
        };
        let of_step = warning(&facts_of(step, MeshFormat::Step));
        assert!(of_step.contains("within a few samples, which are 0.25 mm apart"), "{of_step}");
        assert!(!of_step.contains("facets") && !of_step.contains("deviation"), "{of_step}");
        let of_glb = warning(&facts_of(glb, MeshFormat::Glb));
        assert!(of_glb.contains("facets are coarse") && of_glb.contains("a smaller deviation"), "{of_glb}");
        after.uncertain.length_error = 100.0;
        let refused =
            uncertain(&after, &facts_of(step, MeshFormat::Step), 0.25, &mut Vec::new()).unwrap_err();
        let text = format!("{} {}", refused.what, refused.remedy);
        assert!(text.contains("a few samples") && !text.contains("deviation"), "{text}");
    }

    #[test]
    fn equations_without_a_solution_are_explained_without_their_number() {
        for (error, cause, remedy) in [
            (SolveError::NotPositiveDefinite { unknowns: 648 }, "too little of it is smooth", "finer mesh"),
            (SolveError::Inaccurate { unknowns: 648, residual: 0.1 }, "damaged facets", "finer mesh"),
            (SolveError::OutOfMemory { unknowns: 648 }, "not enough memory", "more memory"),
        ] {
            let reason = fit_reason(&FitError::Solve(error), &PartSettings::default());
            assert!(reason.what.contains(cause) && reason.remedy.contains(remedy), "{reason:?}");
            assert!(!reason.what.contains("648") && !reason.what.contains("unknowns"), "{reason:?}");
        }
    }
}
