//! How the beam reaches the ink: whether there is surface, at which angle and height, and where in the field.

use super::correction::{Contact, Exposure, Projection};
use crate::geometry::ink::{Block, Ink, is_before};
use crate::geometry::relief::{Cover, Relief, ReliefMap};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};

/// Blocks are divided until a largest distance can grow by no more than this factor.
const SLACK: f64 = 1.002;
/// Blocks are divided until the steepest incidence can grow by no more than this, rad.
const SAME_ANGLE: f64 = 1e-4;
/// Blocks are divided until the lowest and highest height can change by no more than this share of their
/// difference.
const SAME_HEIGHT: f64 = 2.5e-3;
/// Blocks are divided until the distance between the fit and the part can grow by no more than this, mm, in
/// addition to [`SLACK`].
const SAME_DISTANCE: f64 = 2e-5;

impl Exposure {
    const NONE: Self = Self {
        samples: 0,
        off_surface: 0,
        first_off_surface: None,
        steepest: 0.0,
        steepest_at: ViewPoint::new(0.0, 0.0),
        lowest: f64::INFINITY,
        highest: f64::NEG_INFINITY,
        highest_at: ViewPoint::new(0.0, 0.0),
        field: Extents::EMPTY,
        max_difference: 0.0,
        max_difference_at: ViewPoint::new(0.0, 0.0),
        max_doubt: 0.0,
        max_doubt_at: ViewPoint::new(0.0, 0.0),
    };
}

/// What is known of a block of inked area.
enum Seen {
    /// Every square was examined, or none of it is on the part.
    Exactly,
    /// It may be partly beside the part.
    Divided,
    /// On the surface: the relief there, and the largest incidence that is possible.
    Within(Relief, f64),
}

impl Projection<'_> {
    /// Checks the ink: whether there is surface, its angle and height, and its position in the field. Lines are checked
    /// piece by piece, and small inked areas square by square.
    ///
    /// In large areas, blocks of squares are divided where the surface could reach beyond the largest values that are known, by
    /// the nodes of the height field there and the samples of the block, and where it may be missing.
    pub fn expose(&self, ink: &Ink) -> Exposure {
        self.expose_with(ReliefMap::under(ink, self.surface).as_ref(), ink)
    }

    /// Inked areas are checked square by square without a relief.
    fn expose_with(&self, relief: Option<&ReliefMap<'_>>, ink: &Ink) -> Exposure {
        let mut exposure = Exposure::NONE;
        let mut last = None;
        let ends = ink.pieces.iter().flat_map(|piece| {
            // Most pieces start where the last one ended; that point is checked once.
            let start = Some(piece.from).filter(|from| last.replace(piece.to) != Some(*from));
            start.into_iter().chain([piece.to])
        });
        ends.for_each(|flat| self.expose_sample(flat, &mut exposure));
        match relief {
            Some(relief) => self.expose_blocks(ink, relief, &mut exposure),
            None => ink.squares.iter().for_each(|flat| self.expose_sample(*flat, &mut exposure)),
        }
        ink.dots.iter().for_each(|flat| self.expose_sample(*flat, &mut exposure));
        exposure
    }

    fn expose_sample(&self, flat: FlatPoint, exposure: &mut Exposure) {
        exposure.samples += 1;
        let view = self.map.point(flat);
        if self.surface.field.is_surface(view) {
            self.include(flat, view, exposure);
        } else {
            exposure.off_surface += 1;
            exposure.first_off_surface.get_or_insert((flat, view));
        }
    }

    /// Whether there is surface at the image of a point of the drawing, and the beam meets it at most this far from its normal,
    /// rad.
    pub fn reaches(&self, flat: FlatPoint, steepest: f64) -> bool {
        let view = self.map.point(flat);
        self.surface.field.is_surface(view) && self.incidence(&self.contact(flat, view)) <= steepest
    }

    /// The angle between beam and normal, rad.
    fn incidence(&self, contact: &Contact) -> f64 {
        contact.normal.dot(&self.head.towards(contact.at)).clamp(-1.0, 1.0).acos()
    }

    /// Includes a place on the surface and its image; returns the angle between beam and normal there, rad.
    fn include(&self, flat: FlatPoint, view: ViewPoint, exposure: &mut Exposure) -> f64 {
        let contact = self.contact(flat, view);
        let Contact { at: landing, difference, .. } = contact;
        let incidence = self.incidence(&contact);
        if incidence > exposure.steepest {
            (exposure.steepest, exposure.steepest_at) = (incidence, view);
        }
        exposure.lowest = exposure.lowest.min(landing.z);
        if landing.z > exposure.highest {
            (exposure.highest, exposure.highest_at) = (landing.z, view);
        }
        let difference = difference.abs();
        if difference > exposure.max_difference {
            (exposure.max_difference, exposure.max_difference_at) = (difference, view);
        }
        let doubt = self.surface.doubt(view);
        if doubt > exposure.max_doubt {
            (exposure.max_doubt, exposure.max_doubt_at) = (doubt, view);
        }
        if let Some(aim) = self.head.aim(landing) {
            exposure.field.include(aim.coords());
        }
        incidence
    }

    fn expose_blocks(&self, ink: &Ink, relief: &ReliefMap<'_>, exposure: &mut Exposure) {
        let before = exposure.first_off_surface;
        let mut first: Option<FlatPoint> = None;
        let mut is_off = |at: FlatPoint| {
            if first.is_none_or(|first| is_before(at, first)) {
                first = Some(at);
            }
        };
        let examine = |exposure: &mut Exposure, block: Block| {
            let area = relief.image(block.corners(ink.side).map(|corner| self.map.point(corner)));
            let known = match relief.over(&area) {
                Cover::None => {
                    exposure.samples += block.squares();
                    exposure.off_surface += block.squares();
                    is_off(block.first);
                    return Seen::Exactly;
                }
                Cover::Some if block.count > 2 => return Seen::Divided,
                Cover::Some => None,
                Cover::All(known) => Some(known).filter(|_| block.count > 2),
            };
            let Some(known) = known else {
                for square in block.each(ink.side) {
                    let off_surface = exposure.off_surface;
                    self.expose_sample(square, exposure);
                    if exposure.off_surface > off_surface {
                        is_off(square);
                    }
                }
                return Seen::Exactly;
            };
            let places = block.places(ink.side);
            let angles = places.map(|flat| self.include(flat, self.map.point(flat), exposure));
            let [least, most] = range(angles);
            let apart = f64::from(block.count) * ink.side;
            Seen::Within(known, 2.0 * most - least + relief.slope_between(&known, apart))
        };
        let choose = |exposure: &Exposure, blocks: &[(Block, Seen)]| {
            let z = self.fixture.z;
            let same = SAME_HEIGHT * (exposure.highest - exposure.lowest).max(0.0) + 1e-6;
            let is_open = |(_, seen): &(Block, Seen)| match seen {
                Seen::Exactly => false,
                Seen::Divided => true,
                Seen::Within(known, incidence) => {
                    *incidence > exposure.steepest + SAME_ANGLE
                        || known.heights[1] + z > exposure.highest + same
                        || known.heights[0] + z < exposure.lowest - same
                        || known.difference > SLACK * exposure.max_difference + SAME_DISTANCE
                        || known.doubt > SLACK * exposure.max_doubt
                }
            };
            blocks.iter().map(is_open).collect()
        };
        let blocks = ink.survey(exposure, examine, choose);
        for (block, seen) in blocks {
            let Seen::Within(known, incidence) = seen else { continue };
            exposure.samples += block.squares();
            exposure.steepest = exposure.steepest.max(incidence);
            exposure.lowest = exposure.lowest.min(known.heights[0] + self.fixture.z);
            exposure.highest = exposure.highest.max(known.heights[1] + self.fixture.z);
            exposure.max_difference = exposure.max_difference.max(known.difference);
            exposure.max_doubt = exposure.max_doubt.max(known.doubt);
        }
        exposure.first_off_surface = before.or(first.map(|flat| (flat, self.map.point(flat))));
    }
}

