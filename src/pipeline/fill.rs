//! The fill of a job: its lines in the corrected drawing, its report, and its notices.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use super::checks;
use super::landmarks::Lift;
use super::{Aim, JobSettings, MarkingDrawing, Pattern, Projection};
use crate::formats::pattern::unused_name;
use crate::geometry::fill::{self, FillError, FillLine, FillOptions, Filling};
use crate::geometry::ink::Ink;
use crate::geometry::mapping::quality;
use crate::geometry::marking::{MarkingPath, MarkingShape};
use crate::geometry::pattern::{Layer, Path, Segment, Shape, Source};
use crate::geometry::space::FlatPoint;
use crate::reason::{Notice, Reason};
use crate::report::FillReport;

/// What the layers of fill lines are called: the layer of their contours with this.
const SUFFIX: &str = "-fill";
/// Contours with a fill are marked with this share of the chord tolerance, so that its lines end on them.
const CONTOUR_SHARE: f64 = 0.5;
/// A line whose ends are at most this far apart is probably meant to be closed, mm.
const NEARLY_CLOSED: f64 = 1.0;
/// A share of uneven lines that is worth a warning.
const NOTABLE: f64 = 0.01;
/// Length of fill lines that a picture shows, mm; beyond it, some lines are left out.
const SHOWN: f64 = 8000.0;
/// Distance of the lines that a picture shows, mm: closer ones would cover the contours and their colours.
const SHOWN_APART: f64 = 0.6;

/// A fill in the corrected drawing.
pub(super) struct Filled {
    pub(super) report: FillReport,
    /// The points of each line in the placed drawing.
    pub(super) drawn: Vec<Vec<FlatPoint>>,
    /// The lines for pictures, in the placed drawing.
    pub(super) shown: Pattern,
    /// Every how many lines are shown.
    pub(super) every: usize,
}

/// The chord tolerance for the lines of the drawing itself, mm.
pub(super) fn tolerance(settings: &JobSettings) -> f64 {
    settings.correction.tolerance * if settings.fill.spacing.is_some() { CONTOUR_SHARE } else { 1.0 }
}

/// The placed drawing for the search for a map: with the aim `lengths`, outlines that nothing fills are lines.
pub(super) fn for_map<'a>(placed: &'a Pattern, settings: &JobSettings) -> Cow<'a, Pattern> {
    match settings.correction.aim {
        Aim::Lengths => as_marked(placed, settings),
        _ => Cow::Borrowed(placed),
    }
}

/// The placed drawing as the laser marks it: where the fill fills outlines, they bound regions as hatches do.
pub(super) fn as_marked<'a>(placed: &'a Pattern, settings: &JobSettings) -> Cow<'a, Pattern> {
    if settings.fill.spacing.is_none() {
        return Cow::Borrowed(placed);
    }
    let unused =
        placed.paths.iter().filter_map(|path| path.region).max().map_or(0, |last| last.saturating_add(1));
    let mut marked = placed.clone();
    for path in &mut marked.paths {
        let layer = placed.layers.get(path.layer).map_or("", |layer| layer.name.as_str());
        let is_filled = settings.pattern.counts_as_ink(layer) && settings.fill.includes(layer);
        if is_filled && path.region.is_none() && path.is_contour() && !path.source.is_stroke {
            // The outlines of a layer bound one region together.
            path.region = Some(unused.saturating_add(path.layer as u32));
        }
    }
    Cow::Owned(marked)
}

/// The ink of a placed drawing, `ink`, without the areas inside outlines that nothing fills.
pub(super) fn marked_ink(placed: &Pattern, ink: &Ink, settings: &JobSettings) -> Ink {
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    quality::sample_as_marked(&as_marked(placed, settings), is_ink, ink)
}

