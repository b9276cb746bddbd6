//! The regions of the part on which a drawing is marked: beside a hole, a pocket or a boss, its map needs nothing of these. Nor does
//! it need what is beyond an edge, if the drawing is on one face of the part.

use std::collections::{BTreeMap, BTreeSet};

use super::placing::PlacedPattern;
use super::{LearnedPart, Pipeline};
use crate::config::{Align, JobSettings, Tiles};
use crate::cores::Cores;
use crate::geometry::ink::stations;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::quality::PIECE;
use crate::geometry::pattern::Shape;
use crate::geometry::regions::Regions;
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::fit::Beyond;

/// Only regions within this many of the largest steps of the height field from the rectangle of the drawing
/// have an effect on its map: this is how far the spline swings beside a wall.
const STEPS_BESIDE: f64 = 8.0;

/// Regions within this many of the smallest steps have the largest effect.
const STEPS_NEAR: f64 = 2.0;

/// An edge within this many of the largest steps of the height field changes the surface on both sides of it.
const STEPS_BESIDE_EDGE: f64 = 5.0;

/// The map may have the whole drawing on one face if, as drawn, more than this share of the ink that is not
/// on edges is on it. [`MOST_AS_MAPPED`] must hold, too.
const MOST_AS_DRAWN: f64 = 0.5;

/// The map may have the whole drawing on one face if, on the map that follows the part over its edges, more
/// than this share of the ink is on it. [`MOST_AS_DRAWN`] must hold, too.
const MOST_AS_MAPPED: f64 = 0.9;

/// Round the drawing, surface within this share of the drawing's longer side determines the radius of a
/// cylinder.
const SHARE_BESIDE: f64 = 0.6;

