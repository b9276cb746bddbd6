//! Marks that go round a cylinder or cone: the drawing is divided into tiles, and each is moved to the side that faces the
//! laser. All tiles together are then corrected like one drawing, with the layers of each tile named after its angle.

use nalgebra::{Vector2, Vector3};

use super::placing::PlacedPattern;
use super::{LearnedPart, PatternInput, Pipeline, PipelineError, checks, comments, profile, program};
use crate::cache::CachedSurface;
use crate::config::{JobSettings, Sku, Tiles, TilesAs};
use crate::formats::pattern;
use crate::formats::pattern::is_same_layer;
use crate::geometry::correction::Projection;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::{LengthTrueMap, Method, quality};
use crate::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::pattern::{Affine, Color, Layer, Path, Pattern, Segment, Shape, Source};
use crate::geometry::rotary::{self, Item, Limits, Tiling, Unrolled};
use crate::geometry::space::{Extents, FlatPoint, ViewPoint};
use crate::preview::{TilePicture, TilesPicture};
use crate::reason::{Notice, Reason};
use crate::report::{ROTARY_SCHEMA, RotaryReport, RotaryTable, TileReport, corners};

use super::landmarks::Lift;

/// The part is recognised within this share of its size in the view, from the anchor: about 45° of a cylinder.
const RECOGNISED: f64 = 0.35;
/// Number of positions along the axis at which a tile is checked.
const POSITIONS: f64 = 64.0;
/// Steps in which the width of a tile is found, rad.
const STEP: f64 = 0.25 * std::f64::consts::PI / 180.0;
/// The part is not marked farther from the middle of a tile than this, rad.
const FARTHEST: f64 = 89.0 * std::f64::consts::PI / 180.0;
/// The largest angle of a tile that is not known between the samples, rad.
const MARGIN: f64 = 0.02 * std::f64::consts::PI / 180.0;
/// A tile must be at least this wide, rad.
const NARROWEST: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// The ends of a drawing that is wider than the circumference by this are on each other, mm.
const CLOSING: f64 = 0.01;

/// A placed drawing with its map: divided into tiles, if the settings ask for it.
pub(super) struct Rolled {
    pub(super) pattern: PlacedPattern,
    pub(super) map: LengthTrueMap,
    /// The settings, with the names of the ink layers of all tiles.
    pub(super) settings: JobSettings,
    pub(super) tiles: Option<TiledMark>,
}

/// A drawing that was divided into tiles.
pub(super) struct TiledMark {
    /// The placed drawing before it was divided.
    pub(super) drawn: Pattern,
    unrolled: Unrolled,
    tiling: Tiling,
    tiles: Vec<Tile>,
    axis: Vector3<f64>,
    axis_point: [f64; 3],
    radius: f64,
    widest: f64,
    overlap: f64,
    ink_mm: f64,
}

/// A tile, moved to the side that faces the laser.
struct Tile {
    /// The angle of the rotary axis, degrees, with three decimals.
    angle_deg: f64,
    name: String,
    /// The indices of its layers in the drawing of all tiles, each with that of the layer it comes from.
    layers: Vec<(usize, usize)>,
}

/// One file of a mark in tiles.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TileFile {
    /// The tile's name, such as `R+045.000`.
    pub name: String,
    /// The DXF file.
    pub dxf: Vec<u8>,
    /// The drawing in the file.
    pub drawing: MarkingDrawing,
}

impl Pipeline {
    /// The map of a placed drawing from the file `name` on the part round it, of the `whole` part. The drawing is divided into tiles
    /// if the settings ask for it.
    ///
    /// # Errors
    /// When there is no map, or the drawing cannot be marked in tiles.
    pub(super) fn rolled(
        pattern: PlacedPattern,
        learned: &LearnedPart,
        whole: &LearnedPart,
        settings: &JobSettings,
        name: &str,
    ) -> Result<Rolled, PipelineError> {
        let part = &learned.kept;
        if settings.rotary.tiles == Tiles::Off {
            let (pattern, map) = Self::mapped(pattern, learned, whole, settings, name)?;
            return Ok(Rolled { pattern, map, settings: settings.clone(), tiles: None });
        }
        let facts = pattern.facts.clone();
        let is_beside = !part.surface.field.is_surface(pattern.placing.place.coords().into());
        let beside = is_beside.then(|| pattern.clone());
        tiled(pattern, part, learned, settings).map_err(|reason| {
            let reason = match beside {
                Some(pattern) => turning(reason, &pattern, part, learned, settings),
                None => reason,
            };
            checks::doubting_unit(reason, &facts).in_file(name).into()
        })
    }
}

