//! What was found for the last drawings on a surface: the same drawing is dropped again for the next piece.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::mapped_ink::MappedInk;
use super::marked::{DrawnPart, Marked};
use crate::config::JobSettings;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::{LengthTrueMap, Method};
use crate::geometry::pattern::Pattern;
use crate::geometry::space::{Extents, FlatPoint};
use crate::preview::{HeightPicture, OnPart};

/// This many drawings are remembered for one surface.
const MOST: usize = 4;
/// This many pictures are remembered for one surface; each has a mesh of the part.
const MOST_PICTURES: usize = 1;
/// This many areas of drawings are remembered for one surface; each has a mesh of the part.
const MOST_AREAS: usize = 2;
/// Drawings with more segments are not remembered.
const LARGEST: usize = 4_000;
/// Drawings whose ink has more pieces and squares are not remembered.
const LARGEST_INK: usize = 40_000;

/// What was found for the last drawings on one surface, shared by its copies.
#[derive(Debug, Clone, Default)]
pub(crate) struct RecentDrawings {
    maps: Recent<(Drawing, LengthTrueMap)>,
    inks: Recent<Arc<MappedInk>>,
    pictures: Recent<(Marked, OnPart)>,
    parts: Recent<(Extents, Arc<DrawnPart>)>,
    outlines: Recent<Arc<HeightPicture>>,
}

/// What a map follows from on a surface.
#[derive(Debug)]
struct Drawing {
    placed: Pattern,
    /// For each of its layers.
    is_ink: Vec<bool>,
    place: FlatPoint,
    method: Method,
}

/// All that is remembered follows from the surface.
impl PartialEq for RecentDrawings {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl RecentDrawings {
    /// The map for a placed drawing with ink on some layers: the remembered one, or the one that is found by `find`.
    ///
    /// # Errors
    /// Those of `find`.
    pub(crate) fn map<E>(
        &self,
        placed: &Pattern,
        is_ink: impl Fn(&str) -> bool,
        place: FlatPoint,
        method: Method,
        find: impl FnOnce() -> Result<LengthTrueMap, E>,
    ) -> Result<LengthTrueMap, E> {
        let is_ink: Vec<bool> = placed.layers.iter().map(|layer| is_ink(&layer.name)).collect();
        let is_it = |drawing: &Drawing| {
            drawing.place == place
                && drawing.method == method
                && drawing.is_ink == is_ink
                && drawing.placed == *placed
        };
        if let Some(map) = self.maps.find(|(known, map)| is_it(known).then(|| map.clone())) {
            return Ok(map);
        }
        let map = find()?;
        if is_small(placed) {
            self.maps.keep((Drawing { placed: placed.clone(), is_ink, place, method }, map.clone()), MOST);
        }
        Ok(map)
    }

    /// Ink under its map: the remembered one with what was found for it, or the given one.
    pub(super) fn mapped(&self, ink: Ink, map: LengthTrueMap, settings: &JobSettings) -> Arc<MappedInk> {
        let given = Arc::new(MappedInk::new(ink, map, settings));
        if given.ink.pieces.len() + given.ink.squares.len() > LARGEST_INK {
            return given;
        }
        self.inks.find(|known| known.is_same(&given).then(|| known.clone())).unwrap_or_else(|| {
            self.inks.keep(given.clone(), MOST);
            given
        })
    }

    /// The picture of a mark on the part: the remembered one under the drawing's name, or the one that is drawn by `draw`.
    pub(crate) fn picture(&self, marked: &Marked, draw: impl FnOnce() -> OnPart) -> OnPart {
        let known = |(of, picture): &(Marked, OnPart)| of.is_same_mark(marked).then(|| picture.clone());
        if let Some(picture) = self.pictures.find(known) {
            return OnPart { drawing: marked.drawing.clone(), ..picture };
        }
        let picture = draw();
        if is_small(&marked.ink) {
            self.pictures.keep((marked.clone(), picture.clone()), MOST_PICTURES);
        }
        picture
    }

    /// The part under the drawings of an area: the remembered one, or the one that is drawn by `draw`.
    pub(super) fn part(&self, area: &Extents, draw: impl FnOnce() -> DrawnPart) -> Arc<DrawnPart> {
        self.parts.find(|(of, part)| (of == area).then(|| part.clone())).unwrap_or_else(|| {
            let part = Arc::new(draw());
            if part.is_final {
                self.parts.keep((*area, part.clone()), MOST_AREAS);
            }
            part
        })
    }

