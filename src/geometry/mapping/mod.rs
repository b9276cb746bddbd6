//! Maps from the drawing's plane onto the part.
//!
//! All lengths can be kept only where the Gaussian curvature is zero (Gauss, Disquisitiones generales circa superficies
//! curvas, 1827); elsewhere [`quality`] measures how much lengths, areas and angles change.

pub mod tangent;
pub mod isometric;
pub mod patch;
pub mod cylinder;
pub mod cone;
pub mod mapping_domain;
pub mod floater;
pub mod quality;

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Point3, Vector3};

use self::cone::{ConeError, ConeFit, ConeMap};
use self::cylinder::{CylinderError, CylinderFit, CylinderMap, ON_FACE};
use self::floater::{FloaterError, FloaterMap, FloaterWeights};
use self::isometric::{Figure, Instead, IsometricError, IsometricMap, IsometricOptions};
use self::mapping_domain::{MappingDomainError, MappingDomainMap, MappingDomainOptions};
use self::patch::{FEW_POINTS, SampledPatch, TooFewPoints};
use crate::geometry::fork::{Fork, InTurn};
use crate::geometry::ink::Ink;
use crate::geometry::pattern::Pattern;
use crate::geometry::primitive::{Form, Primitive};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// The method by which the map is found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// [`Method::Cylinder`] or [`Method::Cone`] if the part matches one within the tolerance, otherwise
    /// [`Method::Isometric`].
    Auto {
        /// Largest distance of the part from a cylinder or cone, mm.
        exact_tolerance: f64,
        /// Options for all other parts.
        otherwise: IsometricOptions,
    },
    /// The map with the smallest strain; for any surface.
    Isometric(IsometricOptions),
    /// Exact unrolling of the best-fitting cylinder.
    Cylinder,
    /// Exact unrolling of the best-fitting cone.
    Cone,
    /// Exact unrolling of a known primitive.
    Given(Primitive),
    /// The thesis' own method, for comparison.
    MappingDomain(MappingDomainOptions),
    /// The state of the art that the thesis compares with, for comparison.
    Floater(FloaterWeights),
    /// Projection along the laser's axis, without a correction.
    Plain,
}

impl Method {
    /// [`Method::Auto`] treats a part as a cylinder or a cone if it matches one within this, mm. The error of a length
    /// round the axis is then at most this times its angle in rad.
    pub const EXACT_TOLERANCE: f64 = 0.005;
}

/// Under small ink, the part matches a cylinder or cone within this share of the diagonal of the ink. The
/// distance of a doubly curved part from a cylinder there turns the surface by about four times this share,
/// so that no length is wrong by more than 0.1 %.
const EXACT_SHARE: f64 = 5e-4;