/// The reason for a drawing whose anchor is beside the side that faces the laser, with the place on that side where it can be
/// marked: the part turns, so that the place round the axis is a matter of its first angle.
fn turning(
    reason: Reason,
    pattern: &PlacedPattern,
    part: &CachedSurface,
    learned: &LearnedPart,
    settings: &JobSettings,
) -> Reason {
    if reason.code != "off-surface" || settings.part.view_source.frame().is_some() {
        return reason;
    }
    let field = &part.surface.field;
    let (place, middle) = (pattern.placing.place.coords(), field.extents().center().map(f64::round));
    // Beside the crest, at the same position along the axis; else in the middle of the part.
    let candidates = [
        Vector2::new(0.0, place.y),
        Vector2::new(place.x, 0.0),
        Vector2::new(middle.x, place.y),
        Vector2::new(place.x, middle.y),
        Vector2::zeros(),
        middle,
    ];
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let works = |place: &Vector2<f64>| {
        let mut moved = pattern.clone();
        let shift = Affine::rigid(pattern.placing.place, 0.0, FlatPoint::from(*place));
        moved.placing.place = FlatPoint::from(*place);
        moved.placed = pattern.placed.transformed(&shift);
        moved.ink = quality::sample(&moved.placed, is_ink);
        tiled(moved, part, learned, settings).is_ok()
    };
    let found = candidates.into_iter().filter(|place| field.is_surface((*place).into())).find(works);
    let Some(found) = found else { return reason };
    let [x, y] = [found.x + 0.0, found.y + 0.0];
    let remedy = format!(
        "Put the drawing on the side that faces the laser, `--place {x},{y}` (`place_mm = [{x}, {y}]` under [placement]): it fits round \
         the part there. The part turns, so that where it is round the axis depends only on the angle at which the rotary axis starts."
    );
    Reason { remedy, ..reason }
}

/// Finds the cylinder or cone, aligns the drawing to its axis, and divides it.
fn tiled(
    pattern: PlacedPattern,
    part: &CachedSurface,
    learned: &LearnedPart,
    settings: &JobSettings,
) -> Result<Rolled, Reason> {
    let domain = part.surface.nurbs.domain().size();
    let place = pattern.placing.place;
    let under = around(place, domain * RECOGNISED, &pattern.ink.extents);
    let map = recognised(part, &rectangle(&under), place, settings, &pattern.ink)?;
    let pattern = aligned(pattern, &map, settings);
    let first = Stage::new(&pattern, &map, part, settings)?;
    let window = first.window(learned, settings)?;
    // The cylinder or cone is that of the tiles, not of what is beside them.
    let corners = first.corners(&window);
    let map = recognised(part, &corners, place, settings, &pattern.ink)?;
    let pattern = aligned(pattern, &map, settings);
    let stage = Stage::new(&pattern, &map, part, settings)?;
    let window = stage.window(learned, settings)?;
    let (tiling, overlap) = stage.tiling(&window, settings)?;
    let tiles = stage.tiles(&tiling, &window, settings);
    let ink_mm = pattern.ink.length();
    let is_reversed = settings.rotary.is_reversed;
    let (placed, tiles, layers) = overlaid(&pattern.placed, &stage, (&tiling, overlap), tiles, is_reversed);
    let [axis, axis_point] = axis(&map, &stage.unrolled, settings);
    let mut settings = settings.clone();
    for names in [&mut settings.pattern.ink_layers, &mut settings.fill.layers].into_iter().flatten() {
        let is_named = |layer: &str| names.iter().any(|name| is_same_layer(name, layer));
        let of_tiles: Vec<String> = layers
            .iter()
            .filter(|(from, _)| pattern.placed.layers.get(*from).is_some_and(|layer| is_named(&layer.name)))
            .map(|(_, name)| name.clone())
            .collect();
        names.retain(|name| !pattern.placed.layers.iter().any(|layer| is_same_layer(&layer.name, name)));
        names.extend(of_tiles);
    }
    let ink = ink_of(&placed, &tiles, &settings);
    let mark = TiledMark {
        unrolled: stage.unrolled,
        radius: stage.radius,
        widest: window.widest,
        overlap: settings.rotary.overlap,
        tiling,
        tiles,
        axis,
        axis_point: axis_point.into(),
        ink_mm,
        drawn: pattern.placed,
    };
    let pattern = PlacedPattern { facts: pattern.facts, placing: pattern.placing, placed, ink };
    Ok(Rolled { pattern, map, settings, tiles: Some(mark) })
}

