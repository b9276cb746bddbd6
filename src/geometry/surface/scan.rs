//! From a scanner's points to a height field: the surfaces that face the laser, smoothed according to the noise.
//!
//! A point cloud is processed like a mesh (sampled heights, then [`FittedSurface::of_field`]), but the heights are
//! those of one penalised spline for each surface in the scan. Part and table are smoothed separately, and between
//! them there is no surface. Chuang, Shape correction for laser marking, 2023, section 4.1.1, filters such a scan
//! with a low-pass filter at a quarter of the Nyquist frequency; [`Smoothing::LowPass`] is that filter.
//!
//! [`FittedSurface::of_field`]: super::fit::FittedSurface::of_field

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector2};

use crate::geometry::adjacency::weld;
use crate::geometry::facing_part::Uncertainty;
use crate::geometry::fork::{Fork, InTurn, mapped, start};
use crate::geometry::height_field::{HeightField, Node, STEEPEST_SURFACE};
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::space::{Extents, View, ViewPoint};
use crate::geometry::surface::nurbs::NurbsSurface;

use cells::{Cells, is_surrounded, octant};
pub use error::ScanError;
use penalised::Smoothed;
use round::Recognised;
pub use round::ScanForm;
pub use smoothing::Smoothing;
use visible::{ROUGHEST, Region};

mod error;
mod smoothing;
mod behind;
mod cells;
mod visible;
mod penalised;
mod round;

/// Maximum number of steps of the height field along its longer side, the same as for a mesh.
const MAX_STEPS: f64 = 512.0;
/// A node needs points on all sides within this distance, in units of the point spacing, if no
/// width of gaps is given: gaps are bridged, but rims are not extended.
const REACH: f64 = 3.5;
/// Where points are sparse, the point spacing for [`REACH`] is this share of the local spacing, if that is
/// larger than the usual spacing. [`SPARSEST`] limits it.
const LOCAL_SPACING: f64 = 0.8;
/// The point spacing by [`LOCAL_SPACING`] is at most this many times the usual one.
const SPARSEST: f64 = 2.0;
/// The distance by [`REACH`] is at most this many nodes, which limits the time.
const MAX_REACH: f64 = 40.0;
/// A node this close to a point needs no other points, in units of the point spacing.
const AT_POINT: f64 = 0.5;

/// The noise that is left plus the bend that smoothing adds, in units of the noise that is left.
const SMOOTHING_AND_NOISE: f64 = 1.5;

/// The scatter of the points explains differences of slopes up to this many times the error of the slope that
/// it leaves.
const OF_SCATTER: f64 = 2.0;

/// A smoothed scan.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothedScan {
    /// Heights of the smoothed surfaces; walls between two of them.
    pub field: HeightField,
    /// For each node of the field, how far the part may be from it because the points of its surface scatter.
    pub uncertainties: Vec<Uncertainty>,
    /// Measurements of the scan's quality.
    pub quality: ScanQuality,
    /// The cylinders and cones on which all points of a surface are, but for their noise. There, the field has their heights.
    pub known: Vec<ScanForm>,
}

/// Measurements of the quality of a scan.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ScanQuality {
    /// Number of points; points at the place of another one are skipped.
    pub points: usize,
    /// Number of points used for a surface.
    pub used: usize,
    /// Number of points below or behind a surface, or facing away from the laser.
    pub hidden: usize,
    /// Number of outliers, strays and debris.
    pub dropped: usize,
    /// Distance between points in the view, mm.
    pub spacing: f64,
    /// Distance between samples of the height field, mm.
    pub step: f64,
    /// Separate surfaces, ordered by the number of points, largest first.
    pub regions: Vec<ScanRegion>,
}

/// One surface of a scan.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ScanRegion {
    /// Number of points used for it.
    pub points: usize,
    /// Its bounding rectangle in the view, mm.
    pub extents: Extents,
    /// Lowest and highest sample, mm.
    pub heights: [f64; 2],
    /// Standard deviation of its points from the smoothed surface, mm.
    pub noise: f64,
    /// Wavelength that the smoothing halves, mm; `None` without smoothing.
    pub wavelength: Option<f64>,
    /// Largest mean deviation of neighbouring points that noise does not explain, mm, for example at a rounded edge.
    pub departure: f64,
    /// Position of that deviation.
    pub departure_at: ViewPoint,
}