/// A map from the placed drawing to the view, chosen for one drawing on one surface.
#[derive(Debug, Clone, PartialEq)]
pub enum LengthTrueMap {
    /// Found by [`IsometricMap::solve`].
    Isometric(IsometricMap),
    /// Exact unrolling.
    Cylinder(CylinderMap, CylinderFit),
    /// Exact unrolling.
    Cone(ConeMap, ConeFit),
    /// Found by [`MappingDomainMap::find`].
    MappingDomain(MappingDomainMap),
    /// Found by [`FloaterMap::find`].
    Floater(FloaterMap),
    /// No correction.
    Plain,
}

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// The free-form map could not be found.
    #[error(transparent)]
    Isometric(#[from] IsometricError),
    /// The part is not a cylinder under the drawing.
    #[error(transparent)]
    Cylinder(#[from] CylinderError),
    /// The part is not a cone under the drawing.
    #[error(transparent)]
    Cone(#[from] ConeError),
    /// The drawing does not fit into the mapping domain of the thesis.
    #[error(transparent)]
    MappingDomain(#[from] MappingDomainError),
    /// The part could not be mapped to a square.
    #[error(transparent)]
    Floater(#[from] FloaterError),
}

impl LengthTrueMap {
    /// The map for a placed drawing, for the ink on layers for which `is_marked` is true. The anchor keeps its place
    /// in the view, and the drawing's x direction is kept there (except with [`Method::MappingDomain`] and
    /// [`Method::Floater`], which choose their own directions).
    ///
    /// # Errors
    /// See [`MapError`]. [`Method::Auto`] never fails because the part is not a cylinder or cone.
    pub fn find(
        surface: &FittedSurface,
        pattern: &Pattern,
        is_marked: impl Fn(&str) -> bool,
        anchor: FlatPoint,
        method: &Method,
    ) -> Result<Self, MapError> {
        Self::find_marked(surface, pattern, &is_marked, anchor, method, &InTurn)
    }

    /// The same map as that of [`Self::find`]; `fork` may do halves of the work at once.
    ///
    /// # Errors
    /// Those of [`Self::find`].
    pub fn find_with_fork(
        surface: &FittedSurface,
        pattern: &Pattern,
        is_marked: impl Fn(&str) -> bool,
        anchor: FlatPoint,
        method: &Method,
        fork: &dyn Fork,
    ) -> Result<Self, MapError> {
        Self::find_marked(surface, pattern, &is_marked, anchor, method, fork)
    }

    /// Compiled once, with the geometry: generic functions are compiled where they are called.
    fn find_marked(
        surface: &FittedSurface,
        pattern: &Pattern,
        is_marked: &dyn Fn(&str) -> bool,
        anchor: FlatPoint,
        method: &Method,
        fork: &dyn Fork,
    ) -> Result<Self, MapError> {
        match method {
            Method::Plain => Ok(Self::Plain),
            Method::Cylinder => Self::unroll_cylinder(surface, &coarse_ink(pattern, is_marked), anchor, None),
            Method::Cone => Self::unroll_cone(surface, &coarse_ink(pattern, is_marked), anchor, None),
            Method::Given(primitive) => {
                let ink = coarse_ink(pattern, is_marked);
                let height = primitive.height(anchor.coords().into()).unwrap_or(0.0);
                match primitive.form() {
                    Form::Cylinder(cylinder) => {
                        let map = CylinderMap::new(cylinder, anchor, height)?;
                        Ok(Self::Cylinder(map, CylinderFit { cylinder, residual: 0.0, is_determined: true }))
                    }
                    Form::Cone(cone) => {
                        let map = ConeMap::new(cone, anchor, height, reach(&ink, anchor))?;
                        Ok(Self::Cone(map, ConeFit { cone, residual: 0.0, is_determined: true }))
                    }
                }
            }
            Method::MappingDomain(options) => {
                let ink = coarse_ink(pattern, is_marked);
                Ok(Self::MappingDomain(MappingDomainMap::find(surface, &ink, anchor, options)?))
            }
            Method::Floater(weights) => Ok(Self::Floater(FloaterMap::find(
                surface,
                &coarse_ink(pattern, is_marked),
                anchor,
                *weights,
            )?)),
            Method::Isometric(options) => {
                let ink = coarse_ink(pattern, is_marked);
                Self::isometric(surface, (pattern, is_marked), ink, anchor, options, fork)
            }
            Method::Auto { exact_tolerance, otherwise } => {
                let ink = coarse_ink(pattern, is_marked);
                // What the part's file names, or its points are on, comes first. Then the cylinder: every cylinder is nearly a cone with a far apex.
                let stated = (!surface.known().is_empty()).then_some(ON_FACE);
                let found = exact_tolerance.min(EXACT_SHARE * ink.extents.size().norm());
                for tolerance in stated.into_iter().chain([found]) {
                    for exact in [Self::unroll_cylinder, Self::unroll_cone] {
                        if let Ok(map) = exact(surface, &ink, anchor, Some(tolerance))
                            && map.fit_residual().is_some_and(|residual| residual <= tolerance)
                        {
                            return Ok(map);
                        }
                    }
                }
                Self::isometric(surface, (pattern, is_marked), ink, anchor, otherwise, fork)
            }
        }
    }

    /// The map that the options ask for. Where there is no surface, ink that outlines enclose has no weight,
    /// because the surface that closes a hole may have any shape.
    fn isometric(
        surface: &FittedSurface,
        drawing: (&Pattern, &dyn Fn(&str) -> bool),
        ink: Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
        fork: &dyn Fork,
    ) -> Result<Self, MapError> {
        if is_on_part(&ink, surface) {
            return Self::least_strained(surface, drawing, ink, anchor, options, fork);
        }
        let marked = coarse_ink_as_marked(drawing.0, drawing.1);
        let found = Self::least_strained(surface, drawing, ink.clone(), anchor, options, fork);
        let place = |at: FlatPoint| found.as_ref().map_or(at.coords().into(), |map| map.point(at));
        let (lines, open) = ink.without_open_areas(&marked, |at| surface.field.is_surface(place(at)));
        if open.is_empty() {
            return found;
        }
        if let Some(as_drawn) = Self::true_as_drawn(surface, &lines, anchor, options) {
            return Ok(as_drawn);
        }
        // Without any area, the solver would take the cells that lines enclose.
        let are_outlines_areas = options.are_outlines_areas && !lines.squares.is_empty();
        let options = IsometricOptions { are_outlines_areas, ..*options };
        Self::least_strained(surface, drawing, lines, anchor, &options, fork)
    }

    /// The drawing as it is, if it is on the part and needs no correction: what is under its ink is a plane.
    fn true_as_drawn(
        surface: &FittedSurface,
        ink: &Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
    ) -> Option<Self> {
        let mut as_drawn = IsometricMap::as_drawn(ink, anchor, options);
        as_drawn.instead = None;
        let is_true = is_on_part(ink, surface) && as_drawn.is_true(&surface.nurbs, ink);
        is_true.then_some(Self::Isometric(as_drawn))
    }

    /// The map that the options ask for, if it is not worse than the drawing as it is in what they keep first. `ink` is the
    /// drawing with the areas of its outlines.
    fn least_strained(
        surface: &FittedSurface,
        drawing: (&Pattern, &dyn Fn(&str) -> bool),
        ink: Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
        fork: &dyn Fork,
    ) -> Result<Self, MapError> {
        let (map, ink) = match Self::weighed(surface, drawing, ink.clone(), anchor, options, fork) {
            Ok(found) => found,
            // The search starts at the anchor, which may be on a boss inside a dial.
            Err(error) => return Self::true_as_drawn(surface, &ink, anchor, options).ok_or(error),
        };
        let (nurbs, first) = (&surface.nurbs, options.first);
        let as_drawn = IsometricMap::as_drawn(&ink, anchor, options);
        let is_worse = |map: &IsometricMap| map.is_worse_than(&as_drawn, nurbs, &ink, first);
        if !is_worse(&map) || !is_on_part(&ink, surface) {
            return Ok(Self::Isometric(map));
        }
        let areas = |map: &IsometricMap| map.left(Figure::Areas, nurbs, &ink);
        let most = areas(&map) + GIVEN_AREAS;
        let mut truest = map;
        if first == Some(Figure::Lengths) {
            // The weights of areas, angles and the paper are what keeps lines from being as true as they are in the drawing.
            for lengths in LENGTHS_ALONE {
                let options = options.nearly_lengths_alone(lengths);
                let Ok(mut map) = IsometricMap::solve_with_fork(nurbs, &ink, anchor, &options, fork) else {
                    continue;
                };
                map.instead = Some(Instead::LengthsAlone);
                if truest.is_worse_than(&map, nurbs, &ink, first) && areas(&map) <= most {
                    truest = map;
                }
                if !is_worse(&truest) {
                    return Ok(Self::Isometric(truest));
                }
            }
        }
        let is_truest = first == Some(Figure::Areas) || areas(&as_drawn) <= most;
        Ok(Self::Isometric(if is_truest { as_drawn } else { truest }))
    }

    /// The map that the options ask for, and the ink for which it was found.
    fn weighed(
        surface: &FittedSurface,
        (pattern, is_marked): (&Pattern, &dyn Fn(&str) -> bool),
        ink: Ink,
        anchor: FlatPoint,
        options: &IsometricOptions,
        fork: &dyn Fork,
    ) -> Result<(IsometricMap, Ink), MapError> {
        let solved =
            |ink: &Ink, options| IsometricMap::solve_with_fork(&surface.nurbs, ink, anchor, options, fork);
        if options.are_outlines_areas {
            return Ok((solved(&ink, options)?, ink));
        }
        let lines = coarse_ink_as_marked(pattern, is_marked);
        let of_lines = solved(&lines, options);
        let error = |map: &IsometricMap| map.left(Figure::Lengths, &surface.nurbs, &lines);
        if of_lines.as_ref().is_ok_and(|map| error(map) <= TRUE_LENGTHS) || lines == ink {
            return Ok((of_lines?, lines));
        }
        // Where lines leave much open, areas lead the search to a better map in some drawings.
        let with_areas = IsometricOptions { are_outlines_areas: true, ..*options };
        let map = match (of_lines, solved(&ink, &with_areas)) {
            (Ok(one), Ok(other)) if error(&other) < error(&one) => other,
            (Ok(one), _) => one,
            (Err(_), other) => other?,
        };
        Ok((map, lines))
    }

    /// With a tolerance, mm, the map of a surface that is not within it of any cylinder may be that of a few points. Its residual is
    /// above the tolerance, too.
    fn unroll_cylinder(
        surface: &FittedSurface,
        ink: &Ink,
        anchor: FlatPoint,
        tolerance: Option<f64>,
    ) -> Result<Self, MapError> {
        let height = surface.nurbs.height(anchor.coords().into());
        unroll(surface, ink, tolerance, |patch| {
            let patch = patch.map_err(CylinderError::from)?;
            let fit =
                CylinderFit::known(surface.known(), &patch).map_or_else(|| CylinderFit::to(&patch), Ok)?;
            Ok(Self::Cylinder(CylinderMap::new(fit.cylinder, anchor, height)?, fit))
        })
    }

    /// The tolerance is that of [`Self::unroll_cylinder`].
    fn unroll_cone(
        surface: &FittedSurface,
        ink: &Ink,
        anchor: FlatPoint,
        tolerance: Option<f64>,
    ) -> Result<Self, MapError> {
        let height = surface.nurbs.height(anchor.coords().into());
        let reach = reach(ink, anchor);
        unroll(surface, ink, tolerance, |patch| {
            let patch = patch.map_err(ConeError::from)?;
            let fit = ConeFit::known(surface.known(), &patch).map_or_else(|| ConeFit::to(&patch), Ok)?;
            Ok(Self::Cone(ConeMap::new(fit.cone, anchor, height, reach)?, fit))
        })
    }

    /// Largest distance of the part from the unrolled primitive, mm; `None` for maps without a primitive.
    pub fn fit_residual(&self) -> Option<f64> {
        match self {
            Self::Cylinder(_, fit) => Some(fit.residual),
            Self::Cone(_, fit) => Some(fit.residual),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => None,
        }
    }

    /// Whether the surface is a cylinder or cone with a radius that is known well: that of a part's file or of settings, or that of the
    /// part beside the ink, too.
    pub fn is_determined(&self) -> bool {
        match self {
            Self::Cylinder(_, fit) => fit.is_determined,
            Self::Cone(_, fit) => fit.is_determined,
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => false,
        }
    }

    /// The same map, whose radius is determined, with the residual of the points of a patch.
    fn determined(self, patch: &SampledPatch) -> Self {
        match self {
            Self::Cylinder(map, CylinderFit { cylinder, .. }) => {
                let residual = patch.largest_distance(|point| cylinder.distance(point));
                Self::Cylinder(map, CylinderFit { cylinder, residual, is_determined: true })
            }
            Self::Cone(map, ConeFit { cone, .. }) => {
                let residual = patch.largest_distance(|point| cone.distance(point));
                Self::Cone(map, ConeFit { cone, residual, is_determined: true })
            }
            other => other,
        }
    }

    /// The distance of a point along the axis of a cylinder or cone, mm.
    fn along(&self, point: &Point3<f64>) -> Option<f64> {
        match self {
            Self::Cylinder(map, _) => Some((point - map.cylinder.center).dot(&map.cylinder.axis)),
            Self::Cone(map, _) => Some((point - map.cone.apex).dot(&map.cone.axis)),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => None,
        }
    }

    /// The range of the points of a patch along the axis, mm.
    fn ends_of(&self, patch: &SampledPatch) -> std::ops::RangeInclusive<f64> {
        let along = patch.points.iter().filter_map(|point| self.along(point));
        let [low, high] = along
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], along| [low.min(along), high.max(along)]);
        low..=high
    }

    /// Half the angle over which the points of a patch reach round the axis, rad.
    fn half_turn(&self, patch: &SampledPatch) -> f64 {
        let outward = || patch.points.iter().filter_map(|point| self.outward(*point));
        let mean = outward().sum::<Vector3<f64>>();
        outward().map(|outward| outward.angle(&mean)).fold(0.0, f64::max)
    }

    /// The angle from the x of the drawing's plane to the direction round the axis of a cylinder or cone, at the anchor, rad;
    /// of the two senses of the direction the one nearer to x, from −89° to 91°. `None` for maps without an axis.
    pub fn round_angle(&self) -> Option<f64> {
        let angle = match self {
            Self::Cylinder(map, _) => map.round_angle(),
            Self::Cone(map, _) => map.round_angle(),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => return None,
        };
        // The bounds are off a right angle, where an upright axis would make the choice one of rounding.
        let below = 1f64.to_radians();
        Some((angle + FRAC_PI_2 - below).rem_euclid(PI) - FRAC_PI_2 + below)
    }

    /// Whether the map is for comparison and not for the best lengths.
    pub fn is_for_comparison(&self) -> bool {
        matches!(self, Self::MappingDomain(_) | Self::Floater(_) | Self::Plain)
    }

    /// The image of a point of the drawing in the view.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        match self {
            Self::Isometric(map) => map.point(at),
            Self::Cylinder(map, _) => map.point(at),
            Self::Cone(map, _) => map.point(at),
            Self::MappingDomain(map) => map.point(at),
            Self::Floater(map) => map.point(at),
            Self::Plain => at.coords().into(),
        }
    }

    /// The point of a cylinder or cone onto which a point of the drawing is mapped, mm, in the frame of the view, also on the
    /// side that faces away from the laser; `None` for maps without an axis.
    pub fn point_round(&self, at: FlatPoint) -> Option<Point3<f64>> {
        match self {
            Self::Cylinder(map, _) => Some(map.point_on_part(at)),
            Self::Cone(map, _) => Some(map.point_on_part(at)),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => None,
        }
    }

    /// The unit direction out of a cylinder or cone at a point of it (mm, in the frame of the view); `None` for maps without an
    /// axis.
    pub fn outward(&self, at: Point3<f64>) -> Option<Vector3<f64>> {
        match self {
            Self::Cylinder(map, _) => Some(map.cylinder.outward(&at)),
            Self::Cone(map, _) => Some(map.cone.outward(&at)),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => None,
        }
    }

    /// Unit normal of the part at the image of a point of the drawing, in the frame of the view. On a cylinder or
    /// cone its z component is negative where the surface faces away from the laser; with other maps the surface
    /// behind the horizon is not known.
    pub fn normal(&self, surface: &FittedSurface, at: FlatPoint) -> Vector3<f64> {
        self.height_and_normal(surface, at, self.point(at)).1
    }

    /// The height of the surface, mm, and the unit normal as [`normal`](Self::normal) states it at `image`, the image of a point
    /// of the drawing.
    pub fn height_and_normal(
        &self,
        surface: &FittedSurface,
        at: FlatPoint,
        image: ViewPoint,
    ) -> (f64, Vector3<f64>) {
        match self {
            Self::Cylinder(map, _) => (surface.nurbs.height(image), map.normal(at)),
            Self::Cone(map, _) => (surface.nurbs.height(image), map.normal(at)),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => {
                let jet = surface.jet(image);
                (jet.height, Vector3::new(-jet.gradient.x, -jet.gradient.y, 1.0).normalize())
            }
        }
    }
}