/// The rectangle round `place` with these half sides, mm, as far as there is ink.
fn around(place: FlatPoint, half: Vector2<f64>, ink: &Extents) -> Extents {
    let (min, max) = (place.coords() - half, place.coords() + half);
    let with_ink = Extents { min: min.sup(&ink.min), max: max.inf(&ink.max) };
    if with_ink.is_empty() { Extents { min, max }.scaled(0.3) } else { with_ink }
}

/// A drawing of one closed line.
fn outline(corners: &[FlatPoint]) -> Pattern {
    let next = corners.iter().skip(1).chain(corners.first());
    let sides = corners.iter().zip(next).map(|(from, to)| Segment::Line { from: *from, to: *to });
    let path = Path {
        layer: 0,
        color: Color::ByLayer,
        shape: Shape::Open(sides.collect()),
        region: None,
        source: Source { is_stroke: true, ..Source::default() },
    };
    Pattern { layers: vec![Layer { name: "0".into(), color: Color::Aci(7) }], paths: vec![path] }
}

fn rectangle(area: &Extents) -> Pattern {
    let Extents { min, max } = area;
    outline(&[
        FlatPoint::new(min.x, min.y),
        FlatPoint::new(max.x, min.y),
        FlatPoint::new(max.x, max.y),
        FlatPoint::new(min.x, max.y),
    ])
}

/// The cylinder or cone under a drawing.
fn recognised(
    part: &CachedSurface,
    under: &Pattern,
    place: FlatPoint,
    settings: &JobSettings,
    ink: &Ink,
) -> Result<LengthTrueMap, Reason> {
    let find = |method: Method| LengthTrueMap::find(&part.surface, under, |_| true, place, &method);
    // A reason states the extents of the drawing.
    let under_drawing = Ink { extents: ink.extents, ..quality::sample(under, |_| true) };
    let no_map = |error| {
        let ink =
            if part.surface.field.is_surface(ViewPoint::from(place.coords())) { &under_drawing } else { ink };
        checks::map_reason(&error, place, part, ink)
    };
    let map = match super::map_method::method(settings) {
        Method::Given(primitive) => find(Method::Given(primitive)).map_err(no_map)?,
        method @ (Method::Cylinder | Method::Cone) => find(method).map_err(no_map)?,
        Method::Auto { exact_tolerance, .. } => {
            let found = [Method::Cylinder, Method::Cone].map(find);
            let residual = |map: &LengthTrueMap| map.fit_residual().filter(|residual| residual.is_finite());
            let is_exact = |map: &&LengthTrueMap| residual(map).is_some_and(|far| far <= exact_tolerance);
            match found.iter().flatten().find(is_exact) {
                Some(map) => map.clone(),
                None => {
                    let nearest = found.iter().flatten().filter_map(residual).reduce(f64::min);
                    return Err(checks::not_round(nearest, exact_tolerance));
                }
            }
        }
        _ => return Err(checks::rotary_method(settings.correction.method)),
    };
    let is_hollow = match &map {
        LengthTrueMap::Cylinder(map, _) => map.is_hollow(),
        LengthTrueMap::Cone(map, _) => map.is_hollow(),
        _ => false,
    };
    if is_hollow { Err(checks::rotary_hollow()) } else { Ok(map) }
}

/// The drawing with its x along the direction round the axis, turned only by `rotate_deg`.
fn aligned(pattern: PlacedPattern, map: &LengthTrueMap, settings: &JobSettings) -> PlacedPattern {
    let PlacedPattern { facts, mut placing, placed, ink } = pattern;
    let turn = placing.turn_to_axis(map);
    if turn == 0.0 {
        return PlacedPattern { facts, placing, placed, ink };
    }
    placing.turn(turn);
    let placed = placed.transformed(&Affine::rigid(placing.place, turn, placing.place));
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let ink = quality::sample(&placed, is_ink);
    PlacedPattern { facts, placing, placed, ink }
}

/// The angles about the axis at which the laser can mark all ink, rad from the anchor.
struct Window {
    from: f64,
    to: f64,
    /// The angle that faces the laser.
    middle: f64,
    /// The widest tile.
    widest: f64,
}

/// A drawing on its part, before it is divided.
struct Stage<'a> {
    part: &'a CachedSurface,
    projection: Projection<'a>,
    unrolled: Unrolled,
    items: Vec<Item>,
    /// The ink's items.
    spans: Vec<[f64; 2]>,
    /// Positions of ink along the axis, mm, in rising order.
    along: Vec<f64>,
    /// Largest distance of the ink from the axis, mm.
    radius: f64,
    /// The extents of the ink, mm.
    drawn: Extents,
}

