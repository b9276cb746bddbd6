//! Ink in the shadow of another part of the body: the oblique beam of a perspective lens meets that first.

use nalgebra::Point3;

use super::correction::Projection;
use super::optics::{Fixture, Lens};
use crate::geometry::height_field::{HeightField, Node};
use crate::geometry::ink::Ink;
use crate::geometry::space::{FlatPoint, ViewPoint};

/// At most this many places of the ink are examined, spread evenly.
const MOST_PLACES: usize = 20_000;

/// Ink that the beam cannot reach because the part is in its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hidden {
    /// The place of the view where the part rises highest above the beam's way to it.
    pub at: ViewPoint,
    /// Where the part is in the way.
    pub behind: ViewPoint,
    /// How far the part rises above the beam there, mm.
    pub rises: f64,
    /// The share of the examined places that are hidden, 0 to 1.
    pub share: f64,
}

impl Projection<'_> {
    /// The ink that is hidden because the part rises more than `limit` mm into the beam; `None` if the beam reaches all of it.
    /// Under a telecentric lens the beam is parallel to the view, in which everything is seen.
    ///
    /// `field` is the field of the whole part; `self` may have only what is round the drawing. The part is
    /// taken from its highest points over the view, so that a beam that would pass under an overhang is
    /// treated as blocked.
    pub fn hidden(&self, ink: &Ink, field: &HeightField, limit: f64) -> Option<Hidden> {
        if self.head.lens == Lens::Telecentric {
            return None;
        }
        let top = field.nodes().iter().filter_map(height_of).fold(f64::NEG_INFINITY, f64::max);
        let ends = ink.pieces.iter().map(|piece| piece.from);
        let places: Vec<FlatPoint> = ends.chain(ink.squares.iter().chain(&ink.dots).copied()).collect();
        let stride = places.len().div_ceil(MOST_PLACES).max(1);
        let (mut worst, mut hidden, mut examined): (Option<Hidden>, usize, usize) = (None, 0, 0);
        for flat in places.iter().step_by(stride) {
            examined += 1;
            let Some(found) = self.blocked(*flat, field, top).filter(|found| found.rises > limit) else {
                continue;
            };
            hidden += 1;
            if worst.is_none_or(|worst| found.rises > worst.rises) {
                worst = Some(found);
            }
        }
        worst.map(|worst| Hidden { share: hidden as f64 / examined as f64, ..worst })
    }

    /// Where the part rises highest above the beam's way to a point of the drawing.
    fn blocked(&self, flat: FlatPoint, field: &HeightField, top: f64) -> Option<Hidden> {
        let (view, landing) = self.landing(flat);
        self.head.aim(landing)?;
        let back = Fixture { x: 0.0, y: 0.0, z: 0.0, rotation: -self.fixture.rotation };
        let towards = back.direction(self.head.towards(landing));
        let sideways = towards.xy().norm();
        if towards.z <= 0.0 || sideways == 0.0 {
            return None;
        }
        let from = Point3::new(view.x, view.y, landing.z - self.fixture.z);
        // The beam is above the whole part from here on.
        let farthest = (top - from.z) / towards.z;
        let step = field.step() / (2.0 * sideways);
        let mut found: Option<Hidden> = None;
        let mut along = step;
        while along < farthest {
            let beam = from + towards * along;
            along += step;
            let at = ViewPoint::new(beam.x, beam.y);
            let Some(lowest) = lowest_round(field, at) else { continue };
            let rises = lowest - beam.z;
            if rises > found.map_or(0.0, |found| found.rises) {
                found = Some(Hidden { at: view, behind: at, rises, share: 0.0 });
            }
        }
        found
    }
}

fn height_of(node: &Node) -> Option<f64> {
    match node {
        Node::Empty => None,
        Node::Wall(height) | Node::Surface(height) => Some(*height),
    }
}

/// The lowest of the four nodes round a place, mm; `None` beside the part. At an edge of the part it is on
/// the lower side, to prevent a rounding of the grid from hiding ink.
fn lowest_round(field: &HeightField, at: ViewPoint) -> Option<f64> {
    let (column, row, _) = field.cell(at)?;
    let heights = field.cell_nodes(column, row).map(|index| field.nodes().get(index).and_then(height_of));
    heights.into_iter().try_fold(f64::INFINITY, |lowest, height| Some(lowest.min(height?)))
}