impl SmoothedScan {
    /// The surfaces of a scan that face the laser, smoothed.
    ///
    /// Points whose own normals face away are skipped. Of several surfaces above one another the uppermost is used,
    /// if it has more than single points. Outliers are dropped and small gaps are bridged. Where the points do not differ from a
    /// cylinder or cone by more than their noise, the surface is that form.
    ///
    /// # Errors
    /// When there are too few points, when they are in one line, or when they form no surface; see [`ScanError`].
    pub fn new(cloud: &PointCloud, view: &View, smoothing: Smoothing) -> Result<Self, ScanError> {
        Self::bridged(cloud, view, smoothing, None, &InTurn)
    }

    /// The same with gaps bridged that are up to `widest` mm wide; `None` bridges those of a few points. `fork` may smooth halves of
    /// the surfaces at once.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn bridged(
        cloud: &PointCloud,
        view: &View,
        smoothing: Smoothing,
        widest: Option<f64>,
        fork: &dyn Fork,
    ) -> Result<Self, ScanError> {
        let faces_away =
            |at: usize| cloud.normals().get(at).is_some_and(|&normal| view.vector(normal).z < 0.0);
        let points = cloud.points().iter().enumerate().filter(|(at, _)| !faces_away(*at));
        let points: Vec<Point3<f64>> = points.map(|(_, &point)| view.point(point)).collect();
        let away = cloud.points().len() - points.len();
        let points = without_copies(points);
        let seen = visible::separate_surfaces(&points)?;
        let points_left = points.len();
        drop(points);
        let smooth = |region: Region| -> Result<(Region, Smoothed), ScanError> {
            let smoothed = start(fork, || penalised::smooth(&region, &seen.cells, smoothing, fork))?;
            Ok((region, smoothed))
        };
        let surfaces = seen.regions.into_iter().map(smooth).collect::<Result<Vec<_>, _>>()?;
        let regions = surfaces.iter().map(|(region, smoothed)| ScanRegion::new(region, smoothed, smoothing));
        let regions: Vec<ScanRegion> = regions.collect();
        // Points that fill a volume have a top, too, from which most of them are far away.
        if regions.first().is_some_and(|region| region.noise > ROUGHEST * seen.cells.side()) {
            return Err(ScanError::NoSurface { points: points_left });
        }
        let mut counts = vec![0; seen.cells.count()];
        for (region, smoothed) in &surfaces {
            let used = region.cells.iter().zip(&smoothed.is_used).filter(|(_, is_used)| **is_used);
            used.for_each(|(cell, _)| counts[*cell] += 1);
        }
        let sparseness = seen.cells.sparseness(|cell| counts[cell]);
        let (mut field, owners) = sampled(&surfaces, &seen.cells, &counts, &sparseness, widest);
        let of_surfaces: Vec<Uncertainty> =
            regions.iter().map(|region| region.uncertainty(seen.cells.spacing())).collect();
        let recognised = |((region, smoothed), scatter): (&(Region, Smoothed), &Uncertainty)| {
            let slope = f64::from(scatter.slope);
            (smoothing == Smoothing::Auto)
                .then(|| Recognised::of(region, smoothed, &seen.cells, slope))
                .flatten()
        };
        let round: Vec<Option<Recognised>> =
            start(fork, || surfaces.iter().zip(&of_surfaces).map(recognised).collect());
        let (grid, columns) = (*field.grid(), field.size().0);
        let on_form = |node: usize, height: f64| {
            let form = round.get(owners[node])?.as_ref()?;
            form.at(grid.position(node % columns, node / columns), height)
        };
        field.adjust(|node, height| on_form(node, height).map_or(height, |(height, _)| height));
        let at_node = |node: usize| {
            let Some((_, smoothed)) = surfaces.get(owners[node]) else { return Uncertainty::NONE };
            let (wave, scatter) =
                (regions[owners[node]].wave(seen.cells.spacing()), of_surfaces[owners[node]]);
            let at = grid.position(node % columns, node / columns);
            let times = seen.cells.cell_at(at.coords()).map_or(1.0, |cell| sparseness[cell]);
            let (wave, scatter) = where_sparse(times, wave, scatter);
            if let Some((_, off)) = height(field.nodes()[node]).and_then(|height| on_form(node, height)) {
                return Uncertainty::over((off * times) as f32, wave as f32);
            }
            scatter.largest(between_points(smoothed, scatter, wave, at))
        };
        let uncertainties = mapped(fork, owners.len(), at_node);
        let used = regions.iter().map(|region| region.points).sum();
        let hidden = away + seen.hidden;
        let quality = ScanQuality {
            points: points_left + away,
            used,
            hidden,
            dropped: points_left + away - used - hidden,
            spacing: seen.cells.spacing(),
            step: field.step(),
            regions,
        };
        let known = round.iter().flatten().map(Recognised::known).collect();
        Ok(Self { field, uncertainties, quality, known })
    }
}