impl<'a> Stage<'a> {
    fn new(
        pattern: &PlacedPattern,
        map: &'a LengthTrueMap,
        part: &'a CachedSurface,
        settings: &JobSettings,
    ) -> Result<Self, Reason> {
        let PlacedPattern { placed, ink, .. } = pattern;
        let is_ink: Vec<bool> =
            placed.layers.iter().map(|layer| settings.pattern.counts_as_ink(&layer.name)).collect();
        let inked = |path: &Path| is_ink.get(path.layer).is_some_and(|is_ink| *is_ink);
        let only_ink = Pattern {
            layers: Vec::new(),
            paths: placed.paths.iter().filter(|path| inked(path)).cloned().collect(),
        };
        let unrolled = Unrolled::of(map).ok_or_else(|| checks::not_round(None, Method::EXACT_TOLERANCE))?;
        let unrolled = unrolled.without_jump_in(&only_ink);
        let items = rotary::items(&placed.paths, &unrolled);
        let spans: Vec<[f64; 2]> = items
            .iter()
            .filter(|item| item.paths.iter().any(|index| placed.paths.get(*index).is_some_and(inked)))
            .map(|item| item.span)
            .collect();
        let along = positions(ink, &unrolled);
        let radius = along.iter().map(|along| unrolled.radius(*along)).fold(0.0, f64::max);
        let projection =
            Projection { map, surface: &part.surface, fixture: settings.fixture, head: settings.scan_head() };
        let drawn = ink.extents;
        Ok(Self { part, projection, unrolled, items, spans, along, radius, drawn })
    }

    /// Ink at every position along the axis, at these angles.
    fn probes(&self, angles: &[f64]) -> Ink {
        let dots: Vec<FlatPoint> = angles
            .iter()
            .flat_map(|angle| self.along.iter().map(|along| self.unrolled.point(*angle, *along)))
            .collect();
        let extents = Extents::of(dots.iter().map(|dot| dot.coords()));
        Ink {
            pieces: Vec::new(),
            dots,
            squares: Vec::new(),
            blocks: Vec::new(),
            side: quality::SQUARE,
            inked_area: 0.0,
            extents,
        }
    }

    /// Whether all ink can be marked at an angle.
    fn is_clear(&self, angle: f64, incidence: f64, settings: &JobSettings) -> bool {
        let seen = self.projection.expose(&self.probes(&[angle]));
        let is_inside = settings.field.is_none_or(|field| {
            let area = field.extents();
            area.contains(seen.field.min) && area.contains(seen.field.max)
        });
        seen.off_surface == 0
            && seen.steepest <= incidence
            && seen.highest < self.projection.head.lens.height()
            && is_inside
    }

    /// The angle at which the part faces the laser: with the smallest incidence.
    fn facing(&self) -> f64 {
        let incidence = |angle: f64| {
            let seen = self.projection.expose(&self.probes(&[angle]));
            if seen.off_surface > 0 { f64::INFINITY } else { seen.steepest }
        };
        let degree = 1f64.to_radians();
        let rough = (-179..=179).map(|step| f64::from(step) * degree);
        let seen = |angle: &f64| incidence(*angle);
        let Some(rough) = rough.min_by(|a, b| seen(a).total_cmp(&seen(b)).then(a.abs().total_cmp(&b.abs())))
        else {
            return 0.0;
        };
        let (mut from, mut to) = (rough - degree, rough + degree);
        for _ in 0..40 {
            let [left, right] = [from + (to - from) / 3.0, to - (to - from) / 3.0];
            if incidence(left) <= incidence(right) { to = right } else { from = left }
        }
        f64::midpoint(from, to)
    }

    /// The farthest angle from `middle` in the direction `side` up to which all ink can be marked.
    fn reach(&self, middle: f64, side: f64, incidence: f64, settings: &JobSettings) -> f64 {
        let is_clear = |away: f64| self.is_clear(middle + side * away, incidence, settings);
        let mut clear = 0.0;
        while clear + STEP <= FARTHEST && is_clear(clear + STEP) {
            clear += STEP;
        }
        let mut blocked = clear + STEP;
        for _ in 0..24 {
            let half = f64::midpoint(clear, blocked);
            if half <= FARTHEST && is_clear(half) { clear = half } else { blocked = half }
        }
        middle + side * clear
    }