/// More regions than this under a drawing are caused by the noise of a scan. They cannot be distinguished.
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
        for points in drawing.inked_points(settings) {
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

/// The points of a drawing on each face of the part.
struct Faces {
    known: BTreeMap<u32, usize>,
    /// Those on edges.
    unknown: usize,
}

impl Faces {
    fn under(points: impl Iterator<Item = FlatPoint>, face_at: impl Fn(FlatPoint) -> Option<u32>) -> Self {
        let mut faces = Self { known: BTreeMap::new(), unknown: 0 };
        for point in points {
            match face_at(point) {
                Some(face) => *faces.known.entry(face).or_default() += 1,
                None => faces.unknown += 1,
            }
        }
        faces
    }

    /// The face that all points are on.
    fn all(&self) -> Option<u32> {
        let only = self.known.first_key_value().filter(|_| self.known.len() == 1 && self.unknown == 0);
        only.map(|(face, _)| *face)
    }

    /// The face that more than a share of the points is on, of those that are not on edges.
    fn most(&self, share: f64) -> Option<u32> {
        let known: usize = self.known.values().sum();
        let is_most = |(_, count): &(&u32, &usize)| **count as f64 > share * known as f64;
        self.known.iter().find(is_most).map(|(face, _)| *face)
    }
}

impl LearnedPart {
    /// The part with only those regions round a placed drawing on which the drawing is marked, and only the face if all of the
    /// drawing is on one; `None` if it is marked on all, or there are only one or very many. `whole` is the whole part.
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
        let beside_edge = extents.grown(STEPS_BESIDE_EDGE * whole.kept.surface.field.step());
        let has_edge = surface.field.has_edge_within(&beside_edge);
        if there.len() < 2 && !has_edge {
            return None;
        }
        let is_turned = settings.placement.align == Align::Axis || settings.rotary.tiles != Tiles::Off;
        let as_drawn = Visited::by(drawing, settings, &regions, |at| at.coords().into());
        let main = as_drawn.main()?;
        let first = if is_turned { main.clone() } else { as_drawn.marked()? };
        let beside = beside.max(SHARE_BESIDE * extents.size().max());
        let within = extents.grown(beside);
        let refitted =
            extents.grown(beside.max((STEPS_BESIDE + STEPS_BESIDE_EDGE) * whole.kept.surface.field.step()));
        let faces_under = |drawing: &PlacedPattern, place: &dyn Fn(FlatPoint) -> ViewPoint| {
            let is_divided = has_edge && !is_turned;
            Faces::under(drawing.inked_points(settings).flatten().filter(|_| is_divided), |point| {
                surface.field.face_at(place(point))
            })
        };
        let is_on_other_face = |at: ViewPoint, face: u32| {
            let fields = [&surface.field, &whole.kept.surface.field];
            fields.into_iter().find_map(|field| field.is_on_other_face(at, face)).unwrap_or_default()
        };
        let only = |kept: &BTreeSet<u32>, face: Option<u32>| {
            let is_everywhere = there.iter().all(|region| kept.contains(region));
            if is_everywhere && face.is_none() {
                return None;
            }
            let beyond = if is_everywhere { Beyond::Edges } else { Beyond::Steps };
            let is_left_out = |at: ViewPoint| {
                let region = regions.nearest(at).filter(|_| within.contains(at.coords()));
                region.is_some_and(|region| region.is_none_or(|region| !kept.contains(&region)))
                    || face.is_some_and(|face| is_on_other_face(at, face))
            };
            let seen = whole.kept.surface.without(is_left_out, &refitted, beyond, &Cores).ok()?;
            let near = if settings.rotary.tiles == Tiles::Off { seen.round(&extents) } else { None };
            Some(self.with_surface(near.unwrap_or(seen)))
        };
        let faces = faces_under(drawing, &|at| at.coords().into());
        let face = faces.all();
        if there.len() < 2 && face.is_none() && faces.most(MOST_AS_DRAWN).is_none() {
            return None;
        }
        let part = only(&first, face);
        if settings.rotary.tiles != Tiles::Off {
            return part;
        }
        let mapped = |part: &Self| Pipeline::mapped(drawing.clone(), part, whole, settings, "").ok();
        // The nodes of a narrow groove or rib may leave no surface under ink that is close to it.
        let is_whole = |part: &Self, drawing: &PlacedPattern, map: &LengthTrueMap| {
            let field = &part.kept.surface.field;
            drawing.inked_points(settings).flatten().all(|point| field.is_surface(map.point(point)))
        };
        // Distances from the anchor are those on its face.
        let is_anchor_on = |face: &u32| {
            let anchor = surface.field.face_at(drawing.placing.place.coords().into());
            anchor.is_none_or(|anchor| anchor == *face)
        };
        let confirmed_on = |kept: &BTreeSet<u32>, face: u32| {
            let part = only(kept, Some(face))?;
            let (turned, map) = mapped(&part)?;
            let is_there = faces_under(&turned, &|at| map.point(at)).all() == Some(face);
            (is_there && is_whole(&part, &turned, &map)).then_some(part)
        };
        match mapped(part.as_ref().unwrap_or(self)) {
            Some((turned, map)) => {
                let confirmed = Visited::by(&turned, settings, &regions, |at| map.point(at)).marked();
                let kept = confirmed.unwrap_or_else(|| first.clone());
                let faces = faces_under(&turned, &|at| map.point(at));
                let on_face = faces.all();
                let is_same = kept == first && on_face == face;
                let fits =
                    || part.as_ref().is_none_or(|part| face.is_none() || is_whole(part, &turned, &map));
                if is_same && face.is_some() && fits() {
                    return part;
                }
                // The map on both sides of an edge shows where the drawing is only about.
                let likely = on_face.or_else(|| faces.most(MOST_AS_MAPPED));
                let other =
                    likely.filter(is_anchor_on).filter(|likely| kept != first || face != Some(*likely));
                match other.and_then(|other| confirmed_on(&kept, other)) {
                    None if is_same && face.is_none() => part,
                    None => only(&kept, None),
                    found => found,
                }
            }
            None if main != first => only(&main, face).filter(|part| mapped(part).is_some()).or(part),
            // A map that is only found on the whole part is one.
            None => part.filter(|_| mapped(self).is_none()),
        }
    }
}

impl PlacedPattern {
    /// The points along each path that is marked.
    fn inked_points(&self, settings: &JobSettings) -> impl Iterator<Item = Vec<FlatPoint>> {
        let placed = &self.placed;
        let is_ink = |layer: usize| {
            placed.layers.get(layer).is_some_and(|layer| settings.pattern.counts_as_ink(&layer.name))
        };
        placed.paths.iter().filter(move |path| is_ink(path.layer)).map(|path| match path.shape {
            Shape::Dot(point) => vec![point],
            _ => stations(&path.shape, PIECE),
        })
    }

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