impl ScanRegion {
    /// A smoothing spline passes waves of the wave number k with 1/(1 + (k/k₀)⁴), where k₀ belongs to the wavelength that
    /// it halves. White noise with the standard deviation σ in points that each cover the area A leaves the deviations
    /// σ√A·k₀²/√(16π) of the slope in a direction and σ√A·k₀/4 of the height. The smoothing chosen from the points bends
    /// the surface by about as much as the noise that it leaves.
    fn uncertainty(&self, spacing: f64) -> Uncertainty {
        let wave_number = TAU / self.wave(spacing);
        let noise = SMOOTHING_AND_NOISE * self.noise * spacing;
        Uncertainty {
            slope: (noise * wave_number.powi(2) / (16.0 * PI).sqrt()) as f32,
            height: (noise * wave_number / 4.0) as f32,
        }
    }

    /// The shortest wave that the surface follows, mm: without smoothing, it is two points long.
    fn wave(&self, spacing: f64) -> f64 {
        self.wavelength.unwrap_or(0.0).max(2.0 * spacing)
    }

    fn new(region: &Region, smoothed: &Smoothed, smoothing: Smoothing) -> Self {
        let used = || region.points.iter().zip(&smoothed.is_used).filter(|(_, is_used)| **is_used);
        let heights = used().map(|(point, _)| smoothed.nurbs.height(ViewPoint::new(point.x, point.y)));
        let widen = |[low, high]: [f64; 2], height: f64| [low.min(height), high.max(height)];
        Self {
            points: smoothed.used,
            extents: Extents::of(used().map(|(point, _)| point.coords.xy())),
            heights: heights.fold([f64::INFINITY, f64::NEG_INFINITY], widen),
            noise: smoothed.noise,
            wavelength: (smoothing != Smoothing::None).then_some(smoothed.wavelength),
            departure: smoothed.departure.0,
            departure_at: smoothed.departure.1,
        }
    }
}

/// The shortest wave, mm, and what a smoothing spline leaves, where the points are `times` times as far apart
/// as usual. The weight of its penalty makes the wave that it halves grow with the third root of `times`, and
/// the scatter of the slope grows as much. The spline also bends the surface more.
fn where_sparse(times: f64, wave: f64, Uncertainty { slope, height }: Uncertainty) -> (f64, Uncertainty) {
    let longer = times.cbrt();
    let left = Uncertainty {
        slope: (f64::from(slope) * longer * longer) as f32,
        height: (f64::from(height) * times) as f32,
    };
    (wave * longer, left)
}

/// The points without those at the place of one before: one measurement, or the corner of several triangles.
fn without_copies(mut points: Vec<Point3<f64>>) -> Vec<Point3<f64>> {
    let mut places = weld(&points).into_iter();
    let mut next = 0;
    points.retain(|_| {
        let is_first = places.next() == Some(next);
        next += u32::from(is_first);
        is_first
    });
    points
}