    fn window(&self, learned: &LearnedPart, settings: &JobSettings) -> Result<Window, Reason> {
        let middle = self.facing();
        let limits = &settings.optics.incidence;
        let is_auto = settings.rotary.tiles == Tiles::Auto;
        let gentle = limits.warn.min(limits.refuse) - MARGIN;
        let incidence = match is_auto && self.is_clear(middle, gentle, settings) {
            true => gentle,
            false => limits.refuse - MARGIN,
        };
        if !self.is_clear(middle, incidence, settings) {
            // The usual checks report the reason.
            let probes = self.probes(&[middle]);
            let seen = self.projection.expose(&probes);
            let lift = Lift::new(&self.part.surface, &learned.settings);
            checks::on_surface(&seen, self.part, &self.drawn)?;
            checks::exposure(&seen, &self.projection, self.part, lift, &probes, settings, &mut Vec::new())?;
            return Err(checks::rotary_no_room(0.0));
        }
        let [mut from, mut to] = [-1.0, 1.0].map(|side| self.reach(middle, side, incidence, settings));
        if let Some(depth) = settings.optics.focus_depth.filter(|_| is_auto) {
            let share = self.share_in_focus([from, middle, to], depth);
            from = middle + (from - middle) * share;
            to = middle + (to - middle) * share;
        }
        let widest = (to - from).min(settings.rotary.max_tile.unwrap_or(f64::INFINITY));
        if widest < NARROWEST {
            return Err(checks::rotary_no_room(widest));
        }
        Ok(Window { from, to, middle, widest })
    }

    /// The share of the angles on both sides of the middle in which the heights of the ink are within `depth` mm.
    fn share_in_focus(&self, [from, middle, to]: [f64; 3], depth: f64) -> f64 {
        let range = |share: f64| {
            let angles = [from, middle, to].map(|angle| middle + (angle - middle) * share);
            let seen = self.projection.expose(&self.probes(&angles));
            seen.highest - seen.lowest
        };
        if range(1.0) <= depth || range(0.0) > depth {
            return 1.0;
        }
        let (mut inside, mut outside) = (0.0, 1.0);
        for _ in 0..40 {
            let half = f64::midpoint(inside, outside);
            if range(half) <= depth { inside = half } else { outside = half }
        }
        inside
    }

    /// The corners of the ink in the window.
    fn corners(&self, window: &Window) -> Pattern {
        let (first, last) = (self.along.first().copied(), self.along.last().copied());
        let (first, last) = (first.unwrap_or(0.0), last.unwrap_or(0.0));
        let at = |angle, along| self.unrolled.point(angle, along);
        outline(&[at(window.from, first), at(window.to, first), at(window.to, last), at(window.from, last)])
    }

    fn tiling(&self, window: &Window, settings: &JobSettings) -> Result<(Tiling, f64), Reason> {
        let start = self.spans.iter().map(|span| span[0]).fold(f64::INFINITY, f64::min);
        let end = self.spans.iter().map(|span| span[1]).fold(f64::NEG_INFINITY, f64::max);
        let (width, whole) = (end - start, std::f64::consts::TAU);
        if width > whole + CLOSING / self.radius {
            return Err(checks::wider_than_round(width, self.radius));
        }
        let overlap = settings.rotary.overlap / self.radius;
        if overlap >= window.widest / 2.0 {
            return Err(checks::rotary_overlap(settings.rotary.overlap, window.widest * self.radius));
        }
        let count = match settings.rotary.tiles {
            Tiles::Count(count) => Some(count),
            Tiles::Auto | Tiles::Off => None,
        };
        let incidence = &settings.optics.incidence;
        let limits = Limits {
            // The angles of the rotary axis are rounded.
            widest: window.widest - 2e-5,
            overlap,
            count,
            narrowest: NARROWEST,
            // At the borders of a tile on a cylinder, the incidence is half its width.
            gentle: 2.0 * incidence.warn.min(incidence.refuse),
        };
        match rotary::plan(&self.spans, &limits) {
            Some(tiling) => Ok((tiling, overlap)),
            None => {
                let narrowest = NARROWEST.max(2.0 * overlap);
                let possible = rotary::counts(&self.spans, &limits);
                Err(checks::rotary_count(count, possible, [narrowest, window.widest]))
            }
        }
    }

