//! The regions of the part on which a drawing is marked: beside a hole, a pocket or a boss, its map needs nothing of these.

use std::collections::{BTreeMap, BTreeSet};

use super::placing::PlacedPattern;
use super::{LearnedPart, Pipeline};
use crate::config::{Align, JobSettings, Tiles};
use crate::cores::Cores;
use crate::geometry::ink::stations;
use crate::geometry::mapping::quality::PIECE;
use crate::geometry::pattern::Shape;
use crate::geometry::regions::Regions;
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};

/// Only regions within so many of the largest steps of the height field from the rectangle of the drawing have an effect on its map: as
/// far as the spline swings beside a wall.
const STEPS_BESIDE: f64 = 8.0;

/// Those within so many of the smallest steps have the largest.
const STEPS_NEAR: f64 = 2.0;

/// Round the drawing, the surface determines the radius of a cylinder as far as this share of the drawing's longer side.
const SHARE_BESIDE: f64 = 0.6;

/// So many regions under a drawing are what noise leaves of a scan: there, none can be told from the others.
const MOST_REGIONS: usize = 64;

/// The regions on which paths are.
struct Visited {
    /// Those with a path that is nowhere beside the surface.
    whole: BTreeSet<u32>,
    /// The points of paths on each region.
    points: BTreeMap<u32, usize>,
}

impl Visited {
    /// Of the inked paths of a drawing, whose points `place` puts into the view.
    fn by(
        drawing: &PlacedPattern,
        settings: &JobSettings,
        regions: &Regions<'_>,
        place: impl Fn(FlatPoint) -> ViewPoint,
    ) -> Self {
        let mut visited = Self { whole: BTreeSet::new(), points: BTreeMap::new() };
        let placed = &drawing.placed;
        let is_ink = |layer: usize| {
            placed.layers.get(layer).is_some_and(|layer| settings.pattern.counts_as_ink(&layer.name))
        };
        for path in placed.paths.iter().filter(|path| is_ink(path.layer)) {
            let points = match path.shape {
                Shape::Dot(point) => vec![point],
                _ => stations(&path.shape, PIECE),
            };
            let (mut there, mut is_whole) = (BTreeSet::new(), true);
            for point in points {
                match regions.at(place(point)) {
                    Some(region) => {
                        there.insert(region);
                        *visited.points.entry(region).or_default() += 1;
                    }
                    None => is_whole = false,
                }
            }
            if is_whole {
                visited.whole.append(&mut there);
            }
        }
        visited
    }

    /// The region with most of the drawing; the first of several.
    fn main(&self) -> Option<BTreeSet<u32>> {
        let most = self.points.iter().max_by_key(|(region, points)| (**points, std::cmp::Reverse(**region)));
        most.map(|(region, _)| BTreeSet::from([*region]))
    }

    /// The regions with whole paths; if all paths leave the surface somewhere, that with most of the drawing.
    fn marked(self) -> Option<BTreeSet<u32>> {
        if self.whole.is_empty() { self.main() } else { Some(self.whole) }
    }
}

impl LearnedPart {
    /// The part with only those regions round a placed drawing on which the drawing is marked; `None` if it is marked on all,
    /// or there are only one or very many. `whole` is the whole part.
    ///
    /// The drawing as it is shows the regions; the map, which may move it by some mm, confirms them.
    pub(super) fn on_marked_regions(
        &self,
        drawing: &PlacedPattern,
        whole: &Self,
        settings: &JobSettings,
    ) -> Option<Self> {
        let surface = &self.kept.surface;
        let extents = drawing.extents(settings);
        let beside = STEPS_BESIDE * whole.kept.surface.field.step();
        let regions = Regions::of(&surface.field);
        let there = [beside, STEPS_NEAR * surface.field.step()]
            .map(|beside| regions.within(&extents.grown(beside)))
            .into_iter()
            .find(|there| there.len() <= MOST_REGIONS)?;
        if there.len() < 2 {
            return None;
        }
        let is_turned = settings.placement.align == Align::Axis || settings.rotary.tiles != Tiles::Off;
        let as_drawn = Visited::by(drawing, settings, &regions, |at| at.coords().into());
        let main = as_drawn.main()?;
        let first = if is_turned { main.clone() } else { as_drawn.marked()? };
        let beside = beside.max(SHARE_BESIDE * extents.size().max());
        let within = extents.grown(beside);
        let only = |kept: &BTreeSet<u32>| {
            if there.iter().all(|region| kept.contains(region)) {
                return None;
            }
            let is_left_out = |at: ViewPoint| {
                let region = regions.nearest(at).filter(|_| within.contains(at.coords()));
                region.is_some_and(|region| region.is_none_or(|region| !kept.contains(&region)))
            };
            let seen = whole.kept.surface.without(is_left_out, &Cores).ok()?;
            let near = if settings.rotary.tiles == Tiles::Off { seen.round(&extents) } else { None };
            Some(self.with_surface(near.unwrap_or(seen)))
        };
        let part = only(&first);
        if settings.rotary.tiles != Tiles::Off {
            return part;
        }
        let mapped = |part: &Self| Pipeline::mapped(drawing.clone(), part, whole, settings, "").ok();
        match mapped(part.as_ref().unwrap_or(self)) {
            Some((turned, map)) => {
                let confirmed = Visited::by(&turned, settings, &regions, |at| map.point(at)).marked();
                match confirmed {
                    Some(kept) if kept != first => only(&kept),
                    _ => part,
                }
            }
            None if main != first => only(&main).filter(|part| mapped(part).is_some()).or(part),
            // A map that is only found on the whole part is one.
            None => part.filter(|_| mapped(self).is_none()),
        }
    }
}

impl PlacedPattern {
    /// The rectangle of the drawing and its anchor, mm, with all that it may still be turned to.
    pub(super) fn extents(&self, settings: &JobSettings) -> Extents {
        let place = self.placing.place.coords();
        let mut extents = self.ink.extents;
        extents.include(place);
        if settings.placement.align == Align::Axis {
            // The drawing may still be turned about its anchor.
            let far = (extents.max - place).sup(&(place - extents.min)).norm();
            extents = Extents { min: place, max: place }.grown(far);
        }
        extents
    }
}
