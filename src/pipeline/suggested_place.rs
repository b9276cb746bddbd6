//! Where a drawing that misses the part would be on it.

use nalgebra::Vector2;

use super::fill;
use super::map_method::method;
use super::mapped_ink::MappedInk;
use crate::cache::CachedSurface;
use crate::config::{Align, Anchor, JobSettings, Tiles};
use crate::cores::Cores;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::quality;
use crate::geometry::pattern::{Affine, Pattern};
use crate::geometry::space::FlatPoint;
use crate::reason::Reason;

/// Number of steps across a drawing at which its place on the part is tested.
const PLACE_SAMPLES: u32 = 8;
/// Places of these that may be beside the part: a drawing may leave a hole free.
const MOST_OFF: usize = 16;
/// A drawing within this of a place is there already, mm.
const SAME_PLACE: f64 = 1e-3;
/// How far from zero the corner of a page may be, mm.
const PAGE_CORNER: f64 = 1e-6;

/// The reason with a place for the drawing first, where it misses the part because it was drawn elsewhere, as from the corner
/// of a page, and would be on the part there.
pub(super) fn suggesting_place(
    reason: Reason,
    placed: &Pattern,
    part: &CachedSurface,
    settings: &JobSettings,
) -> Reason {
    let is_as_drawn = settings.placement.place.is_none()
        && settings.placement.anchor == Anchor::Center
        && settings.placement.align != Align::Axis
        && settings.rotary.tiles == Tiles::Off
        && settings.part.view_source.frame().is_none();
    if reason.code != "off-surface" || !is_as_drawn {
        return reason;
    }
    let (field, drawn) = (&part.surface.field, placed.extents());
    let is_on_part = |middle: &Vector2<f64>| {
        let along = |at: u32| f64::from(at) / f64::from(PLACE_SAMPLES) - 0.5;
        let samples =
            (0..=PLACE_SAMPLES).flat_map(|column| (0..=PLACE_SAMPLES).map(move |row| [column, row]));
        let is_off = |[column, row]: &[u32; 2]| {
            let offset = drawn.size().component_mul(&Vector2::new(along(*column), along(*row)));
            !field.is_surface((middle + offset).into())
        };
        samples.filter(is_off).count() <= MOST_OFF
    };
    // The middle of the part is rounded to whole numbers that people type.
    let middle = field.extents().center().map(f64::round);
    let is_elsewhere = |place: &Vector2<f64>| (place - drawn.center()).norm() > SAME_PLACE;
    // Holes may be between the samples, or between the lines.
    let place = [Vector2::zeros(), middle]
        .into_iter()
        .find(|place| is_elsewhere(place) && is_on_part(place) && fits_at(*place, placed, part, settings));
    let Some(place) = place else { return reason };
    let starts_at_corner =
        drawn.min.x >= -PAGE_CORNER && (drawn.min.y >= -PAGE_CORNER || drawn.max.y <= PAGE_CORNER);
    let why = match starts_at_corner {
        true => "the drawing fits there, and its coordinates seem to be those of a page",
        false => "the drawing fits there",
    };
    let [x, y] = [place.x + 0.0, place.y + 0.0];
    let remedy = format!(
        "Put the middle of the drawing on the part with `--place {x},{y}` (`place_mm = [{x}, {y}]` under [placement]): {why}. If it \
         belongs elsewhere, move it or check `facing`."
    );
    Reason { remedy, ..reason }
}

/// Whether all ink of a placed drawing is on the part with its middle at a place of the view: what is refused otherwise.
fn fits_at(place: Vector2<f64>, placed: &Pattern, part: &CachedSurface, settings: &JobSettings) -> bool {
    let (from, to) = (FlatPoint::from(placed.extents().center()), FlatPoint::from(place));
    let moved = placed.transformed(&Affine::rigid(from, 0.0, to));
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let (marked, method) = (fill::for_map(&moved, settings), method(settings));
    let map = LengthTrueMap::find_with_fork(&part.surface, &marked, is_ink, to, &method, &Cores);
    map.is_ok_and(|map| {
        let mapped = MappedInk::new(quality::sample(&moved, is_ink), map, settings);
        let is_on_part = |mapped: &MappedInk| mapped.exposure(&part.surface).off_surface == 0;
        let marked = |ink: &Ink| fill::marked_ink(&moved, ink, settings);
        let lines = mapped.without_open_areas(&part.surface, settings, marked);
        is_on_part(&mapped)
            || lines
                .is_some_and(|(lines, _)| is_on_part(&MappedInk::new(lines, mapped.map.clone(), settings)))
    })
}