    /// The tiles without their layers.
    fn tiles(&self, tiling: &Tiling, window: &Window, settings: &JobSettings) -> Vec<Tile> {
        let sense = if settings.rotary.is_reversed { -1.0 } else { 1.0 };
        let tile = |[from, to]: &[f64; 2]| {
            let half = (to - from) / 2.0;
            let low = window.from + half;
            let middle = window.middle.clamp(low, low.max(window.to - half));
            let angle = sense * (f64::midpoint(*from, *to) - middle).to_degrees();
            let angle_deg = (angle * 1000.0).round() / 1000.0 + 0.0;
            Tile { angle_deg, name: format!("R{angle_deg:+08.3}"), layers: Vec::new() }
        };
        tiling.tiles.iter().map(tile).collect()
    }
}

impl Tile {
    /// The angle about the axis by which its ink moves to the side that faces the laser, rad.
    fn back(&self, is_reversed: bool) -> f64 {
        let sense = if is_reversed { 1.0 } else { -1.0 };
        sense * self.angle_deg.to_radians()
    }

    fn has_layer(&self, layer: usize) -> bool {
        self.layers.iter().any(|(index, _)| *index == layer)
    }

    /// Its paths among those of all tiles.
    fn pattern(&self, placed: &Pattern) -> Pattern {
        let paths = placed.paths.iter().filter(|path| self.has_layer(path.layer)).cloned().collect();
        Pattern { layers: placed.layers.clone(), paths }
    }
}

/// Positions of ink along the axis: the first and the last in each of many equal stretches.
fn positions(ink: &Ink, unrolled: &Unrolled) -> Vec<f64> {
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let all: Vec<f64> =
        ends.chain(ink.squares.iter().chain(&ink.dots).copied()).map(|at| unrolled.along(at)).collect();
    let least = all.iter().copied().fold(f64::INFINITY, f64::min);
    let most = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let size = ((most - least) / POSITIONS).max(1e-9);
    let mut stretches: Vec<Option<[f64; 2]>> = vec![None; POSITIONS as usize + 1];
    for along in all {
        let index = (((along - least) / size) as usize).min(POSITIONS as usize);
        let [low, high] = stretches[index].unwrap_or([along, along]);
        stretches[index] = Some([low.min(along), high.max(along)]);
    }
    let mut positions: Vec<f64> = stretches.into_iter().flatten().flatten().collect();
    positions.dedup();
    positions
}

/// The ink of all tiles. Where filled areas of different tiles are on each other, each is sampled.
fn ink_of(placed: &Pattern, tiles: &[Tile], settings: &JobSettings) -> Ink {
    let sampled = |side: f64| {
        let sample = |tile: &Tile| {
            Ink::sample(
                &tile.pattern(placed),
                |layer| settings.pattern.counts_as_ink(layer),
                quality::PIECE,
                side,
            )
        };
        tiles.iter().map(sample).collect::<Vec<Ink>>()
    };
    let mut each = sampled(quality::SQUARE);
    // The squares of a very large drawing are larger.
    let side = each.iter().map(|ink| ink.side).fold(0.0, f64::max);
    if each.iter().any(|ink| ink.side != side) {
        each = sampled(side);
    }
    let mut all = Ink {
        pieces: Vec::new(),
        dots: Vec::new(),
        squares: Vec::new(),
        blocks: Vec::new(),
        side,
        inked_area: 0.0,
        extents: Extents::EMPTY,
    };
    for ink in each {
        for corner in [ink.extents.min, ink.extents.max].into_iter().filter(|_| !ink.extents.is_empty()) {
            all.extents.include(corner);
        }
        all.pieces.extend(ink.pieces);
        all.dots.extend(ink.dots);
        all.inked_area += ink.inked_area;
        all.squares.extend(ink.squares);
        all.blocks.extend(ink.blocks);
    }
    all
}

/// All tiles over each other, where each is marked; with each new layer the index of the one it comes from and its name.
fn overlaid(
    placed: &Pattern,
    stage: &Stage<'_>,
    (tiling, overlap): (&Tiling, f64),
    tiles: Vec<Tile>,
    is_reversed: bool,
) -> (Pattern, Vec<Tile>, Vec<(usize, String)>) {
    let mut all = Pattern::default();
    let mut names = Vec::new();
    let tiles = tiles.into_iter().enumerate().map(|(number, mut tile)| {
        let Stage { items, unrolled, radius, .. } = stage;
        let paths = rotary::tile(&placed.paths, items, unrolled, &tiling.cuts, number, overlap, *radius);
        let moved = Pattern { layers: Vec::new(), paths }.transformed(&unrolled.turn(tile.back(is_reversed)));
        let used = |layer: usize| moved.paths.iter().any(|path| path.layer == layer);
        for (index, layer) in placed.layers.iter().enumerate().filter(|(index, _)| used(*index)) {
            let name = format!("{} {}", tile.name, layer.name);
            tile.layers.push((all.layers.len(), index));
            names.push((index, name.clone()));
            all.layers.push(Layer { name, color: layer.color });
        }
        let of_tile =
            |layer: usize| tile.layers.iter().find(|(_, from)| *from == layer).map_or(0, |(index, _)| *index);
        all.paths.extend(moved.paths.into_iter().map(|path| Path { layer: of_tile(path.layer), ..path }));
        tile
    });
    let tiles = tiles.collect();
    (all, tiles, names)
}