/// Unrolls twice. The primitive under the middle of the drawing shows where the drawing is mapped to, which
/// is nearer to the middle than it was drawn. There the primitive is fitted again, and its residual is
/// measured.
///
/// Under narrow ink, a small residual leaves the radius open: a strip of 8 mm of a can that bends by a tenth
/// less differs by no more than the tolerance. If the surface beside the ink and the surface under it are on
/// one primitive, it determines the radius, and its primitive is used.
fn unroll(
    surface: &FittedSurface,
    ink: &Ink,
    tolerance: Option<f64>,
    find: impl Fn(Result<SampledPatch, TooFewPoints>) -> Result<LengthTrueMap, MapError>,
) -> Result<LengthTrueMap, MapError> {
    let rough = find(SampledPatch::roughly_under(surface, &ink.extents.scaled(0.5)))?;
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]).chain(ink.dots.iter().copied());
    let reached = Extents::of(ends.map(|end| rough.point(end).coords()));
    if let Some(tolerance) = tolerance {
        // If all points are within the tolerance of a primitive, the mean square of a few is below its square for the primitive
        // that fits these best, and the largest of their distances below this.
        let largest = tolerance * (FEW_POINTS as f64).sqrt();
        let few = find(SampledPatch::roughly_under(surface, &reached))?;
        if few.fit_residual().is_some_and(|residual| residual > largest) {
            return Ok(few);
        }
    }
    let patch = SampledPatch::under(surface, &reached);
    let narrow = find(patch.clone())?;
    let is_near = |map: &LengthTrueMap, times: f64| {
        map.fit_residual().is_some_and(|residual| residual <= times * Method::EXACT_TOLERANCE)
    };
    let (Ok(patch), true, false) = (patch, is_near(&narrow, 1.0), narrow.is_determined()) else {
        return Ok(narrow);
    };
    let ends = narrow.ends_of(&patch);
    let beside = SampledPatch::under(surface, &reached.scaled(WIDER)).map(|wide| {
        wide.kept(|point| {
            // Rims are not far beyond the ink's ends.
            narrow.along(point).is_some_and(|along| ends.contains(&along))
        })
    });
    let turns = |patch: &SampledPatch| narrow.half_turn(patch);
    let Some(wide) = beside.ok().filter(|wide| {
        wide.points.len() >= patch.points.len() / 2 && turns(wide) >= (WIDE_ENOUGH * turns(&patch)).min(WIDE)
    }) else {
        return Ok(narrow);
    };
    match find(Ok(wide)) {
        Ok(map) if is_near(&map, WIDER) => {
            let map = map.determined(&patch);
            let is_confirmed = is_near(&map, 1.0) && is_on_vertices(&map, surface, ink, &reached);
            Ok(if is_confirmed { map } else { narrow })
        }
        _ => Ok(narrow),
    }
}