/// How far the surface may be from the part between its points: every other point leaves at least as much
/// open as all points do. Where the slopes of these surfaces agree by chance, their heights differ, and the
/// other way round. The shortest `wave` of both, mm, relates one to the other. Differences that the scatter
/// of the points explains are not added again.
fn between_points(smoothed: &Smoothed, scatter: Uncertainty, wave: f64, at: ViewPoint) -> Uncertainty {
    let normal = |nurbs: &NurbsSurface| nurbs.gradient(at).fixed_resize::<3, 1>(-1.0);
    let (height, facing) = (smoothed.nurbs.height(at), normal(&smoothed.nurbs));
    let off =
        |half: &NurbsSurface| normal(half).angle(&facing).max(4.0 * (half.height(at) - height).abs() / wave);
    let slope = smoothed.of_halves.iter().map(off).fold(0.0, f64::max);
    let explained = OF_SCATTER * f64::from(scatter.slope);
    Uncertainty::over((slope * slope - explained * explained).max(0.0).sqrt() as f32, wave as f32)
}

/// The height field of all surfaces: nodes that have points of a surface on all sides, within `widest` mm or a few points; and for
/// each node the number of its surface.
fn sampled(
    surfaces: &[(Region, Smoothed)],
    cells: &Cells,
    counts: &[usize],
    sparseness: &[f64],
    widest: Option<f64>,
) -> (HeightField, Vec<usize>) {
    let used = |(region, smoothed): &(Region, Smoothed)| {
        let points = region.points.iter().zip(&region.cells).zip(&smoothed.is_used);
        let used = points.filter(|(_, is_used)| **is_used);
        used.map(|((point, cell), _)| (point.coords.xy(), *cell)).collect::<Vec<_>>()
    };
    let placed: Vec<Vec<(Vector2<f64>, usize)>> = surfaces.iter().map(used).collect();
    let usual = cells.spacing();
    let local = |(spacing, times): (f64, f64)| {
        REACH * (LOCAL_SPACING * spacing).clamp(usual, SPARSEST * usual).max(times * usual)
    };
    let spacings = cells.local_spacings(counts).into_iter().zip(sparseness.iter().copied());
    let reaches: Vec<f64> = spacings.map(local).collect();
    let extents = Extents::of(placed.iter().flatten().map(|(point, _)| *point));
    let longer = extents.size().max();
    // Two samples per knot distance, as the fit uses them, but not more than for a mesh.
    let knots = surfaces.iter().map(|(_, smoothed)| smoothed.nurbs.knots().0.step());
    let step = (knots.fold(f64::INFINITY, f64::min) / 2.0).max(longer / MAX_STEPS);
    let first = (extents.min / step).map(f64::floor);
    let last = (extents.max / step).map(f64::ceil);
    let (columns, rows) = ((last.x - first.x) as usize + 1, (last.y - first.y) as usize + 1);
    let origin = first * step;

    let mut nodes = vec![Node::Empty; columns * rows];
    let mut owners = vec![usize::MAX; columns * rows];
    let mut sides = vec![0u8; columns * rows];
    let at_point = AT_POINT * usual / step;
    for (owner, ((_, smoothed), points)) in surfaces.iter().zip(&placed).enumerate() {
        sides.fill(0);
        for (point, cell) in points {
            let reach = (widest.unwrap_or(reaches[*cell]) / step).clamp(1.0, MAX_REACH);
            mark_sides(&mut sides, (point - origin) / step, [columns, rows], [reach, at_point]);
        }
        let mut covered: Vec<bool> = sides.iter().map(|sides| is_surrounded(*sides)).collect();
        let smallest = |node: usize| {
            let at = origin + Vector2::new((node % columns) as f64, (node / columns) as f64) * step;
            let apart = usual * cells.cell_at(at).map_or(1.0, |cell| sparseness[cell]);
            (widest.map_or(apart, |widest| widest.min(apart)) / step) as usize
        };
        fill_gaps(&mut covered, columns, smallest);
        for (index, _) in covered.iter().enumerate().filter(|(_, covered)| **covered) {
            let at = origin + Vector2::new((index % columns) as f64, (index / columns) as f64) * step;
            let jet = smoothed.nurbs.jet(at.into());
            let node = match jet.tilt() <= STEEPEST_SURFACE {
                true => Node::Surface(jet.height),
                false => Node::Wall(jet.height),
            };
            if height(nodes[index]).is_none_or(|other| other < jet.height) {
                (nodes[index], owners[index]) = (node, owner);
            }
        }
    }
    separate(&mut nodes, &owners, columns);
    let field = HeightField::new(origin, step, columns.max(2), rows.max(2), nodes)
        .expect("a surface of 64 points that are not collinear has columns and rows");
    (field, owners)
}