/// Smallest and largest of some values.
fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    values
        .into_iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], value| [least.min(value), most.max(value)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mapping::isometric::IsometricOptions;
    use crate::geometry::mapping::{LengthTrueMap, Method, quality};
    use crate::geometry::optics::{Fixture, ScanHead};
    use crate::geometry::pattern::Pattern;
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};

    #[test]
    fn a_large_area_is_exposed_as_its_single_squares_are() {
        let dented = |x: f64, y: f64| {
            0.3 * (-((x - 5.3).powi(2) + (y + 4.1).powi(2)) / 2.0).exp() - shapes::cylinder(x, y) * 0.1
        };
        for height in [&shapes::mouse as &dyn Fn(f64, f64) -> f64, &shapes::cylinder, &dented] {
            let part = FacingPart::new(&shapes::graph(25.0, 0.75, height), &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            for half in [12.9, 27.0] {
                let pattern = Pattern::outline(half);
                let ink = quality::sample(&pattern, |_| true);
                let method = Method::Isometric(IsometricOptions::INK);
                let anchor = FlatPoint::new(0.0, 0.0);
                let found = LengthTrueMap::find(&surface, &pattern, |_| true, anchor, &method);
                for map in std::iter::once(LengthTrueMap::Plain).chain(found) {
                    let projection = Projection {
                        map: &map,
                        surface: &surface,
                        fixture: Fixture { z: -30.0, ..Fixture::default() },
                        head: ScanHead::TELECENTRIC,
                    };
                    let each = projection.expose_with(None, &ink);
                    let found = projection.expose(&ink);
                    assert_eq!((found.samples, found.off_surface), (each.samples, each.off_surface));
                    let first = |exposure: &Exposure| exposure.first_off_surface.map(|(flat, _)| flat);
                    let (one, other) = (first(&each), first(&found));
                    assert_eq!(one.is_some(), other.is_some());
                    assert!(one.zip(other).is_none_or(|(one, other)| one.distance(other) < 1e-9));
                    let depth = each.highest - each.lowest;
                    // What is above the single squares, and what may be open.
                    for (what, above, open) in [
                        ("incidence", found.steepest - each.steepest, SAME_ANGLE),
                        ("lowest", each.lowest - found.lowest, SAME_HEIGHT * depth + 1e-6),
                        ("highest", found.highest - each.highest, SAME_HEIGHT * depth + 1e-6),
                        (
                            "difference",
                            found.max_difference - each.max_difference,
                            0.002 * each.max_difference + SAME_DISTANCE,
                        ),
                        ("doubt", found.max_doubt - each.max_doubt, 0.0),
                    ] {
                        // Without samples of a value, the limits are infinite.
                        assert!(
                            above.is_nan() || (-1e-9..=2.0 * open + 1e-9).contains(&above),
                            "{what}: {above}, {half}"
                        );
                    }
                    assert_eq!(found.field.is_empty(), each.field.is_empty());
                }
            }
        }
    }
}