/// The direction of the axis about which the part turns right-handed, and a point of it, in the laser's frame.
fn axis(map: &LengthTrueMap, unrolled: &Unrolled, settings: &JobSettings) -> [Vector3<f64>; 2] {
    let (along, point, anchor) = match map {
        LengthTrueMap::Cylinder(map, _) => (*map.cylinder.axis, map.cylinder.center, map.anchor()),
        LengthTrueMap::Cone(map, _) => (*map.cone.axis, map.cone.apex, map.anchor()),
        _ => return [Vector3::y(), Vector3::zeros()],
    };
    // Which way growing angles go round: from the anchor a little onwards.
    let onwards = unrolled.turn(0.01).point(anchor);
    let [here, there] = [anchor, onwards].map(|at| map.point_round(at).unwrap_or(point) - point);
    let sense = along.dot(&here.cross(&there)).signum();
    // The part turns back by the angle at which the ink is.
    let reversed = if settings.rotary.is_reversed { -1.0 } else { 1.0 };
    [settings.fixture.direction(along * (-sense * reversed)), settings.fixture.point(point).coords]
}

impl TiledMark {
    /// The report of the tiles of this drawing in the field.
    pub(super) fn report(
        &self,
        placed: &Pattern,
        projection: &Projection<'_>,
        drawing: &MarkingDrawing,
        settings: &JobSettings,
    ) -> RotaryReport {
        let widths =
            [self.tiling.tiles.first().map(|tile| tile[0]), self.tiling.tiles.last().map(|tile| tile[1])];
        let width = widths[1].unwrap_or(0.0) - widths[0].unwrap_or(0.0);
        let tile = |(number, (tile, on_part)): (usize, (&Tile, &[f64; 2]))| {
            let pattern = tile.pattern(placed);
            let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
            let ink = quality::sample(&pattern, is_ink);
            let seen = projection.expose(&ink);
            let points = drawing.paths.iter().filter(|path| tile.has_layer(path.layer));
            let points = points.flat_map(|path| path.shape.points()).map(|point| point.coords());
            let mut report =
                TileReport::new(number + 1, tile.angle_deg, tile.name.clone(), corners(&Extents::of(points)));
            let names = tile.layers.iter().filter_map(|(index, _)| placed.layers.get(*index));
            report.layers = names.map(|layer| layer.name.clone()).collect();
            report.on_part_deg = on_part.map(f64::to_degrees);
            report.incidence_deg = seen.steepest.to_degrees();
            report.ink_mm = ink.length();
            report.paths = pattern.paths.len();
            report
        };
        RotaryReport {
            axis: self.axis.into(),
            axis_point_mm: self.axis_point,
            circumference_mm: std::f64::consts::TAU * self.radius,
            width_deg: width.to_degrees(),
            widest_deg: self.widest.to_degrees(),
            overlap_mm: self.overlap,
            cuts_through_ink: self.tiling.cuts.iter().filter(|cut| cut.is_through_ink).count(),
            ink_mm: self.ink_mm,
            tiles: self.tiles.iter().zip(&self.tiling.tiles).enumerate().map(tile).collect(),
        }
    }