/// Covers a gap of at most `most` nodes along and across; one node of the gap is given. By chance, random
/// points leave such gaps.
fn fill_gaps(covered: &mut [bool], columns: usize, most: impl Fn(usize) -> usize) {
    let mut is_seen = covered.to_vec();
    let (mut open, mut gap) = (Vec::new(), Vec::new());
    for start in 0..covered.len() {
        if std::mem::replace(&mut is_seen[start], true) {
            continue;
        }
        gap.clear();
        open.push(start);
        let [mut low, mut high] = [[usize::MAX; 2], [0; 2]];
        while let Some(node) = open.pop() {
            gap.push(node);
            let place = [node % columns, node / columns];
            low = [low[0].min(place[0]), low[1].min(place[1])];
            high = [high[0].max(place[0]), high[1].max(place[1])];
            for row in place[1].saturating_sub(1)..(place[1] + 2).min(covered.len() / columns) {
                for column in place[0].saturating_sub(1)..(place[0] + 2).min(columns) {
                    let next = row * columns + column;
                    if !std::mem::replace(&mut is_seen[next], true) {
                        open.push(next);
                    }
                }
            }
        }
        let is_inside =
            low.iter().all(|low| *low > 0) && high[0] + 1 < columns && high[1] + 1 < covered.len() / columns;
        let widest = low.iter().zip(high).map(|(low, high)| high - low).max().unwrap_or(0);
        if is_inside && widest < most(start) {
            gap.iter().for_each(|&node| covered[node] = true);
        }
    }
}

/// Marks, at the nodes round a point (in steps of the grid), the octant in which the point is: one bit for each
/// octant, anticlockwise.
fn mark_sides(
    sides: &mut [u8],
    point: Vector2<f64>,
    [columns, rows]: [usize; 2],
    [reach, at_point]: [f64; 2],
) {
    let range = |at: f64, count: usize| {
        let from = (at - reach).ceil().max(0.0) as usize;
        let to = ((at + reach).floor() + 1.0).clamp(0.0, count as f64) as usize;
        from..to
    };
    for row in range(point.y, rows) {
        for column in range(point.x, columns) {
            let away = point - Vector2::new(column as f64, row as f64);
            let distance = away.norm();
            let side = &mut sides[row * columns + column];
            if distance <= at_point {
                *side = u8::MAX;
            } else if distance <= reach {
                *side |= octant(away);
            }
        }
    }
}

/// Marks the nodes on both sides of a border between two surfaces as walls, because there is a cliff.
fn separate(nodes: &mut [Node], owners: &[usize], columns: usize) {
    let mut wall = |first: usize, second: usize| {
        let (Some(a), Some(b)) = (height(nodes[first]), height(nodes[second])) else { return };
        if owners[first] != owners[second] {
            (nodes[first], nodes[second]) = (Node::Wall(a), Node::Wall(b));
        }
    };
    for index in 0..owners.len() {
        if index % columns + 1 < columns {
            wall(index, index + 1);
        }
        if index + columns < owners.len() {
            wall(index, index + columns);
        }
    }
}

fn height(node: Node) -> Option<f64> {
    match node {
        Node::Empty => None,
        Node::Wall(height) | Node::Surface(height) => Some(height),
    }
}