/// Whether the part is on the primitive of a map as far beyond the ink as the facets reach there whose surface is not known: only
/// their vertices show it, and within a facet any surface is nearly a cylinder.
fn is_on_vertices(map: &LengthTrueMap, surface: &FittedSurface, ink: &Ink, reached: &Extents) -> bool {
    let ends = ink.pieces.iter().map(|piece| piece.from).chain(ink.dots.iter().copied());
    let reach = ends.map(|end| surface.uncertainty(map.point(end)).reach()).fold(0.0, f64::max);
    let around = SampledPatch::under(surface, &reached.grown(reach));
    let residual = around.map(|around| map.clone().determined(&around).fit_residual());
    reach == 0.0 || residual.is_ok_and(|off| off.is_some_and(|off| off <= WIDER * Method::EXACT_TOLERANCE))
}

/// The surface that determines the radius is this many times as wide as the ink, round the axis. Its residual
/// may be this many times as large.
const WIDER: f64 = 2.0;
/// The surface need not be known over [`WIDER`] times the ink. A surface is enough if it turns by this many
/// times the turn under the ink, or by [`WIDE`].
const WIDE_ENOUGH: f64 = 1.5;
/// A surface with at least this half angle, rad, determines the radius ([`WIDE_ENOUGH`]). Over this angle, a
/// residual of the tolerance changes a radius of 5 mm or more by less than 1 %.
const WIDE: f64 = 0.5;