    /// A file for each tile, with the drawing's own layers; empty if the settings ask for layers.
    pub(super) fn files(
        &self,
        drawing: &MarkingDrawing,
        sku: &Sku,
        learned: &LearnedPart,
        input: PatternInput<'_>,
        settings: &JobSettings,
    ) -> Vec<TileFile> {
        if settings.rotary.written_as == TilesAs::Layers {
            return Vec::new();
        }
        let of = self.tiles.len();
        let file = |(number, tile): (usize, &Tile)| {
            // Fills and steps of focus are on layers that are named after those of the tile.
            let prefix = format!("{} ", tile.name);
            let of_tile: Vec<(usize, Layer)> = drawing
                .layers
                .iter()
                .enumerate()
                .filter_map(|(index, layer)| {
                    let name = layer.name.strip_prefix(&prefix)?.to_owned();
                    Some((index, Layer { name, color: layer.color }))
                })
                .collect();
            let paths = drawing.paths.iter().filter_map(|path| {
                let layer = of_tile.iter().position(|(index, _)| *index == path.layer)?;
                Some(MarkingPath { layer, ..path.clone() })
            });
            let paths: Vec<MarkingPath> = paths.collect();
            let layers = of_tile.into_iter().map(|(_, layer)| layer).collect();
            let mut comments = comments(sku, learned, input, settings);
            if !comments.is_empty() {
                comments.push(format!(
                    "tile {} of {of}, rotary axis at {:+.3} deg",
                    number + 1,
                    tile.angle_deg
                ));
            }
            let drawing = MarkingDrawing { layers, paths, comments };
            TileFile { name: tile.name.clone(), dxf: pattern::write(&drawing, profile(settings)), drawing }
        };
        self.tiles.iter().enumerate().map(file).collect()
    }

    /// The notices for people about the division.
    pub(super) fn notices(&self, part: &CachedSurface, settings: &JobSettings) -> Vec<Notice> {
        let mut notices = Vec::new();
        if settings.part.primitive.is_none() && self.tiles.iter().any(|tile| tile.angle_deg != 0.0) {
            let message = "isomark examined only the side that faces the laser and assumes that the part is round on the others";
            notices.push(Notice::note("rotary-other-sides", message));
        }
        if let Some(enough) = self.tiling.enough {
            let message = format!(
                "{enough} tiles would be as narrow as {}, which cut contours only to reach this number; set `tiles` under \
                 [rotary] to {enough}, or to \"auto\"",
                self.tiles.len()
            );
            notices.push(Notice::warning("rotary-more-tiles", message));
        }
        if part.mark.is_some() {
            let message = "the faces named `mark` are checked as if they were the same all the way round";
            notices.push(Notice::note("rotary-other-sides", message));
        }
        notices
    }

    /// The picture of the tiles.
    pub(super) fn picture(&self, report: &RotaryReport, drawing: &MarkingDrawing) -> TilesPicture {
        let lines = |paths: &[Path]| paths.iter().map(|path| flat(&path.shape)).collect();
        let along = self.drawn.paths.iter().flat_map(|path| path.shape.flattened(0.5));
        let along: Vec<f64> = along.map(|at| self.unrolled.along(at)).collect();
        let least = along.iter().copied().fold(f64::INFINITY, f64::min);
        let most = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let margin = 0.01 * self.drawn.extents().size().norm();
        let (least, most) = (least - margin, most + margin);
        let band = |[from, to]: [f64; 2]| {
            let steps = 24;
            let at = |step: i32, along: f64| {
                self.unrolled.point(from + (to - from) * f64::from(step) / f64::from(steps), along)
            };
            let outer = (0..=steps).map(|step| at(step, most));
            let inner = (0..=steps).rev().map(|step| at(step, least));
            outer.chain(inner).map(|at| [at.x, at.y]).collect()
        };
        let tiles =
            self.tiles.iter().zip(&report.tiles).zip(&self.tiling.tiles).map(|((tile, report), on_part)| {
                let of_tile = drawing.paths.iter().filter(|path| tile.has_layer(path.layer));
                TilePicture {
                    name: format!("{:+.3}°", tile.angle_deg),
                    about: format!("{:.1}°, {:.1} mm", report.incidence_deg, report.ink_mm),
                    band: band(*on_part),
                    marked: of_tile.map(|path| marked(&path.shape)).collect(),
                }
            });
        TilesPicture { drawn: lines(&self.drawn.paths), tiles: tiles.collect() }
    }
}

fn flat(shape: &Shape) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = shape.flattened(0.02).into_iter().map(|at| [at.x, at.y]).collect();
    if shape.is_closed() {
        points.extend(points.first().copied());
    }
    points
}

fn marked(shape: &MarkingShape) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = shape.points().iter().map(|at| [at.x, at.y]).collect();
    if matches!(shape, MarkingShape::Closed(_)) {
        points.extend(points.first().copied());
    }
    points
}

/// The table of a mark in tiles.
#[must_use]
pub fn rotary_table(sku: &str, pattern: &str, mark: &RotaryReport) -> RotaryTable {
    RotaryTable {
        schema: ROTARY_SCHEMA.into(),
        program: program(),
        sku: sku.into(),
        pattern: pattern.into(),
        mark: mark.clone(),
    }
}