    /// The surface behind the lines of a preview that shows residuals above `limit` mm: the remembered one, or the one that is
    /// drawn by `draw`.
    pub(super) fn outline(&self, limit: f64, draw: impl FnOnce() -> HeightPicture) -> Arc<HeightPicture> {
        self.outlines.find(|known| (known.residual_limit == limit).then(|| known.clone())).unwrap_or_else(
            || {
                let outline = Arc::new(draw());
                self.outlines.keep(outline.clone(), 1);
                outline
            },
        )
    }
}

fn is_small(pattern: &Pattern) -> bool {
    pattern.paths.iter().map(|path| path.shape.segments().len()).sum::<usize>() <= LARGEST
}

/// The last results, the newest first.
#[derive(Debug)]
struct Recent<T>(Arc<Mutex<VecDeque<T>>>);

impl<T> Clone for Recent<T> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<T> Default for Recent<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> Recent<T> {
    fn known(&self) -> MutexGuard<'_, VecDeque<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn find<R>(&self, is_it: impl Fn(&T) -> Option<R>) -> Option<R> {
        self.known().iter().find_map(is_it)
    }

    fn keep(&self, result: T, most: usize) {
        let mut known = self.known();
        known.truncate(most - 1);
        known.push_front(result);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Color, Layer, Path, Segment, Shape, Source};

    const ALL: fn(&str) -> bool = |_| true;

    fn line(length: f64) -> Pattern {
        let segment = Segment::Line { from: FlatPoint::new(0.0, 0.0), to: FlatPoint::new(length, 0.0) };
        Pattern {
            layers: vec![Layer { name: "0".into(), color: Color::Aci(7) }],
            paths: vec![Path {
                layer: 0,
                color: Color::ByLayer,
                shape: Shape::Open(vec![segment]),
                region: None,
                source: Source::default(),
            }],
        }
    }

    #[test]
    fn only_the_same_drawing_at_the_same_place_with_the_same_method_has_the_map_that_was_found() {
        let recent = RecentDrawings::default();
        let (mut count, origin, other) = (0, FlatPoint::new(0.0, 0.0), FlatPoint::new(1.0, 0.0));
        let mut find = |recent: &RecentDrawings, length: f64, is_ink: fn(&str) -> bool, place, method| {
            let map = recent.map(&line(length), is_ink, place, method, || {
                count += 1;
                Ok::<_, ()>(LengthTrueMap::Plain)
            });
            assert_eq!(map, Ok(LengthTrueMap::Plain));
            count
        };
        let none: fn(&str) -> bool = |_| false;
        for (length, is_ink, place, method, expected) in [
            (1.0, ALL, origin, Method::Plain, 1),
            (1.0, ALL, origin, Method::Plain, 1),
            (2.0, ALL, origin, Method::Plain, 2),
            (1.0, ALL, other, Method::Plain, 3),
            (1.0, ALL, origin, Method::Cylinder, 4),
            (1.0, ALL, origin, Method::Plain, 4),
            (1.0, none, origin, Method::Plain, 5),
            (1.0, ALL, origin, Method::Plain, 6),
        ] {
            let counted = find(&recent.clone(), length, is_ink, place, method);
            assert_eq!(counted, expected, "{length} {place:?} {method:?}");
        }
        assert_eq!(recent.map(&line(9.0), ALL, origin, Method::Plain, || Err("none")), Err("none"));
        assert_eq!(find(&recent, 9.0, ALL, origin, Method::Plain), 7);
    }

    #[test]
    fn only_the_same_ink_under_the_same_map_before_the_same_laser_has_the_results_that_were_found() {
        let recent = RecentDrawings::default();
        let mut turned = JobSettings::default();
        turned.fixture.rotation = 0.1;
        let of = |length: f64, settings: &JobSettings| {
            let ink = Ink::sample(&line(length), ALL, 0.25, 0.25);
            recent.mapped(ink, LengthTrueMap::Plain, settings)
        };
        let straight = JobSettings::default();
        let first = of(1.0, &straight);
        assert!(Arc::ptr_eq(&first, &of(1.0, &straight)));
        for other in [of(2.0, &straight), of(1.0, &turned)] {
            assert!(!Arc::ptr_eq(&first, &other));
        }
        assert!(Arc::ptr_eq(&first, &of(1.0, &straight)));
    }
}
