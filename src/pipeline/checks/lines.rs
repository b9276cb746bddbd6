//! Lines that are marked twice, or closer together than the laser can separate.

use crate::config::JobSettings;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::LengthTrueMap;
use crate::pipeline::landmarks::Lift;
use crate::reason::Notice;

/// Warns of lines on lines, and of lines closer together than the spot is wide.
pub(in crate::pipeline) fn close_lines(
    ink: &Ink,
    map: &LengthTrueMap,
    settings: &JobSettings,
    lift: Lift,
) -> Vec<Notice> {
    let found = ink.close_lines(settings.optics.spot.unwrap_or(0.0));
    let mut notices = Vec::new();
    if let Some(at) = found.twice_at.filter(|_| found.twice > settings.pattern.overlap) {
        let text = format!(
            "{:.2} mm of lines are on other lines and are marked twice, first near ({:.2}, {:.2}) mm of the placed drawing; \
             remove the copies, or join shapes that share an edge",
            found.twice, at.x, at.y
        );
        notices.push(Notice::warning("marked-twice", text).at_places(lift.point(map.point(at))));
    }
    if let Some((distance, at)) = found.finest {
        let spot = settings.optics.spot.unwrap_or_default();
        let text = format!(
            "lines are {distance:.3} mm apart near ({:.2}, {:.2}) mm of the placed drawing, and the spot is {spot:.3} mm wide \
             (`spot_mm`): they merge; draw them farther apart or as one line",
            at.x, at.y
        );
        notices.push(Notice::warning("finer-than-spot", text).at_places(lift.point(map.point(at))));
    }
    notices
}
