//! Ink under its map, and what follows from it on the surface.

use std::sync::OnceLock;

use crate::config::JobSettings;
use crate::geometry::correction::{Exposure, Projection};
use crate::geometry::ink::Ink;
use crate::geometry::mapping::quality::{self, Distortion};
use crate::geometry::mapping::{LengthTrueMap, Method};
use crate::geometry::optics::{Fixture, ScanHead};
use crate::geometry::sensitivity::{PoseUncertainty, Sensitivity};
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// Ink under its map, in front of a laser. What follows from it is found when it is first asked for; it is always asked for
/// with the surface of the map.
#[derive(Debug)]
pub(super) struct MappedInk {
    pub(super) ink: Ink,
    pub(super) map: LengthTrueMap,
    fixture: Fixture,
    head: ScanHead,
    uncertainty: PoseUncertainty,
    exposure: OnceLock<Exposure>,
    sensitivity: OnceLock<Sensitivity>,
    results: OnceLock<Result<Results, ViewPoint>>,
}

/// A point of the view, mm, on no part.
const BESIDE_ANY_PART: ViewPoint = ViewPoint::new(1e9, 1e9);

/// The errors with the correction, and without it as this laser would mark the drawing, if all ink is on the part then.
pub(super) type Results = (Distortion, Option<Distortion>);

impl MappedInk {
    pub(super) fn new(ink: Ink, map: LengthTrueMap, settings: &JobSettings) -> Self {
        Self {
            ink,
            map,
            fixture: settings.fixture,
            head: settings.scan_head(),
            uncertainty: settings.pose_uncertainty,
            exposure: OnceLock::new(),
            sensitivity: OnceLock::new(),
            results: OnceLock::new(),
        }
    }

    /// Whether the same follows from both on one surface.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        (self.fixture, self.head, self.uncertainty) == (other.fixture, other.head, other.uncertainty)
            && self.ink == other.ink
            && self.map == other.map
    }

    pub(super) fn projection<'a>(&'a self, surface: &'a FittedSurface) -> Projection<'a> {
        Projection { map: &self.map, surface, fixture: self.fixture, head: self.head }
    }

    /// The ink whose outlines are only lines where nothing fills them and the laser cannot mark all that they enclose; see
    /// [`without_open_areas`]. `None` if it can mark all.
    pub(super) fn without_open_areas(
        &self,
        surface: &FittedSurface,
        settings: &JobSettings,
        marked: impl FnOnce(&Ink) -> Ink,
    ) -> Option<(Ink, Vec<FlatPoint>)> {
        let Exposure { off_surface, steepest, .. } = *self.exposure(surface);
        let is_marked = off_surface == 0 && steepest <= settings.optics.incidence.refuse;
        let lines = || without_open_areas(&self.ink, &marked(&self.ink), &self.projection(surface), settings);
        if is_marked { None } else { lines() }
    }

    /// The part under the ink, as the beam reaches it.
    pub(super) fn exposure(&self, surface: &FittedSurface) -> &Exposure {
        self.exposure.get_or_init(|| self.projection(surface).expose(&self.ink))
    }

    /// What a misplaced part does to the mark.
    pub(super) fn sensitivity(&self, surface: &FittedSurface) -> &Sensitivity {
        self.sensitivity.get_or_init(|| self.projection(surface).sensitivity(&self.ink, &self.uncertainty))
    }

    /// The errors on the part, estimated from above.
    ///
    /// # Errors
    /// The place of mapped ink that is not on the surface.
    pub(super) fn results(&self, surface: &FittedSurface) -> Result<Results, ViewPoint> {
        *self.results.get_or_init(|| {
            let Self { ink, map, .. } = self;
            let after = measured(ink, map, &|at| map.point(at), surface)?;
            let projection = self.projection(surface);
            let uncorrected = |at: FlatPoint| projection.uncorrected(at).unwrap_or(BESIDE_ANY_PART);
            Ok((after, measured(ink, map, &uncorrected, surface).ok()))
        })
    }

    /// The errors of the drawing as it is under a beam that is parallel to the view, if all ink is on the part then.
    pub(super) fn as_seen(&self, surface: &FittedSurface) -> Option<Distortion> {
        measured(&self.ink, &self.map, &|at| ViewPoint::from(at.coords()), surface).ok()
    }
}

/// The ink without the areas that are not in `marked`, because nothing fills them, and that the laser cannot mark completely, because of a hole,
/// an edge or a steep side; with a place of each. `None` if there is no such area.
pub(super) fn without_open_areas(
    ink: &Ink,
    marked: &Ink,
    projection: &Projection<'_>,
    settings: &JobSettings,
) -> Option<(Ink, Vec<FlatPoint>)> {
    let is_reached = |at: FlatPoint| projection.reaches(at, settings.optics.incidence.refuse);
    let (lines, open) = ink.clone().without_open_areas(marked, is_reached);
    (!open.is_empty()).then_some((lines, open))
}

/// The errors that a drawing has on the part if `place` projects it, estimated from above. Where the part is recognised as a
/// cylinder or cone with a radius that is determined, its surface is also known between the vertices, if it is known from a model.
///
/// # Errors
/// The place of ink that is not on the surface.
pub(super) fn measured(
    ink: &Ink,
    map: &LengthTrueMap,
    place: &dyn Fn(FlatPoint) -> ViewPoint,
    surface: &FittedSurface,
) -> Result<Distortion, ViewPoint> {
    let is_recognised = map.fit_residual().is_some_and(|residual| residual <= Method::EXACT_TOLERANCE);
    let is_known = is_recognised && map.is_determined() && !surface.is_measured();
    quality::measure_on(surface, ink, place, !is_known)
}
