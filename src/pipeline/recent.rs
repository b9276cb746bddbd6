//! What was found for the last drawings on a surface: the same drawing is dropped again for the next piece.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::marked::Marked;
use crate::geometry::correction::{Exposure, Projection};
use crate::geometry::ink::Ink;
use crate::geometry::mapping::quality::Distortion;
use crate::geometry::mapping::{LengthTrueMap, Method};
use crate::geometry::optics::{Fixture, ScanHead};
use crate::geometry::pattern::Pattern;
use crate::geometry::sensitivity::{PoseUncertainty, Sensitivity};
use crate::geometry::space::FlatPoint;
use crate::preview::OnPart;

/// Maps that are remembered for one surface, and their results.
const MOST: usize = 4;
/// Pictures that are remembered for one surface: each has a mesh of the part.
const MOST_PICTURES: usize = 1;
/// Larger drawings are not remembered: number of segments, or pieces and squares of their ink.
const LARGEST: usize = 4_000;
const LARGEST_INK: usize = 40_000;

/// What was found for the last drawings on one surface, shared by its copies.
#[derive(Debug, Clone, Default)]
pub(crate) struct RecentDrawings {
    maps: Recent<Drawing, LengthTrueMap>,
    results: Recent<(Ink, LengthTrueMap), Results>,
    exposures: Recent<Beams, Exposure>,
    sensitivities: Recent<(Beams, PoseUncertainty), Sensitivity>,
    pictures: Recent<Marked, OnPart>,
}

/// The errors with the correction, and without it if all ink is on the part then.
pub(crate) type Results = (Distortion, Option<Distortion>);

/// What a map follows from on a surface.
#[derive(Debug)]
struct Drawing {
    placed: Pattern,
    /// For each of its layers.
    is_ink: Vec<bool>,
    place: FlatPoint,
    method: Method,
}

/// What the beams of a mark follow from on a surface.
#[derive(Debug)]
struct Beams {
    ink: Ink,
    map: LengthTrueMap,
    fixture: Fixture,
    head: ScanHead,
}

impl Beams {
    fn of(projection: &Projection, ink: &Ink) -> Self {
        let Projection { map, fixture, head, .. } = *projection;
        Self { ink: ink.clone(), map: map.clone(), fixture, head }
    }

    fn are_of(&self, projection: &Projection, ink: &Ink) -> bool {
        (self.fixture, self.head) == (projection.fixture, projection.head)
            && self.ink == *ink
            && self.map == *projection.map
    }
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
        if let Some(map) = self.maps.find(is_it) {
            return Ok(map);
        }
        let map = find()?;
        if placed.paths.iter().map(|path| path.shape.segments().len()).sum::<usize>() <= LARGEST {
            let drawing = Drawing { placed: placed.clone(), is_ink, place, method };
            self.maps.keep(drawing, &map, MOST);
        }
        Ok(map)
    }

    /// The errors of ink under a map: the remembered ones, or those that are found by `measure`.
    ///
    /// # Errors
    /// Those of `measure`.
    pub(crate) fn results<E>(
        &self,
        ink: &Ink,
        map: &LengthTrueMap,
        measure: impl FnOnce() -> Result<Results, E>,
    ) -> Result<Results, E> {
        if let Some(results) = self.results.find(|(known, by)| known == ink && by == map) {
            return Ok(results);
        }
        let results = measure()?;
        if is_small(ink) {
            self.results.keep((ink.clone(), map.clone()), &results, MOST);
        }
        Ok(results)
    }

    /// The part under the ink, as the beam reaches it.
    pub(crate) fn exposure(&self, projection: &Projection, ink: &Ink) -> Exposure {
        if let Some(exposure) = self.exposures.find(|beams| beams.are_of(projection, ink)) {
            return exposure;
        }
        let exposure = projection.expose(ink);
        if is_small(ink) {
            self.exposures.keep(Beams::of(projection, ink), &exposure, MOST);
        }
        exposure
    }

    /// What a misplaced part does to the mark.
    pub(crate) fn sensitivity(
        &self,
        projection: &Projection,
        ink: &Ink,
        uncertainty: &PoseUncertainty,
    ) -> Sensitivity {
        let is_it =
            |(beams, known): &(Beams, PoseUncertainty)| known == uncertainty && beams.are_of(projection, ink);
        if let Some(sensitivity) = self.sensitivities.find(is_it) {
            return sensitivity;
        }
        let sensitivity = projection.sensitivity(ink, uncertainty);
        if is_small(ink) {
            self.sensitivities.keep((Beams::of(projection, ink), *uncertainty), &sensitivity, MOST);
        }
        sensitivity
    }

    /// The picture of a mark on the part: the remembered one under the drawing's name, or the one that is drawn by `draw`.
    pub(crate) fn picture(&self, marked: &Marked, draw: impl FnOnce() -> OnPart) -> OnPart {
        if let Some(picture) = self.pictures.find(|known| known.is_same_mark(marked)) {
            return OnPart { drawing: marked.drawing.clone(), ..picture };
        }
        let picture = draw();
        if marked.ink.paths.iter().map(|path| path.shape.segments().len()).sum::<usize>() <= LARGEST {
            self.pictures.keep(marked.clone(), &picture, MOST_PICTURES);
        }
        picture
    }
}

fn is_small(ink: &Ink) -> bool {
    ink.pieces.len() + ink.squares.len() <= LARGEST_INK
}

/// The last results and what they follow from, the newest first.
#[derive(Debug)]
struct Recent<K, V>(Arc<Mutex<VecDeque<(K, V)>>>);

impl<K, V> Clone for Recent<K, V> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<K, V> Default for Recent<K, V> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<K, V: Clone> Recent<K, V> {
    fn known(&self) -> MutexGuard<'_, VecDeque<(K, V)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn find(&self, is_it: impl Fn(&K) -> bool) -> Option<V> {
        self.known().iter().find(|(of, _)| is_it(of)).map(|(_, result)| result.clone())
    }

    fn keep(&self, of: K, result: &V, most: usize) {
        let mut known = self.known();
        known.truncate(most - 1);
        known.push_front((of, result.clone()));
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
    fn results_are_those_of_the_same_ink_under_the_same_map() {
        let recent = RecentDrawings::default();
        let mut count = 0;
        let mut measure = |length: f64| {
            let ink = Ink::sample(&line(length), ALL, 0.25, 0.25);
            let results = recent.results(&ink, &LengthTrueMap::Plain, || {
                count += 1;
                let height = |_| Some(0.0);
                crate::geometry::mapping::quality::measure(&ink, |at| LengthTrueMap::Plain.point(at), height)
                    .map(|results| (results, None))
            });
            (results.unwrap().0.length, count)
        };
        assert_eq!([measure(1.0), measure(2.0), measure(1.0)], [(1.0, 1), (2.0, 2), (1.0, 2)]);
    }
}
