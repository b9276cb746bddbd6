//! Why a drawing cannot go round a part.

use std::ops::RangeInclusive;

use crate::config::Method;
use crate::reason::Reason;

/// The part is neither a cylinder nor a cone.
pub(in crate::pipeline) fn not_round(residual: Option<f64>, limit: f64) -> Reason {
    let reason = Reason::new(
        "rotary-not-round",
        "A mark in tiles needs a cylinder or cone, and the part under the drawing is neither.",
        "Check `facing`: the round side must face the laser. If the part is a cylinder or cone, give its sizes (`shape`, \
         `--cylinder`, `--cone`) or set `method = \"cylinder\"` or `\"cone\"`; otherwise set `tiles = \"off\"` under [rotary].",
    );
    match residual {
        Some(residual) => {
            reason.with_number("distance from the best cylinder or cone", residual, "mm", Some(limit))
        }
        None => reason,
    }
}

pub(in crate::pipeline) fn rotary_hollow() -> Reason {
    Reason::new(
        "rotary-hollow",
        "The laser looks at the inside of a hollow cylinder or cone; turned, its outside would be in the way.",
        "Check `facing`, or set `tiles = \"off\"` under [rotary].",
    )
}

pub(in crate::pipeline) fn rotary_method(method: Method) -> Reason {
    Reason::new(
        "rotary-method",
        format!("Tiles need an exact unrolling, and the method `{method}` has none."),
        "Set `method` to \"auto\", \"cylinder\" or \"cone\", or set `tiles = \"off\"` under [rotary].",
    )
}

/// The laser can mark hardly anything between two turns of the part.
pub(in crate::pipeline) fn rotary_no_room(widest: f64) -> Reason {
    Reason::new(
        "rotary-no-room",
        "The laser can mark hardly anything of the part between two turns.",
        "Move the part nearer to the lens axis ([fixture]), or check the limits: `incidence_refuse_deg` and `focus_depth_mm` \
         under [optics], and [field].",
    )
    .with_number("widest tile", widest.to_degrees(), "deg", Some(0.5))
}

/// The drawing would meet itself.
pub(in crate::pipeline) fn wider_than_round(width: f64, radius: f64) -> Reason {
    let round = std::f64::consts::TAU * radius;
    let share = std::f64::consts::TAU / width * 100.0;
    Reason::new(
        "rotary-too-wide",
        format!("The drawing is longer than the circumference of the part: it spans {:.2} deg about the axis.", width.to_degrees()),
        format!(
            "Make the drawing narrower, to at most {:.2} %; or check its unit and the part's diameter ({:.3} mm).",
            (share * 100.0).floor() / 100.0,
            2.0 * radius
        ),
    )
    .with_number("width of the drawing", width * radius, "mm", Some(round))
}

/// Two tiles would overlap by most of their width.
pub(in crate::pipeline) fn rotary_overlap(overlap: f64, widest: f64) -> Reason {
    Reason::new(
        "rotary-overlap",
        format!("The overlap is too wide for tiles that are at most {widest:.3} mm wide."),
        format!(
            "Set `overlap_mm` under [rotary] to less than {:.3}.",
            (widest / 2.0 * 1000.0).floor() / 1000.0
        ),
    )
    .with_number("overlap", overlap, "mm", Some(widest / 2.0))
}

/// The drawing cannot be divided into this many tiles. Limits are the narrowest piece of a contour and the widest tile, rad.
pub(in crate::pipeline) fn rotary_count(
    count: Option<usize>,
    possible: Option<RangeInclusive<usize>>,
    limits: [f64; 2],
) -> Reason {
    let [narrowest, widest] = limits.map(f64::to_degrees);
    let needed = match (count, possible) {
        (Some(count), Some(possible)) => Some(count.clamp(*possible.start(), *possible.end())),
        _ => None,
    };
    let (what, remedy) = match (count, needed) {
        (Some(count), Some(needed)) if count < needed => (
            format!(
                "{count} tiles are too few: the laser marks at most {widest:.2} deg of the part between two turns."
            ),
            format!("Set `tiles` under [rotary] to at least {needed}, or to \"auto\"."),
        ),
        (Some(count), Some(needed)) if count > needed => (
            format!(
                "{count} tiles are too many: contours are not cut into pieces narrower than {narrowest:.2} deg, and gaps have no ink."
            ),
            format!("Set `tiles` under [rotary] to at most {needed}, or to \"auto\"."),
        ),
        (Some(count), _) => (
            format!("The drawing cannot be divided into {count} tiles with ink in each."),
            "Set `tiles` under [rotary] to a smaller number, or to \"auto\".".to_owned(),
        ),
        (None, _) => (
            format!("The drawing cannot be divided into tiles of at most {widest:.2} deg."),
            "Make `max_tile_deg` under [rotary] larger or `overlap_mm` smaller.".to_owned(),
        ),
    };
    let reason = Reason::new("rotary-tiles", what, remedy);
    match (count, needed) {
        (Some(count), Some(needed)) => reason.with_number("tiles", count as f64, "", Some(needed as f64)),
        _ => reason,
    }
}
