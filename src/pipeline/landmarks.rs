//! Places on the part, in the part frame: what a person looks for in three dimensions.

use nalgebra::Point3;

use super::{Distortion, JobSettings};
use crate::config::PartSettings;
use crate::geometry::correction::Exposure;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::space::{Extents, FieldPoint, View, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;
use crate::report_html::{Landmarks, Plane};

/// The planes in focus reach beyond the marked rectangle by this share of its longer side.
const FOCUS_MARGIN: f64 = 0.15;

/// From places of the view to places on the part.
#[derive(Clone, Copy)]
pub(super) struct Lift<'a> {
    surface: &'a FittedSurface,
    view: View,
}

impl<'a> Lift<'a> {
    pub(super) fn new(surface: &'a FittedSurface, settings: &PartSettings) -> Self {
        Self { surface, view: view_of(settings) }
    }

    /// The point of the part's surface at a place of the view, mm in the part frame; `None` beside the surface.
    pub(super) fn point(&self, at: ViewPoint) -> Option<[f64; 3]> {
        let height = self.surface.sampled_height(at)?;
        Some(self.view.part_point(Point3::new(at.x, at.y, height)).coords.into())
    }
}

/// How the laser sees a part. The sizes of a primitive are given in the view.
pub(super) fn view_of(settings: &PartSettings) -> View {
    match settings.primitive {
        Some(_) => View::top(),
        None => View::new(settings.facing, settings.roll),
    }
}

/// What is around a mark, for its picture.
pub(super) fn landmarks(
    lift: Lift,
    map: &LengthTrueMap,
    exposure: &Exposure,
    after: &Distortion,
    settings: &JobSettings,
) -> Landmarks {
    let best = (exposure.lowest + exposure.highest) / 2.0;
    let across = |area: &Extents, height: f64| plane(area, height, &lift.view, settings);
    let marked = exposure.field.grown(FOCUS_MARGIN * exposure.field.size().max());
    Landmarks {
        field: settings.field.map(|field| across(&field.extents(), best)),
        focus: settings
            .optics
            .focus_depth
            .map(|depth| [best - depth / 2.0, best + depth / 2.0].map(|height| across(&marked, height))),
        stretch_at: lift.point(map.point(after.max_stretch_at)),
        incidence_at: lift.point(exposure.steepest_at),
        residual_at: lift.point(exposure.max_difference_at),
    }
}

/// A rectangle of the field at a height of the laser's frame, mm.
fn plane(area: &Extents, height: f64, view: &View, settings: &JobSettings) -> Plane {
    let Extents { min, max } = area;
    let head = settings.scan_head();
    // The beams of a rectangle come together towards the lens.
    let corner = |x: f64, y: f64| {
        let hit = head.cast(FieldPoint::new(x, y), height);
        view.part_point(settings.fixture.in_view(hit)).coords.into()
    };
    Plane {
        corners: [corner(min.x, min.y), corner(max.x, min.y), corner(max.x, max.y), corner(min.x, max.y)],
        size: area.size().into(),
        height,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::optics::{Fixture, Lens};

    #[test]
    fn the_corners_of_a_plane_aim_at_the_corners_of_its_rectangle() {
        let mut settings = JobSettings::default();
        settings.optics.lens = Lens::Perspective { x: 300.0, y: 280.0 };
        settings.fixture = Fixture { x: 10.0, y: 4.0, z: -6.0, rotation: 0.3 };
        let area = Extents { min: Vector2::new(-20.0, -10.0), max: Vector2::new(30.0, 15.0) };
        let view = View::top();
        let found = plane(&area, 25.0, &view, &settings);
        assert_eq!((found.size, found.height), ([50.0, 25.0], 25.0));
        let aims = found.corners.map(|corner| {
            let at = settings.fixture.point(view.point(corner.into()));
            assert!((at.z - 25.0).abs() < 1e-12);
            settings.scan_head().aim(at).unwrap().coords()
        });
        for (aim, corner) in aims.iter().zip([[-20.0, -10.0], [30.0, -10.0], [30.0, 15.0], [-20.0, 15.0]]) {
            assert!((aim - Vector2::from(corner)).norm() < 1e-9, "{aim}");
        }
    }
}
