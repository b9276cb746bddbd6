//! What the laser does to the corrected ink: incidence, focus, field, and what is known of the surface under it.

use super::{above_lens, off_surface, span};
use crate::config::FocusSteps;
use crate::formats::mesh::NormalsChoice;
use crate::geometry::correction::Projection;
use crate::geometry::space::{Extents, ViewPoint};
use crate::pipeline::causes::Cause;
use crate::pipeline::landmarks::Lift;
use crate::pipeline::{CachedSurface, Exposure, Ink, JobSettings};
use crate::reason::{Notice, Place, Reason};
use crate::report::LensTableReport;

/// Rejects ink that cannot be marked, and adds notices for ink that should be checked.
pub(in crate::pipeline) fn exposure(
    seen: &Exposure,
    projection: &Projection<'_>,
    part: &CachedSurface,
    lift: Lift,
    ink: &Ink,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(), Reason> {
    let lens = projection.head.lens.height();
    if seen.highest >= lens {
        return Err(above_lens(seen.highest_at).with_number(
            "height of the ink",
            seen.highest,
            "mm",
            Some(lens),
        ));
    }
    measured_lens(seen, settings, notices)?;
    incidence(seen, lift, settings, notices)?;
    focus(seen, settings, notices);
    field(seen, projection, ink, settings)?;
    doubt(seen, lift, settings, notices)?;
    residual(seen, part, lift, settings, notices)
}

/// Rejects a drawing with these extents if some of its ink is not on the surface. `whole` is the whole part;
/// the drawing may need only a piece of it.
pub(in crate::pipeline) fn on_surface(
    seen: &Exposure,
    whole: &CachedSurface,
    drawn: &Extents,
) -> Result<(), Reason> {
    let Some((_, at)) = seen.first_off_surface else { return Ok(()) };
    let percent = 100.0 * seen.off_surface as f64 / seen.samples as f64;
    Err(off_surface(at, whole, drawn).with_number("ink without surface", percent, "%", Some(0.0)))
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

/// Rejects ink in the shadow of another part of the body.
pub(in crate::pipeline) fn hidden(
    projection: &Projection<'_>,
    ink: &Ink,
    part: &CachedSurface,
    settings: &JobSettings,
    lift: Lift,
) -> Result<(), Reason> {
    let limit = settings.optics.shadow;
    let Some(hidden) = projection.hidden(ink, &part.surface.field, limit) else { return Ok(()) };
    let at = |place: ViewPoint| match lift.point(place) {
        Some([x, y, z]) => format!("({x:.2}, {y:.2}, {z:.2}) mm of the part"),
        None => format!("({:.2}, {:.2}) mm of the view", place.x, place.y),
    };
    Err(Reason::new(
        "ink-hidden",
        format!(
            "{:.1} % of the ink is in the shadow of another part of the body: at {} the beam is blocked by what is at {}.",
            100.0 * hidden.share,
            at(hidden.at),
            at(hidden.behind)
        ),
        "Move the drawing (`place_mm`, `--place`) away from the step, move the part towards the lens axis (`x_mm`, `y_mm` under \
         [fixture]), or turn the part. `shadow_mm` under [optics] is the limit.",
    )
    .at(Place { coordinate: Some(vec![hidden.at.x, hidden.at.y]), ..Place::default() })
    .with_number("height above the beam", hidden.rises, "mm", Some(limit)))
}

fn focus(seen: &Exposure, settings: &JobSettings, notices: &mut Vec<Notice>) {
    let (whole, best) = (seen.highest - seen.lowest, (seen.highest + seen.lowest) / 2.0);
    // Each step has its own focus.
    let step = settings.focus.step.or(settings.optics.focus_depth);
    let step = step.filter(|_| settings.focus.steps != FocusSteps::Off);
    let range = step.map_or(whole, |step| whole.min(step));
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

/// Rejects a drawing that uses beams far outside the lens table, and warns of heights far outside its heights and of a table
/// whose beams are not known well.
fn measured_lens(seen: &Exposure, settings: &JobSettings, notices: &mut Vec<Notice>) -> Result<(), Reason> {
    let Some(lens) = settings.optics.lens.measured() else { return Ok(()) };
    notices.extend(LensTableReport::from(lens.residuals()).notice());
    let known = lens.known_area();
    if !known.contains(seen.field.min) || !known.contains(seen.field.max) {
        let beyond = (known.min - seen.field.min).sup(&(seen.field.max - known.max)).max();
        return Err(outside_lens_table().with_number("beyond the known beams", beyond, "mm", Some(0.0)));
    }
    let [low, high] = lens.heights();
    let beyond = (low - seen.lowest).max(seen.highest - high);
    if beyond > (high - low) / 2.0 {
        notices.push(Notice::warning(
            "outside-lens-table",
            format!(
                "the ink is at heights from {:.1} to {:.1} mm, up to {beyond:.1} mm outside those of the lens table, {low:.1} to \
                 {high:.1} mm; errors of the measurements grow with this distance",
                seen.lowest, seen.highest
            ),
        ));
    }
    Ok(())
}

/// A drawing uses beams that were not measured.
pub(in crate::pipeline) fn outside_lens_table() -> Reason {
    Reason::new(
        "outside-lens-table",
        "The corrected drawing reaches beyond the part of the field in which the lens table has measurements.",
        "Move the part or the drawing towards the middle of the field, or measure crosses up to the border of the field and add them \
         to the table.",
    )
}

fn field(
    seen: &Exposure,
    projection: &Projection<'_>,
    ink: &Ink,
    settings: &JobSettings,
) -> Result<(), Reason> {
    let Some(field) = settings.field else { return Ok(()) };
    let area = field.extents();
    if area.contains(seen.field.min) && area.contains(seen.field.max) {
        return Ok(());
    }
    let beyond = (area.min - seen.field.min).sup(&(seen.field.max - area.max)).max();
    let (drawn, there) = (seen.field.size(), area.size());
    let remedy = if drawn.x <= there.x && drawn.y <= there.y {
        // The lens magnifies what is high, so a drawing does not move by exactly as much as the part.
        let centred = projection.centred(ink, area.center().into());
        let advice = centred.map_or(String::new(), |fixture| {
            let [x, y] = [fixture.x, fixture.y].map(|value| (value * 10.0).round() / 10.0 + 0.0);
            format!(
                ": with `x_mm = {x:.1}` and `y_mm = {y:.1}` under [fixture] the drawing is in the middle of the field"
            )
        });
        format!(
            "Move the drawing (`place_mm`, `--place`), or move the part and enter its new position{advice}."
        )
    } else if drawn.y <= there.x && drawn.x <= there.y {
        "Turn the part or the drawing by 90 deg: then the drawing fits into the field.".to_owned()
    } else {
        let share = (there.x / drawn.x).min(there.y / drawn.y) * 100.0;
        format!(
            "Make the drawing smaller, to at most {:.0} %: in the field it is {:.1} x {:.1} mm, and the field has {:.1} x {:.1} mm.",
            share.floor(),
            drawn.x,
            drawn.y,
            there.x,
            there.y
        )
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
        let estimate = match settings.part.normals {
            NormalsChoice::Estimate => "",
            _ => {
                "set `normals = \"estimate\"` under [part] (`--normals estimate`), which estimates the normals from the facets; "
            }
        };
        return Err(Reason::new(
            "normals-contradict-facets",
            "Under the drawing, the part's normals contradict its facets, as with smooth shading next to a flat side. \
             The surface between the vertices is not known accurately enough.",
            format!(
                "Export the part from CAD with its own normals or with a smaller deviation; {estimate}in Blender, use a finer \
                 bevel or flat shading; or raise `max_residual_mm`."
            ),
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
            format!(
                "{} Raise `max_residual_mm` only if the mark may be wrong there by about this distance.",
                cause.remedy()
            ),
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