/// Adds the lines of the fill to the corrected drawing, on their own layers after everything else. `turn` is the direction of the
/// drawing's x in the placed drawing, rad. `None` without a fill.
///
/// # Errors
/// When the fill would be too much to be marked.
pub(super) fn add(
    placed: &Pattern,
    turn: f64,
    projection: &Projection<'_>,
    settings: &JobSettings,
    lift: Lift<'_>,
    drawing: &mut MarkingDrawing,
    notices: &mut Vec<Notice>,
) -> Result<Option<Filled>, Reason> {
    let Some(spacing) = settings.fill.spacing else { return Ok(None) };
    if let Some(spot) = settings.optics.spot.filter(|spot| spacing < *spot) {
        return Err(finer_than_spot(spacing, spot));
    }
    let is_filled = |layer: &str| settings.pattern.counts_as_ink(layer) && settings.fill.includes(layer);
    let angles: Vec<f64> = [settings.fill.angle].into_iter().chain(settings.fill.second_angle).collect();
    let turned = angles.iter().map(|angle| angle + turn).collect();
    let options = FillOptions::new(spacing, turned, settings.fill.border, settings.correction.tolerance);
    contours(placed, is_filled, settings, lift, projection, notices);
    let found =
        fill::fill(placed, is_filled, projection, &options).map_err(|error| refused(&error, spacing))?;
    let Some(mut filling) = found.filter(|filling| !filling.lines.is_empty()) else {
        let message =
            "nothing is filled: no closed contour on the filled layers is wider than the line spacing";
        notices.push(Notice::warning("fill-nothing", message));
        return Ok(None);
    };
    let place = |at: FlatPoint| lift.point(projection.map.point(at));
    if filling.uneven > NOTABLE {
        let [least, most] = filling.deviation.map(|share| share * 100.0);
        let message = format!(
            "on {:.1} % of the fill, the distance of the lines on the part is not within 1 % of {spacing} mm ({least:+.1} to \
             {most:+.1} %): there the surface has no evenly spaced lines in this direction",
            filling.uneven * 100.0
        );
        notices.push(Notice::warning("fill-uneven", message).at_places(place(filling.deviation_at)));
    }
    let shown_length = filling.lines.iter().map(length).sum::<f64>();
    let every = (shown_length / SHOWN).max(SHOWN_APART / spacing).round().max(1.0) as usize;
    let layers = new_layers(placed, &filling);
    let names = layers.values().map(|(_, layer)| layer.name.clone()).collect();
    let report = FillReport::new(&filling, spacing, &angles, settings.fill.border, names);
    let first = drawing.layers.len();
    drawing.layers.extend(layers.values().map(|(_, layer)| layer.clone()));
    let shown = filling.lines.iter().filter(|line| line.number.rem_euclid(every as i64) == 0).map(path);
    let shown = Pattern { layers: placed.layers.clone(), paths: shown.collect() };
    let mut drawn = Vec::with_capacity(filling.lines.len());
    for line in filling.lines.drain(..) {
        let layer = first + layers.get(&line.layer).map_or(0, |(position, _)| *position);
        let shape = MarkingShape::Open(line.marked);
        drawing.paths.push(MarkingPath { layer, color: line.color, shape });
        drawn.push(line.drawn);
    }
    Ok(Some(Filled { report, drawn, shown, every }))
}

fn finer_than_spot(spacing: f64, spot: f64) -> Reason {
    Reason::new(
        "fill-finer-than-spot",
        format!("The lines of the fill would be {spacing} mm apart, and the spot is {spot} mm wide: they would overlap."),
        "Give `spacing_mm` under [fill] (`--fill`) at least the width of the spot. If the lines are to overlap, for a deep \
         engraving, remove `spot_mm` under [optics].",
    )
    .with_number("distance of the lines", spacing, "mm", Some(spot))
}

/// Refuses a fill of contours that are cut between the tiles of a mark round the part: a part of a contour is not closed.
/// `whole` is the drawing with its settings before it was divided, `divided` after that.
///
/// # Errors
/// When a contour of the fill is cut.
pub(super) fn in_tiles(
    whole: (&Pattern, &JobSettings),
    divided: (&Pattern, &JobSettings),
) -> Result<(), Reason> {
    if whole.1.fill.spacing.is_none() {
        return Ok(());
    }
    let closed = |(pattern, settings): (&Pattern, &JobSettings)| {
        let is_filled = |path: &&Path| {
            pattern.layers.get(path.layer).is_some_and(|layer| {
                settings.pattern.counts_as_ink(&layer.name) && settings.fill.includes(&layer.name)
            })
        };
        pattern
            .paths
            .iter()
            .filter(|path| path.is_contour() && path.region.is_none())
            .filter(is_filled)
            .count()
    };
    let cut = closed(whole).saturating_sub(closed(divided));
    if cut == 0 {
        return Ok(());
    }
    let contours = if cut == 1 { "1 contour" } else { &format!("{cut} contours") };
    Err(Reason::new(
        "fill-cut",
        format!("{contours} of the fill would be cut between tiles, and a part of a contour cannot be filled."),
        "Leave gaps between the contours and let tiles be wider (`max_tile_deg` under [rotary], `incidence_warn_deg` under [optics]), \
         or fill only other layers (`layers` under [fill]).",
    )
    .with_number("contours cut", cut as f64, "", Some(0.0)))
}