/// Distance from the anchor to the farthest corner of the drawing, mm.
fn reach(ink: &Ink, anchor: FlatPoint) -> f64 {
    let farthest = (ink.extents.max - anchor.coords()).sup(&(anchor.coords() - ink.extents.min));
    farthest.norm()
}

/// Whether all ink is on the part without a correction.
pub fn is_on_part(ink: &Ink, surface: &FittedSurface) -> bool {
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let mut places = ends.chain(ink.squares.iter().chain(&ink.dots).copied());
    places.all(|at| surface.field.is_surface(at.coords().into()))
}

/// Lengths are true if they are wrong by at most this share.
const TRUE_LENGTHS: f64 = 1e-3;
/// Factors on the weight of lengths, tried one after the other until the lines are as true as in the drawing as it is.
const LENGTHS_ALONE: [f64; 3] = [10.0, 100.0, 1000.0];
/// To make lines or angles truer, the sizes of inked areas may change by at most this share more.
const GIVEN_AREAS: f64 = 0.01;

/// Maximum length of the pieces of lines for the solver, mm. Its samples are half as dense in each direction
/// as those for the quality results, which is enough for the reference cases to reach their expected values.
const COARSE_PIECE: f64 = 2.0 * quality::PIECE;
/// Side of the squares of the inked area for the solver, mm; half as dense as for the quality results
/// ([`COARSE_PIECE`]).
const COARSE_SQUARE: f64 = 2.0 * quality::SQUARE;

/// Samples for the solver.
fn coarse_ink(pattern: &Pattern, is_marked: impl Fn(&str) -> bool) -> Ink {
    isometric::several_in_cell(|factor| {
        Ink::sample(pattern, &is_marked, factor * COARSE_PIECE, factor * COARSE_SQUARE)
    })
}

/// The same without the areas inside outlines that nothing fills.
fn coarse_ink_as_marked(pattern: &Pattern, is_marked: impl Fn(&str) -> bool) -> Ink {
    isometric::several_in_cell(|factor| {
        Ink::sample_as_marked(pattern, &is_marked, factor * COARSE_PIECE, factor * COARSE_SQUARE)
    })
}