/// The layers of the lines, by the layer of their contours: position and content.
fn new_layers(placed: &Pattern, filling: &Filling) -> BTreeMap<usize, (usize, Layer)> {
    let mut names: BTreeSet<String> = placed.layers.iter().map(|layer| layer.name.to_lowercase()).collect();
    let mut layers: BTreeMap<usize, (usize, Layer)> = BTreeMap::new();
    for line in &filling.lines {
        if layers.contains_key(&line.layer) {
            continue;
        }
        let Some(of_contours) = placed.layers.get(line.layer) else { continue };
        let name = unused_name(&format!("{}{SUFFIX}", of_contours.name), &mut names);
        layers.insert(line.layer, (layers.len(), Layer { name, color: of_contours.color }));
    }
    layers
}

fn length(line: &FillLine) -> f64 {
    line.drawn.windows(2).map(|ends| ends[0].distance(ends[1])).sum()
}

fn path(line: &FillLine) -> Path {
    let sides = line.drawn.windows(2).map(|ends| Segment::Line { from: ends[0], to: ends[1] });
    Path {
        layer: line.layer,
        color: line.color,
        shape: Shape::Open(sides.collect()),
        region: None,
        source: Source { is_stroke: true, ..Source::default() },
    }
}

/// What is unusual about the contours.
fn contours(
    placed: &Pattern,
    is_filled: impl Fn(&str) -> bool + Copy,
    settings: &JobSettings,
    lift: Lift<'_>,
    projection: &Projection<'_>,
    notices: &mut Vec<Notice>,
) {
    let place = |at: FlatPoint| lift.point(projection.map.point(at));
    let layers: Vec<&str> = placed.layers.iter().map(|layer| layer.name.as_str()).collect();
    let missing = settings.fill.layers_missing_in(&layers);
    if !missing.is_empty() {
        let message = format!(
            "the drawing has no layer {} to fill; its layers are {}",
            missing.join(", "),
            layers.join(", ")
        );
        notices.push(Notice::warning("fill-layer-missing", message));
    }
    let open = fill::open_lines(placed, is_filled);
    let nearly = open.iter().filter(|line| line.gap <= NEARLY_CLOSED).count();
    if let Some(first) = open.first() {
        let what = match open.len() {
            1 => "1 open line encloses nothing and is not filled".to_owned(),
            many => format!("{many} open lines enclose nothing and are not filled"),
        };
        let places = open.iter().filter_map(|line| place(line.at));
        let notice = match nearly {
            0 => Notice::note("fill-open", what),
            _ => Notice::warning(
                "fill-open",
                format!(
                    "{what}; {nearly} nearly closed, with ends at most {NEARLY_CLOSED} mm apart (the first {:.3} mm): close them in the \
                     drawing, or raise `joining_mm` under [pattern]",
                    first.gap
                ),
            ),
        };
        notices.push(notice.at_places(places));
    }
    let unfilled = fill::regions_in_outlines(placed, is_filled);
    if !unfilled.is_empty() {
        let what = match unfilled.len() {
            1 => "1 letter, hatch or other area is inside an outline that is filled, and stays unfilled"
                .to_owned(),
            many => format!(
                "{many} letters, hatches or other areas are inside outlines that are filled, and stay unfilled"
            ),
        };
        let message = format!(
            "{what}. To fill these instead, put the outline on another layer and name the layers to fill (`layers` under [fill])"
        );
        let places = unfilled.iter().filter_map(|at| place(*at));
        notices.push(Notice::warning("fill-in-outline", message).at_places(places));
    }
    let crossings = fill::self_crossings(placed, is_filled);
    if let Some(first) = crossings.first() {
        let what = match crossings.len() {
            1 => "1 contour crosses itself".to_owned(),
            many => format!("{many} contours cross themselves"),
        };
        let at = projection.map.point(*first);
        let message = format!(
            "{what}, as at ({:.2}, {:.2}) mm of the view: by the even-odd rule, what such a contour encloses twice is not filled",
            at.x, at.y
        );
        notices.push(
            Notice::warning("fill-crossing", message).at_places(crossings.iter().filter_map(|at| place(*at))),
        );
    }
}

fn refused(error: &FillError, spacing: f64) -> Reason {
    match error {
        FillError::TooMuch { length, pieces } => {
            let (name, value, unit, limit) = match *length > fill::LONGEST {
                true => ("length of the fill", *length, "mm", fill::LONGEST),
                false => ("points and pieces of the fill", *pieces as f64, "", fill::MOST_POINTS as f64),
            };
            Reason::new(
                "fill-too-much",
                format!("The fill with lines {spacing} mm apart is more than can be marked."),
                "Raise `spacing_mm` under [fill] (`--fill`), or fill fewer layers (`layers`).",
            )
            .with_number(name, value, unit, Some(limit))
        }
        FillError::AboveLens(error) => checks::above_lens(error.at),
        _ => Reason::new(
            "fill-not-found",
            format!("No evenly spaced lines were found on the part: {error}."),
            "Fill fewer layers (`layers` under [fill]), or check the drawing's size.",
        ),
    }
}
